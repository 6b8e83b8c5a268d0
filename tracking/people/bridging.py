"""Bridging of missed detections: a correlation filter follows a person whom the detector misses.

Thesis 6.2 proposes to combine single-target and multi-target tracking: the multi-target tracker also uses a detector
whose parameters are updated as in single-target tracking. It notes that the time of the update matters, and leaves the
method open. Here that detector is the kernelised correlation filter (2.2.4) of one person. It is trained on a detection
and searches for the person in the frames where the general detector misses them. Its boxes are additional detections,
which the flow may use. They have no score, and each has a small cost. So the flow uses them only where the links over
them are cheaper, by more than this cost, than one link over the gap. They never form a track of their own.

* *When to update*: on detections only. A filter that is updated on its own boxes drifts, and a gap is too short for
  the appearance to change.
* *When to start*: at a detection that matches no detection of the next frame. People whom the detector finds in every
  frame cost nothing.
* *When to stop*: when a detection overlaps the filter's box, when the response falls below a threshold, at the border
  of the image, or after a number of frames.
* The camera's motion is compensated before the search. The search window reaches three quarters of the person's side,
  and a jerk of the drone can exceed that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.features.camera_path import moved_boxes
from tsuiseki.tracking.geometry import centres, clip_boxes, iou_matrix, suppress
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray

FILTER = kcf.KcfSettings(template=64, scale_step=1.0)


@dataclass(frozen=True)
class BridgingSettings:
    """When a correlation filter follows a person whom the detector misses.

    Attributes:
        most_frames: largest number of frames that a filter follows, at least 1.
        least_peak: the person is lost when the peak response is below this, in [0, 1].
        overlap: IoU from which two boxes show the same person, in (0, 1).
    """

    most_frames: int = 5
    least_peak: float = 0.3
    overlap: float = 0.3

    def __post_init__(self) -> None:
        if self.most_frames < 1:
            raise ValueError(f"expected most_frames from 1 frame, got {self.most_frames}")
        if not (0 <= self.least_peak <= 1 and 0 < self.overlap < 1):
            raise ValueError(
                "expected least_peak from 0 to 1 and overlap between them, got "
                f"{self.least_peak:g} and {self.overlap:g}"
            )


@dataclass(frozen=True)
class _Followed:
    """A person whom a filter follows, and frames since the detection."""

    model: kcf.Kcf
    state: kcf.KcfState
    age: int = 0

    def step(self, image: ImageArray, motion: FloatArray) -> _Followed:
        """Where the filter finds the person in the next frame."""
        moved = motion[:, :2] @ self.state.centre + motion[:, 2]
        here = replace(self.state, centre=moved, size=self.state.size * float(np.hypot(*motion[:, 0])))
        return replace(self, state=kcf.locate(self.model, here, image), age=self.age + 1)

    def box(self) -> FloatArray:
        return self.model.box(self.state.centre, self.state.size)


class Bridge:
    """Follows people whom a detector misses, frame by frame; see the module.

    It holds one image and one filter for each person missed at the moment.

    Args:
        settings: when a filter starts and stops.
    """

    def __init__(self, settings: BridgingSettings) -> None:
        self.settings = settings
        self.followed: list[_Followed] = []
        self._before: tuple[ImageArray, Detections] | None = None

    def step(self, image: ImageArray, found: Detections, motion: FloatArray | None) -> Detections:
        """People in the next frame whom its detections miss; their scores are NaN.

        Args:
            image: ``(H, W, 3)`` uint8 RGB.
            found: the detections in it.
            motion: ``(2, 3)`` similarity of the camera since the frame before; None for none.
        """
        motion = np.eye(3)[:2] if motion is None else motion
        missed = [*self.followed, *self._just_missed(found, motion)]
        self.followed = self._kept([one.step(image, motion) for one in missed], image, found)
        self._before = image, found
        if not self.followed:
            return Detections.empty()
        boxes = clip_boxes(np.stack([one.box() for one in self.followed]), image.shape[1], image.shape[0])
        return Detections(boxes, np.full(len(boxes), np.nan))

    def _just_missed(self, found: Detections, motion: FloatArray) -> list[_Followed]:
        """Filters for the detections of the frame before that match none of ``found``."""
        if self._before is None:
            return []
        image, before = self._before
        overlaps = iou_matrix(moved_boxes(before.boxes, motion), found.boxes)
        continued, _ = assign_overlaps(overlaps, self.settings.overlap)
        missed = np.setdiff1d(np.arange(len(before)), continued)
        return [_start(image, before.boxes[n]) for n in missed]

    def _kept(self, missed: list[_Followed], image: ImageArray, found: Detections) -> list[_Followed]:
        """Those of ``missed`` that are still found, each person once."""
        size = np.array([image.shape[1], image.shape[0]])
        seen = [
            one
            for one in missed
            if one.state.peak >= self.settings.least_peak
            and one.age <= self.settings.most_frames
            and bool(np.all((one.state.centre >= 0) & (one.state.centre < size)))
        ]
        if not seen:
            return []
        boxes = np.stack([one.box() for one in seen])
        # Who was detected last comes first, so that no filter depends on what began before its own detection.
        rank = [min(one.state.peak, 1.0) / 2 - one.age for one in seen]
        best = suppress(boxes, np.array(rank), self.settings.overlap)
        again = np.any(iou_matrix(boxes, found.boxes) >= self.settings.overlap, axis=1)
        return [seen[n] for n in sorted(best.tolist()) if not again[n]]


def _start(image: ImageArray, box: FloatArray) -> _Followed:
    """A filter trained on ``box`` ``(4,)``."""
    width, height = (box[2:] - box[:2]).tolist()
    model = kcf.Kcf.of(FILTER, width, height)
    return _Followed(model, kcf.start(model, image, centres(box)))
