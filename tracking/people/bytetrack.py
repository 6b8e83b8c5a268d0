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
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.lifecycle import LifecycleSettings, LifecycleTracker, adjusted, matched
from tsuiseki.tracking.types import Targets


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


class ByteTrack(LifecycleTracker[ByteTrackSettings]):
    """Each frame: predict every track, match the sure detections, then the unsure ones to the tracks left over.

    Args:
        settings: all of them.
        seed: taken as by all trackers; nothing is drawn.
        given: settings by name, those of `LifecycleSettings` too; they go before ``settings``. Without settings
            ``start_score`` is ``high_score`` + 0.1, if that is given.

    Somebody who is detected with a low score for two frames stays one track:

    >>> tracker = ByteTrack()
    >>> for time, score in enumerate([0.9, 0.9, 0.3, 0.3, 0.9]):
    ...     people = tracker.update([[time, 0, time + 20, 50, score]])
    >>> people.ids, people.status
    (array([1]), array(['tracking'], dtype='<U9'))
    >>> [track.frames.tolist() for track in tracker.tracks()]
    [[0, 1, 2, 3, 4]]
    """

    def __init__(self, settings: ByteTrackSettings | None = None, seed: int = 0, **given: Any) -> None:
        high = given.get("high_score")
        if high is not None and settings is None and given.get("start_score") is None:
            given["start_score"] = high + 0.1
        super().__init__(adjusted(settings, ByteTrackSettings, given), seed)

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the detections of the next frame; its people. A detection without a score counts as sure."""
        given, least = as_detections(detections, counted=self.bad), self._least
        sure = ~(given.scores < self.settings.high_score)
        high, low = np.flatnonzero(sure), np.flatnonzero(~sure & (given.scores >= self.settings.low_score))
        predicted = self._predict(time)
        everyone = np.arange(len(predicted))
        paired, detected = matched(predicted, given.boxes, everyone, high, least(self.settings.min_iou))
        left = self._misses == 0
        left[paired] = False
        rest = np.flatnonzero(left)
        more, unsure = matched(predicted, given.boxes, rest, low, least(self.settings.min_iou_low))
        return self._advance(np.concatenate([paired, more]), np.concatenate([detected, unsure]), given)[0]
