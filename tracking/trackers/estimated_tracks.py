"""Tracks collected from what a filter estimates frame by frame."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track


class EstimatedTracks:
    """Boxes by label, frame after frame; labels become ids counted from 1 in the order of appearance.

    Args:
        shortest: labels seen in fewer frames become no track.
    """

    def __init__(self, shortest: int = 1) -> None:
        self.shortest = shortest
        self.frames = 0
        self._rows: list[tuple[IntArray, IntArray, FloatArray, FloatArray, BoolArray]] = []

    def add(self, labels: IntArray, boxes: FloatArray, scores: FloatArray, observed: BoolArray | None = None) -> None:
        """Take labels ``(N,)``, boxes ``(N, 4)`` and scores ``(N,)`` of the next frame."""
        seen = np.ones(len(labels), dtype=np.bool_) if observed is None else observed
        self._rows.append((np.full(len(labels), self.frames), labels, boxes, scores, seen))
        self.frames += 1

    def tracks(self) -> list[Track]:
        """The tracks so far, by id."""
        if not self._rows:
            return []
        frames, labels, boxes, scores, observed = (np.concatenate(part) for part in zip(*self._rows, strict=True))
        names, first, counts = np.unique(labels, return_index=True, return_counts=True)
        kept = names[np.argsort(first, kind="stable")]
        kept = kept[counts[np.searchsorted(names, kept)] >= self.shortest]
        rows = [np.flatnonzero(labels == name) for name in kept]
        return [
            Track(number, frames[row], boxes[row], scores[row], observed[row])
            for number, row in enumerate(rows, start=1)
        ]
