"""Start, confirmation and end of the tracks of an online tracker, and the record of their boxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.association.inference_times import Intervals
from tsuiseki.tracking.bounds import SETTINGS, Age
from tsuiseki.tracking.filters.kalman import (
    BoxMotion,
    per_longer_frame,
    predict_boxes,
    start_boxes,
    update_boxes,
)
from tsuiseki.tracking.geometry import centres, iou_matrix
from tsuiseki.tracking.interchange import BadBoxes
from tsuiseki.tracking.types import STATUSES, Detections, FloatArray, IntArray, Targets, Track
from tsuiseki.tracking.types.tracks import rows_of_each

ReportedBox = Literal["filtered", "detected"]
_STATUSES = np.array(STATUSES)
# Ids of tracks that have ended and are remembered when the past is forgotten.
KEPT = 1000


@pydantic_dataclass(frozen=True, config=SETTINGS)
class LifecycleSettings:
    """When a track is confirmed and when it is deleted, and how it moves: what all online methods share.

    Attributes:
        min_hits: detections in a row that confirm a new track; an earlier miss drops it.
        max_age: inferences for which a confirmed track is kept without a detection.
        start_score: lowest score of a detection that may start a track; one without a score may.
        boxes: box that a detected track reports: the box of its filter after the update, or the detected one; the
            latter also where the filter's has no area.
        motion: noise of the Kalman filter.
    """

    min_hits: Annotated[int, Field(ge=1, le=10_000)] = 3
    max_age: Age = 10
    start_score: float = 0.5
    boxes: ReportedBox = "filtered"
    motion: BoxMotion = field(default_factory=BoxMotion)


S = TypeVar("S", bound=LifecycleSettings)


@dataclass(frozen=True)
class Survivors:
    """Where the live tracks after a frame come from, in their order: matched, coasting, started.

    Attributes:
        matched: rows of the earlier tracks that were matched.
        detected: the detections they were matched to.
        coasting: rows of the earlier tracks that were missed and live on.
        started: detections that started a track.
        lost: rows of the earlier tracks that were confirmed and are deleted.
    """

    matched: IntArray
    detected: IntArray
    coasting: IntArray
    started: IntArray
    lost: IntArray


class LifecycleTracker(Generic[S]):
    """What online trackers share: the live tracks, each with a Kalman filter, and the record of all that were.

    `tracks` has the frames in which a track was detected; `update` also answers where it is expected in the others,
    with the status ``searching``. A frame of its filter is the usual interval between inferences.

    Args:
        settings: of the method.
        seed: taken as by all trackers; nothing is drawn.

    Attributes:
        settings: of the method.
        bad: boxes that are none, and left out.
    """

    def __init__(self, settings: S, seed: int) -> None:
        self.settings, self.seed, self.bad = settings, seed, BadBoxes()
        self._motion = settings.motion
        self._record = Record()
        self._clock = Intervals(settings.max_age + 2)
        # By what factor a frame of the filter has become longer before the last inference; and by what factor less
        # overlap a match needs, after an interval longer than usual, over which people move further.
        self._longer = self._slack = 1.0
        self._belief = start_boxes(np.empty((0, 4)), self._motion)
        # Of each live track: its number in the record, its detections, and inferences since the last of them.
        self._numbers, self._hits, self._misses = (np.empty(0, dtype=np.int64) for _ in range(3))
        self._votes = Votes()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._clock.frame} frames, {len(self._numbers)} live tracks>"

    def tracks(self) -> list[Track]:
        """The confirmed tracks of all frames so far, by id."""
        return [
            Track(number, frames, rows[:, :4], scores, origin=rows[:, 4:].astype(np.int64), names=self._votes.names)
            for number, frames, rows, scores in self._record.parts()
        ]

    def skip(self) -> Targets:
        self._clock.skip()
        boxes = predict_boxes(self._belief, self._motion, self._clock.since_last()).boxes
        none = np.empty(0, dtype=np.int64)
        return self._answer(
            np.zeros(len(boxes)), boxes, self._origin(none, none), (none, boxes[:0], none), skipped=True
        )

    def forget(self) -> None:
        self._record.forget(self._numbers)

    def _predict(self, time: float | None = None) -> FloatArray:
        """``(N, 4)`` where the live tracks are expected in the next frame, at a time in seconds.

        Raises:
            RequestError: see `Clock.now`.
        """
        passed, self._longer = self._clock.step(time)
        self._slack = max(1.0, self._clock.passed[-1])
        belief = self._belief if self._longer == 1 else per_longer_frame(self._belief, self._longer)
        self._belief = predict_boxes(belief, self._motion, passed)
        return self._belief.boxes

    def _advance(self, paired: IntArray, detected: IntArray, detections: Detections) -> tuple[Targets, Survivors]:
        """Update the tracks ``paired`` by the detections they were matched to, keep or drop the others, start new ones.

        It gives the confirmed tracks of the frame, those deleted in it included, and where the live tracks come from.
        """
        parts = self._divide(paired, detected, detections)
        lost = self._numbers[parts.lost], self._belief.boxes[parts.lost], self._votes.classes()[parts.lost]
        origin = detections.origin
        updated = update_boxes(self._belief.select(paired), detections.boxes[detected], self._motion)
        old = np.concatenate([paired, parts.coasting])
        started = len(parts.started)
        hits, misses = self._hits[old], self._misses[old] + 1
        hits[: len(paired)] += 1
        misses[: len(paired)] = 0
        if len(parts.coasting):
            updated = updated.and_then(self._belief.select(parts.coasting))
        if started:
            updated = updated.and_then(start_boxes(detections.boxes[parts.started], self._motion))
        self._belief = updated
        self._numbers = np.append(self._numbers[old], self._record.start(started))
        self._hits = np.append(hits, np.ones(started, np.int64))
        self._misses = np.append(misses, np.zeros(started, np.int64))
        present, used = np.flatnonzero(self._misses == 0), np.concatenate([detected, parts.started])
        self._votes.follow(old, started, present, used, detections)
        origin = origin[used]
        scores, boxes = self._note(present, used, detections, origin)
        return self._answer(scores, boxes, self._origin(present, origin[:, 0]), lost), parts

    def _origin(self, present: IntArray, rows: IntArray) -> IntArray:
        """``(N, 2)`` the detection of each track, -1 for those that are not ``present``, and its class by vote."""
        origin = np.column_stack([np.full(len(self._numbers), -1), self._votes.classes()])
        origin[present, 0] = rows
        return origin

    def _divide(self, paired: IntArray, detected: IntArray, detections: Detections) -> Survivors:
        missed = self._hits >= self.settings.min_hits
        missed[paired] = False
        young = self._misses < self.settings.max_age
        free = ~(detections.scores < self.settings.start_score)
        free[detected] = False
        coasting, lost = np.flatnonzero(missed & young), np.flatnonzero(missed & ~young)
        return Survivors(paired, detected, coasting, np.flatnonzero(free), lost)

    def _note(
        self, present: IntArray, detected: IntArray, detections: Detections, origin: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Record the tracks at ``(D,)`` rows, which were detected in this frame.

        Returns:
            ``(N,)`` the scores of all live tracks, 0 for those not detected, and ``(N, 4)`` the boxes they report.
        """
        scores, boxes = np.zeros(len(self._misses)), self._belief.boxes
        if not len(present):
            return scores, boxes
        numbers = self._numbers[present]
        self._record.confirm(numbers[self._hits[present] == self.settings.min_hits])
        scores[present] = np.nan_to_num(detections.scores[detected])
        # Where a detection is much flatter than expected, the filter's corners may have passed each other.
        replaced = (boxes[present, 2:] <= boxes[present, :2]).any(axis=1) | (self.settings.boxes == "detected")
        if replaced.any():
            boxes = boxes.copy()
            boxes[present[replaced]] = detections.boxes[detected[replaced]]
        rows = np.concatenate([boxes[present], origin], axis=1)
        self._record.append(self._clock.frame - 1, numbers, rows, scores[present])
        return scores, boxes

    def _answer(
        self,
        scores: FloatArray,
        boxes: FloatArray,
        origin: IntArray,
        lost: tuple[IntArray, FloatArray, IntArray],
        *,
        skipped: bool = False,
    ) -> Targets:
        """The confirmed live tracks, then those deleted in this frame: their numbers, boxes and classes."""
        live, (gone, last_boxes, classes) = np.flatnonzero(self._hits >= self.settings.min_hits), lost
        status = np.append((self._misses[live] > 0) | skipped, np.full(len(gone), 2))
        boxes = np.concatenate([boxes[live], last_boxes])
        # The predicted box of who was missed can have shrunk.
        boxes = np.where((status > 0)[:, None], with_area(boxes), boxes) if status.any() else boxes
        origin = np.concatenate([origin[live], np.column_stack([np.full(len(gone), -1), classes])])
        ids, scores = (
            self._record.ids(np.append(self._numbers[live], gone)),
            np.append(scores[live], np.zeros(len(gone))),
        )
        return Targets(self._clock.frame - 1, ids, boxes, scores, _STATUSES[status], origin, self._votes.names)


