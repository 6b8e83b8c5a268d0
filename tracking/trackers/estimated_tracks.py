"""Tracks collected from what a filter estimates frame by frame."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Targets, Track


class EstimatedTracks:
    """Boxes by label, frame after frame; a label gets an id, counted from 1, once it was seen in enough frames.

    Args:
        min_length: labels seen in fewer frames become no track.
    """

    def __init__(self, min_length: int = 1) -> None:
        self.min_length = min_length
        self.frames = 0
        self._seen: dict[int, int] = {}
        self._ids: dict[int, int] = {}
        self._rows: list[tuple[IntArray, IntArray, FloatArray, FloatArray, BoolArray]] = []

    def add(
        self, labels: IntArray, boxes: FloatArray, scores: FloatArray, observed: BoolArray | None = None
    ) -> Targets:
        """Take the next frame; the targets of it that have an id.

        Args:
            labels: ``(N,)``, each once.
            boxes: ``(N, 4)`` pixels.
            scores: ``(N,)``.
            observed: ``(N,)`` False where nothing in the frame supports the box; by default all are supported.
        """
        seen = np.ones(len(labels), dtype=np.bool_) if observed is None else observed
        self._rows.append((np.full(len(labels), self.frames), labels, boxes, scores, seen))
        self.frames += 1
        ids = np.array([self._id(label) for label in labels.tolist()], dtype=np.int64)
        status = np.where(seen, "tracking", "searching")
        return Targets(self.frames - 1, ids, boxes, np.where(seen, scores, 0.0), status).select(ids > 0)

    def _id(self, label: int) -> int:
        """The id of a label that was seen once more; 0 as long as it has none."""
        if label not in self._ids:
            self._seen[label] = self._seen.get(label, 0) + 1
            if self._seen[label] < self.min_length:
                return 0
            del self._seen[label]
            self._ids[label] = len(self._ids) + 1
        return self._ids[label]

    def forget(self) -> None:
        """Drop the frames so far from `tracks`; ids go on."""
        self._rows.clear()

    def tracks(self) -> list[Track]:
        """The tracks so far, by id."""
        if not self._rows:
            return []
        frames, labels, boxes, scores, observed = (np.concatenate(part) for part in zip(*self._rows, strict=True))
        order = np.argsort(labels, kind="stable")
        names, starts = np.unique(labels[order], return_index=True)
        parts = np.split(order, starts[1:]) if len(names) else []
        rows = dict(zip(names.tolist(), parts, strict=True))
        return [
            Track(number, frames[row], boxes[row], scores[row], observed[row])
            for label, number in self._ids.items()
            if (row := rows.get(label)) is not None
        ]
