"""ByteTrack: people followed online by every detection box (Zhang et al., "ByteTrack", ECCV 2022, algorithm 1).

A detection of low score is often a person who is half hidden, so it is not discarded. Detections with a score above a
threshold τ are matched to the tracks first. The others, D_low, are then matched to the tracks that are still unmatched.
So a track continues through low scores. Clutter of low score starts no track, and rarely matches one.

The paper leaves these points open; here, as in its experiments:

* Both similarities are the IoU with the box that a Kalman filter predicts.
* The second asks for more overlap, because detections of low score are less reliable.
* Only tracks with a detection in the frame before take part in the second.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Unpack

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.lifecycle import LifecycleKeywords, LifecycleSettings, LifecycleTracker, adjusted
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Targets


@dataclass(frozen=True)
class ByteTrackSettings:
    """Settings of ByteTrack.

    Attributes:
        high_score: τ, the score from which on a detection takes part in the first matching, in the detector's units.
        low_score: score below which a detection counts as a false positive.
        min_iou: least overlap of a match with a detection of high score, in (0, 1].
        min_iou_low: least overlap of a match with a detection of low score, in (0, 1].
        lifecycle: when tracks are confirmed and deleted; the paper starts them at τ + 0.1, confirms them after two
            detections and keeps them for 30 frames.
        motion: noise of the Kalman filter.
    """

    high_score: float = 0.6
    low_score: float = 0.1
    min_iou: float = 0.2
    min_iou_low: float = 0.5
    lifecycle: LifecycleSettings = field(
        default_factory=lambda: LifecycleSettings(min_hits=2, max_age=30, start_score=0.7)
    )
    motion: BoxMotion = field(default_factory=BoxMotion)

    def __post_init__(self) -> None:
        if not (0 < self.min_iou <= 1 and 0 < self.min_iou_low <= 1):
            raise RequestError(f"expected min_iou and min_iou_low in (0, 1], got {self.min_iou} and {self.min_iou_low}")
        if self.low_score > self.high_score:
            raise RequestError(f"expected low_score up to high_score, got {self.low_score} and {self.high_score}")


class ByteTrackKeywords(LifecycleKeywords, total=False):
    """What `ByteTrack` takes by name; by default ``max_age`` is 30, ``min_hits`` 2 and ``start_score`` τ + 0.1.

    Attributes:
        high_score: score from which on a detection takes part in the first matching, 0.6 by default.
        low_score: score below which a detection counts as a false positive, 0.1 by default.
        min_iou: least overlap of a match in the first matching, 0.2 by default.
        min_iou_low: least overlap of a match with a detection of low score, 0.5 by default.
    """

    high_score: float | None
    low_score: float | None
    min_iou: float | None
    min_iou_low: float | None


class ByteTrack(LifecycleTracker):
    """Each frame: predict every track, match the sure detections, then the unsure ones to the tracks left over.

    Beyond the paper, the boxes a track had before it was confirmed are in ``tracks()`` too once it is. It draws no
    random numbers.

    Args:
        settings: all of them; what is given by name goes before.
        seed: taken as by all trackers; nothing is drawn.
        given: see `ByteTrackKeywords`.

    Somebody who is detected with a low score for two frames stays one track:

    >>> tracker = ByteTrack()
    >>> for time, score in enumerate([0.9, 0.9, 0.3, 0.3, 0.9]):
    ...     people = tracker.update([[time, 0, time + 20, 50, score]])
    >>> people.ids, people.status
    (array([1]), array(['tracking'], dtype='<U9'))
    >>> [track.frames.tolist() for track in tracker.tracks()]
    [[0, 1, 2, 3, 4]]
    """

    def __init__(
        self, settings: ByteTrackSettings | None = None, seed: int = 0, **given: Unpack[ByteTrackKeywords]
    ) -> None:
        high = given.get("high_score")
        if high is not None and settings is None and given.get("start_score") is None:
            given["start_score"] = high + 0.1
        self.settings = adjusted(settings, ByteTrackSettings, given)
        super().__init__(self.settings, seed)

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the detections of the next frame; its people. A detection without a score counts as sure."""
        found = as_detections(detections, counted=self.bad)
        high = ~(found.scores < self.settings.high_score)
        low = ~high & (found.scores >= self.settings.low_score)
        predicted = self._lifecycle.predict(time)
        everyone = np.ones(len(predicted), dtype=np.bool_)
        paired, detected = matched(predicted, found.boxes, everyone, high, self._lifecycle.least(self.settings.min_iou))
        left = self._lifecycle.misses == 0
        left[paired] = False
        more, unsure = matched(predicted, found.boxes, left, low, self._lifecycle.least(self.settings.min_iou_low))
        self._lifecycle.advance(np.concatenate([paired, more]), np.concatenate([detected, unsure]), found)
        return self._lifecycle.targets


def matched(
    predicted: FloatArray, boxes: FloatArray, of_tracks: BoolArray, of_boxes: BoolArray, min_iou: float
) -> tuple[IntArray, IntArray]:
    """Matches by overlap among the tracks and the detections of two masks, as rows of all."""
    tracks, found = np.flatnonzero(of_tracks), np.flatnonzero(of_boxes)
    rows, columns = assign_overlaps(iou_matrix(predicted[tracks], boxes[found]), min_iou)
    return tracks[rows], found[columns]