def matched(
    boxes: FloatArray, detected: FloatArray, tracks: IntArray, detections: IntArray, least: float
) -> tuple[IntArray, IntArray]:
    """Matches by an overlap of at least ``least`` among some rows of ``boxes`` and of ``detected``, as rows of all."""
    rows, columns = assign_overlaps(iou_matrix(boxes[tracks], detected[detections]), least)
    return tracks[rows], detections[columns]


def with_area(boxes: FloatArray) -> FloatArray:
    """``(N, 4)`` boxes, those that a prediction has shrunk to nothing one pixel wide or high."""
    thin = (boxes[:, 2:] - boxes[:, :2]) < 1
    if not thin.any():
        return boxes
    middle = centres(boxes)
    return np.where(np.tile(thin, 2), np.concatenate([middle - 0.5, middle + 0.5], axis=1), boxes)


class Record:
    """The boxes of all tracks of a video, frame by frame.

    A track gets a running number when it starts and an id, counted from 1, when it is confirmed; its boxes from before
    belong to it. What is never confirmed never becomes a track. Beside a box there may be more columns.
    """

    def __init__(self) -> None:
        self._started = self._pruned = self._confirmed = 0
        self._ids: dict[int, int] = {}
        # Of each frame: its number, and the numbers, boxes and scores of tracks.
        self._rows: list[tuple[int, IntArray, FloatArray, FloatArray]] = []

    def start(self, count: int) -> IntArray:
        """Numbers of ``count`` new tracks."""
        self._started += count
        return np.arange(self._started - count, self._started)

    def confirm(self, numbers: IntArray) -> None:
        """Give these tracks ids."""
        for number in numbers.tolist():
            if number not in self._ids:
                self._confirmed += 1
                self._ids[number] = self._confirmed

    def ids(self, numbers: IntArray) -> IntArray:
        """``(K,)`` the ids of tracks that have one."""
        return np.array([self._ids[number] for number in numbers.tolist()], dtype=np.int64)

    def forget(self, live: IntArray | None = None) -> None:
        """Drop the boxes so far, and of all but the numbers ``live`` the ids; numbers and ids go on."""
        self._rows.clear()
        if live is not None and len(self._ids) > len(live) + KEPT:
            self._ids = {number: self._ids[number] for number in live.tolist() if number in self._ids}
        self._pruned = 0

    def prune(self, live: IntArray) -> None:
        """Drop the boxes of tracks that have no id and, not being among the numbers ``live``, never get one.

        It goes through what was added since it was last called.
        """
        retained = np.zeros(self._started, dtype=np.bool_)
        retained[[*self._ids, *live.tolist()]] = True
        rows = self._rows[self._pruned :]
        del self._rows[self._pruned :]
        for frame, numbers, boxes, scores in rows:
            which = retained[numbers]
            if which.any():
                self.append(frame, numbers[which], boxes[which], scores[which])
        self._pruned = len(self._rows)

    def append(self, frame: int, numbers: IntArray, boxes: FloatArray, scores: FloatArray) -> None:
        """Add the ``(K, 4 + …)`` boxes of the K tracks detected in a frame, and scores, 0 for those not known."""
        self._rows.append((frame, numbers, boxes, np.nan_to_num(scores)))

    def parts(self) -> list[tuple[int, IntArray, FloatArray, FloatArray]]:
        """Id, ``(T,)`` frames, ``(T, 4 + …)`` boxes and ``(T,)`` scores of the confirmed tracks, by id."""
        if not self._ids or not self._rows:
            return []
        lookup = np.zeros(self._started, dtype=np.int64)
        lookup[list(self._ids)] = list(self._ids.values())
        of_frames, of_tracks, *columns = zip(*self._rows, strict=True)
        frames, ids = np.repeat(of_frames, list(map(len, of_tracks))), lookup[np.concatenate(of_tracks)]
        boxes, scores = map(np.concatenate, columns)
        # Frames were added in their order.
        return [
            (int(ids[rows[0]]), frames[rows], boxes[rows], scores[rows]) for rows in rows_of_each(ids) if ids[rows[0]]
        ]


