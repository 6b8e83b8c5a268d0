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

from dataclasses import replace
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, Age, PositiveShare, changed
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.lifecycle import LifecycleSettings, LifecycleTracker, ReportedBox, matched
from tsuiseki.tracking.types import Targets


@dataclass(frozen=True, config=SETTINGS)
class ByteTrackSettings(LifecycleSettings):
    """Settings of ByteTrack; as in the paper, tracks start at τ + 0.1, are confirmed at once again, and last 30 frames.

    Attributes:
        high_score: τ, the score from which on a detection takes part in the first matching, in the detector's units.
        low_score: score below which a detection counts as a false positive.
        min_iou: least overlap of a match with a detection of high score, in (0, 1].
        min_iou_low: least overlap of a match with a detection of low score, in (0, 1].
    """

    min_hits: Annotated[int, Field(ge=1, le=10_000)] = 2
    max_age: Age = 30
    start_score: float = 0.7
    high_score: float = 0.6
    low_score: float = 0.1
    min_iou: PositiveShare = 0.2
    min_iou_low: PositiveShare = 0.5

    @model_validator(mode="after")
    def _low_is_lower(self) -> Self:
        if self.low_score > self.high_score:
            raise ValueError(f"expected low_score up to high_score, got {self.low_score:g} and {self.high_score:g}")
        return self


BYTETRACK = ByteTrackSettings()


class ByteTrack(LifecycleTracker[ByteTrackSettings]):
    """Each frame: predict every track, match the sure detections, then the unsure ones to the tracks left over.

    Args:
        settings: all of them.
        seed: taken as by all trackers; nothing is drawn.

    Any setting can be given by its name as well, which goes before ``settings``. Without settings ``start_score`` is
    ``high_score`` + 0.1, where that is given.

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
        self,
        settings: ByteTrackSettings = BYTETRACK,
        seed: int = 0,
        *,
        high_score: float | None = None,
        low_score: float | None = None,
        min_iou: float | None = None,
        min_iou_low: float | None = None,
        min_hits: int | None = None,
        max_age: int | None = None,
        start_score: float | None = None,
        boxes: ReportedBox | None = None,
        motion: BoxMotion | None = None,
    ) -> None:
        start_follows = high_score is not None and start_score is None and settings is BYTETRACK
        settings = changed(settings, ByteTrackSettings, locals())
        if start_follows:
            settings = replace(settings, start_score=settings.high_score + 0.1)
        super().__init__(settings, seed)

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the detections of the next frame; its people. A detection without a score counts as sure."""
        detections = as_detections(detections, counted=self.bad)
        sure = ~(detections.scores < self.settings.high_score)
        high, low = np.flatnonzero(sure), np.flatnonzero(~sure & (detections.scores >= self.settings.low_score))
        predicted = self._predict(time)
        everyone = np.arange(len(predicted))
        paired, detected = matched(predicted, detections.boxes, everyone, high, self.settings.min_iou / self._slack)
        left = self._misses == 0
        left[paired] = False
        unmatched = np.flatnonzero(left)
        rematched, unsure = matched(
            predicted, detections.boxes, unmatched, low, self.settings.min_iou_low / self._slack
        )
        return self._advance(np.concatenate([paired, rematched]), np.concatenate([detected, unsure]), detections)[0]
