"""What the trackers of people share: their interface, and the record of what they said.

A tracker is fed the detections of one frame after the other and can be asked for the tracks at any time. IDs live in
the tracker: two of them in one process never share a counter. The same input gives the same tracks.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np

from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track


class PeopleTracker(Protocol):
    """Turns the detections of a video into tracks."""

    def update(self, detections: Detections) -> None:
        """Take the detections of the next frame; they are not written to."""

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id; frames count from 0, the first ``update``."""


def track_people(detections: Iterable[Detections], tracker: PeopleTracker) -> list[Track]:
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
    belong to it. What is never confirmed never becomes a track.
    """

    def __init__(self) -> None:
        self._started = 0
        self._ids: dict[int, int] = {}
        self._frames: list[int] = []
        self._numbers: list[IntArray] = []
        self._boxes: list[FloatArray] = []
        self._scores: list[FloatArray] = []

    def start(self, count: int) -> IntArray:
        """Numbers of ``count`` new tracks."""
        self._started += count
        return np.arange(self._started - count, self._started)

    def confirm(self, numbers: IntArray) -> None:
        """Give these tracks ids."""
        for number in numbers.tolist():
            self._ids.setdefault(number, len(self._ids) + 1)

    def append(self, frame: int, numbers: IntArray, boxes: FloatArray, scores: FloatArray) -> None:
        """Add the ``(K, 4)`` boxes of the K tracks that were seen in a frame, and scores, 0 for those not known."""
        self._frames.append(frame)
        self._numbers.append(numbers)
        self._boxes.append(boxes)
        self._scores.append(np.nan_to_num(scores))

    def tracks(self) -> list[Track]:
        """The confirmed tracks, by id."""
        if not self._ids:
            return []
        lookup = np.zeros(self._started, dtype=np.int64)
        lookup[list(self._ids)] = list(self._ids.values())
        ids = lookup[np.concatenate(self._numbers)]
        frames = np.repeat(self._frames, [len(numbers) for numbers in self._numbers])
        order = np.lexsort((frames, ids))
        order = order[np.searchsorted(ids[order], 1) :]
        boxes, scores = np.concatenate(self._boxes), np.concatenate(self._scores)
        pieces = np.split(order, np.flatnonzero(np.diff(ids[order])) + 1)
        return [Track(int(ids[piece[0]]), frames[piece], boxes[piece], scores[piece]) for piece in pieces]