class Votes:
    """How many detections of each class the live tracks have had.

    Attributes:
        names: of the classes so far.
    """

    def __init__(self) -> None:
        self.names: Mapping[int, str] = {}
        self._numbers = np.empty(0, dtype=np.int64)
        self._counts = np.zeros((0, 0), dtype=np.int64)

    def follow(self, old: IntArray, started: int, rows: IntArray, detected: IntArray, detections: Detections) -> None:
        """Take the next frame, in which the tracks ``old`` live on and so many start, after them.

        The tracks in ``rows`` ``(D,)``, as they are now, were detected.
        """
        classes = np.empty(0, np.int64) if detections.classes is None else detections.classes
        numbers = np.union1d(self._numbers, classes[classes >= 0]) if len(classes) else self._numbers
        counts = np.zeros((len(old) + started, len(numbers)), dtype=np.int64)
        if len(numbers):
            counts[: len(old), np.searchsorted(numbers, self._numbers)] = self._counts[old]
        if len(classes):
            self.names = {**self.names, **detections.names}
            voting = classes[detected] >= 0
            counts[rows[voting], np.searchsorted(numbers, classes[detected][voting])] += 1
        self._numbers, self._counts = numbers, counts

    def classes(self) -> IntArray:
        """``(N,)`` the class that most detections of each track had, the smaller one of two; -1 where none is known."""
        if not len(self._numbers):
            return np.full(len(self._counts), -1)
        return np.where(self._counts.any(axis=1), self._numbers[self._counts.argmax(axis=1)], -1)
