"""Birth, confirmation and death of the tracks of an online tracker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.kalman import (
    BoxMotion,
    join_boxes,
    predict_boxes,
    select_boxes,
    start_boxes,
    update_boxes,
)
from tsuiseki.tracking.trackers.people import Record
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track


@dataclass(frozen=True)
class LifecycleSettings:
    """When a track is believed and when it is given up.

    Attributes:
        min_hits: detections in a row that confirm a new track; an earlier miss drops it.
        max_age: frames that a confirmed track is kept without a detection.
        start_score: lowest score of a detection that may start a track.
    """

    min_hits: int = 3
    max_age: int = 10
    start_score: float = 0.5

    def __post_init__(self) -> None:
        if self.min_hits < 1 or self.max_age < 0:
            raise ValueError(f"expected min_hits >= 1 and max_age >= 0, got {self.min_hits} and {self.max_age}")


@dataclass(frozen=True)
class Survivors:
    """Where the live tracks after a frame come from, in their order: seen, kept, born.

    Attributes:
        seen: rows of the earlier tracks that were matched.
        detected: the detections they were matched to.
        kept: rows of the earlier tracks that were not seen and live on.
        born: detections that started a track.
    """

    seen: IntArray
    detected: IntArray
    kept: IntArray
    born: IntArray


class Lifecycle:
    """The tracks that are alive, each with a Kalman filter, and the record of all that were.

    A track is reported where it was seen, at the box of the filter after the update.
    """

    def __init__(self, settings: LifecycleSettings, motion: BoxMotion) -> None:
        self._settings = settings
        self._motion = motion
        self._record = Record()
        self._frame = -1
        self._belief = start_boxes(np.empty((0, 4)), motion)
        self._numbers = np.empty(0, dtype=np.int64)
        self._hits = np.empty(0, dtype=np.int64)
        self._misses = np.empty(0, dtype=np.int64)

    def predict(self) -> FloatArray:
        """``(N, 4)`` where the live tracks are expected in the next frame."""
        self._frame += 1
        self._belief = predict_boxes(self._belief, self._motion)
        return self._belief.boxes

    @property
    def misses(self) -> IntArray:
        """``(N,)`` frames since each live track was last seen."""
        return self._misses

    def tracks(self) -> list[Track]:
        """All confirmed tracks so far."""
        return self._record.tracks()

    def advance(self, seen: IntArray, detected: IntArray, detections: Detections) -> Survivors:
        """Update the tracks ``seen`` by the detections they were matched to, keep or drop the others, start new ones.

        Args:
            seen: rows of the matched tracks.
            detected: the detection of each.
            detections: all of the frame.
        """
        parts = self._divide(seen, detected, detections)
        updated = update_boxes(select_boxes(self._belief, seen), detections.boxes[detected], self._motion)
        old = np.concatenate([seen, parts.kept])
        born = len(parts.born)
        hits, misses = self._hits[old], self._misses[old] + 1
        hits[: len(seen)] += 1
        misses[: len(seen)] = 0
        beliefs = [updated]
        if len(parts.kept):
            beliefs.append(select_boxes(self._belief, parts.kept))
        if born:
            beliefs.append(start_boxes(detections.boxes[parts.born], self._motion))
            hits, misses = np.append(hits, np.ones(born, np.int64)), np.append(misses, np.zeros(born, np.int64))
        self._belief = join_boxes(beliefs) if len(beliefs) > 1 else updated
        self._numbers = np.append(self._numbers[old], self._record.start(born)) if born else self._numbers[old]
        self._hits, self._misses = hits, misses
        self._note(parts, detections)
        return parts

    def _divide(self, seen: IntArray, detected: IntArray, detections: Detections) -> Survivors:
        kept = (self._hits >= self._settings.min_hits) & (self._misses < self._settings.max_age)
        kept[seen] = False
        free = detections.scores >= self._settings.start_score
        free[detected] = False
        return Survivors(seen, detected, np.flatnonzero(kept), np.flatnonzero(free))

    def _note(self, parts: Survivors, detections: Detections) -> None:
        """Record the tracks with a detection in this frame."""
        present = self._misses == 0
        if not present.any():
            return
        numbers = self._numbers[present]
        self._record.confirm(numbers[self._hits[present] == self._settings.min_hits])
        scores = detections.scores[np.concatenate([parts.detected, parts.born])]
        self._record.append(self._frame, numbers, self._belief.boxes[present], scores)
