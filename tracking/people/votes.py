"""The classes of live tracks, by the votes of their detections: one that flickers changes none of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tsuiseki.tracking.types import Detections, IntArray


class Votes:
    """How many detections of each class the live tracks have had.

    Attributes:
        names: of the classes so far.
    """

    def __init__(self) -> None:
        self.names: Mapping[int, str] = {}
        self._numbers = np.empty(0, dtype=np.int64)
        self._counts = np.zeros((0, 0), dtype=np.int64)

    def follow(self, old: IntArray, started: int, rows: IntArray, detected: IntArray, found: Detections) -> None:
        """Take the next frame.

        Args:
            old: rows of the earlier tracks that live on, in their order.
            started: number of tracks that start, after them.
            rows: ``(D,)`` the tracks, as they are now, with a detection.
            detected: ``(D,)`` the detection of each.
            found: all of the frame.
        """
        classes = np.empty(0, np.int64) if found.classes is None else found.classes
        numbers = np.union1d(self._numbers, classes[classes >= 0]) if len(classes) else self._numbers
        counts = np.zeros((len(old) + started, len(numbers)), dtype=np.int64)
        if len(numbers):
            counts[: len(old), np.searchsorted(numbers, self._numbers)] = self._counts[old]
        if len(classes):
            self.names = {**self.names, **found.names}
            voting = classes[detected] >= 0
            counts[rows[voting], np.searchsorted(numbers, classes[detected][voting])] += 1
        self._numbers, self._counts = numbers, counts

    def classes(self) -> IntArray:
        """``(N,)`` the class that most detections of each track had, the smaller one of two; -1 where none is known."""
        if not len(self._numbers):
            return np.full(len(self._counts), -1)
        return np.where(self._counts.any(axis=1), self._numbers[self._counts.argmax(axis=1)], -1)
