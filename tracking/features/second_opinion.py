"""Two detectors as one: boxes that both report are put together, and what one of them reports alone is kept.

Boxes of a frame are matched one to one by Hungarian assignment, from an intersection over union of 0.5 on. A pair gives
one box, the mean of its two weighted by their scores, as in Solovyev, Wang and Gabruseva 2021, *Weighted boxes fusion*,
equation 2. Its score is the larger one. A box of the first that the second does not report keeps its score. One of the
second alone is added from a score of 0.5 on, where it is likelier to be right than not. What all of these scores are
worth in the video is left to the tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from tsuiseki.tracking.features.exported import ChoosingDetect, Detect
from tsuiseki.tracking.features.foreign_detector import SAME
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray

# Score from which a box of the second detector alone is added.
ADDED = 0.5


@dataclass(frozen=True)
class SecondOpinion:
    """Two detectors of people as one.

    Attributes:
        first: a detector.
        second: the other one; both have scores in [0, 1].
    """

    first: Detect
    second: Detect

    def prepared(self, images: Sequence[ImageArray], workers: int = 1) -> SecondOpinion:
        """Both for ``images``, see `ChoosingDetect`."""
        first, second = (
            detect.prepared(images, workers) if isinstance(detect, ChoosingDetect) else detect
            for detect in (self.first, self.second)
        )
        return SecondOpinion(first, second)

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """The boxes of both in each ``(H, W, 3)`` uint8 RGB image."""
        return [together(*pair) for pair in zip(self.first.detect(images), self.second.detect(images), strict=True)]


def together(first: Detections, second: Detections) -> Detections:
    """What two detectors report in one frame: pairs, then the rest of the first, then what the second adds."""
    overlaps = iou_matrix(first.boxes, second.boxes)
    i, j = scipy.optimize.linear_sum_assignment(-overlaps)
    same = overlaps[i, j] >= SAME
    i, j = i[same], j[same]
    scores = np.stack([first.scores[i], second.scores[j]])
    weights = (scores / np.maximum(scores.sum(axis=0), np.finfo(np.float64).tiny))[..., None]
    boxes: FloatArray = weights[0] * first.boxes[i] + weights[1] * second.boxes[j]
    rest = first.select(np.setdiff1d(np.arange(len(first)), i))
    added = second.select(np.setdiff1d(np.arange(len(second)), j)).scoring(ADDED)
    return Detections(
        np.concatenate([boxes, rest.boxes, added.boxes]),
        np.concatenate([scores.max(axis=0, initial=0.0), rest.scores, added.scores]),
    )
