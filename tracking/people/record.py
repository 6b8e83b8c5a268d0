"""A whole video through a tracker of people, and the record that an online tracker keeps."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from tsuiseki.tracking.interchange import DetectionsLike
from tsuiseki.tracking.people.tracker import PeopleTracker
from tsuiseki.tracking.types import FloatArray, IntArray, Track


def run_tracker(detections: Iterable[DetectionsLike], tracker: PeopleTracker) -> list[Track]:
    """The tracks of a whole video.

    Args:
        detections: of each frame in order, frames without any included.
        tracker: it goes on from whatever it has seen before.
    """
    for found in detections:
        tracker.update(found)
    return tracker.tracks()


class Record:
    """The boxes of all tracks of a video, frame by frame.

    A track gets a running number when it starts and an id, counted from 1, when it is confirmed; its boxes from before
    belong to it. What is never confirmed never becomes a track. Beside a box there may be more columns.
    """

    def __init__(self) -> None:
        self._started = 0
        self._ids: dict[int, int] = {}
        self._frames: list[int] = []
        self._numbers: list[IntArray] = []
        self._boxes: list[FloatArray] = []
        self._scores: list[FloatArray] = []
        self._columns: tuple[list[Any], ...] = (self._frames, self._numbers, self._boxes, self._scores)
        self._pruned = 0

    def start(self, count: int) -> IntArray:
        """Numbers of ``count`` new tracks."""
        self._started += count
        return np.arange(self._started - count, self._started)

    def confirm(self, numbers: IntArray) -> None:
        """Give these tracks ids."""
        for number in numbers.tolist():
            self._ids.setdefault(number, len(self._ids) + 1)

    def ids(self, numbers: IntArray) -> IntArray:
        """``(K,)`` the ids of tracks that have one."""
        return np.array([self._ids[number] for number in numbers.tolist()], dtype=np.int64)

    def forget(self) -> None:
        """Drop the boxes so far; numbers and ids go on."""
        for kept in self._columns:
            kept.clear()
        self._pruned = 0

    def prune(self, live: IntArray) -> None:
        """Drop the boxes of tracks that have no id and, not being among the numbers ``live``, never get one.

        It goes through what was added since it was last called.
        """
        wanted = np.zeros(self._started, dtype=np.bool_)
        wanted[[*self._ids, *live.tolist()]] = True
        begin = self._pruned
        rows = list(zip(*(kept[begin:] for kept in self._columns), strict=True))
        for kept in self._columns:
            del kept[begin:]
        for frame, numbers, boxes, scores in rows:
            which = wanted[numbers]
            if which.any():
                self.append(frame, numbers[which], boxes[which], scores[which])
        self._pruned = len(self._frames)

    def append(self, frame: int, numbers: IntArray, boxes: FloatArray, scores: FloatArray) -> None:
        """Add the ``(K, 4 + …)`` boxes of the K tracks seen in a frame, and scores, 0 for those not known."""
        self._frames.append(frame)
        self._numbers.append(numbers)
        self._boxes.append(boxes)
        self._scores.append(np.nan_to_num(scores))

    def tracks(self) -> list[Track]:
        """The confirmed tracks, by id."""
        return [Track(*part) for part in self.parts()]

    def parts(self) -> list[tuple[int, IntArray, FloatArray, FloatArray]]:
        """Id, ``(T,)`` frames, ``(T, 4 + …)`` boxes and ``(T,)`` scores of the confirmed tracks, by id."""
        if not self._ids or not self._numbers:
            return []
        lookup = np.zeros(self._started, dtype=np.int64)
        lookup[list(self._ids)] = list(self._ids.values())
        ids = lookup[np.concatenate(self._numbers)]
        frames = np.repeat(self._frames, [len(numbers) for numbers in self._numbers])
        order = np.lexsort((frames, ids))
        order = order[np.searchsorted(ids[order], 1) :]
        if not len(order):
            return []
        boxes, scores = np.concatenate(self._boxes), np.concatenate(self._scores)
        tracks = np.split(order, np.flatnonzero(np.diff(ids[order])) + 1)
        return [(int(ids[rows[0]]), frames[rows], boxes[rows], scores[rows]) for rows in tracks]
