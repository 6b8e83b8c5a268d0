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
        self._labels = 0
        self._seen: dict[int, tuple[int, int]] = {}  # which of the labels it is, and in how many frames it was
        self._ids: dict[int, int] = {}
        self._rows: list[tuple[IntArray, IntArray, FloatArray, FloatArray, BoolArray]] = []

    def add(
        self,
        labels: IntArray,
        boxes: FloatArray,
        scores: FloatArray,
        observed: BoolArray | None = None,
        believed: BoolArray | None = None,
    ) -> Targets:
        """Take the next frame; the targets of it that have an id.

        Args:
            labels: ``(N,)``, each once.
            boxes: ``(N, 4)`` pixels.
            scores: ``(N,)``.
            observed: ``(N,)`` False where nothing in the frame supports the box; by default all are supported.
            believed: ``(N,)`` False where a label is to get no id yet; by default all may.
        """
        seen = np.ones(len(labels), dtype=np.bool_) if observed is None else observed
        self._rows.append((np.full(len(labels), self.frames), labels, boxes, scores, seen))
        self.frames += 1
        self._number(labels, np.ones(len(labels), dtype=np.bool_) if believed is None else believed)
        ids = np.array([self._ids.get(label, 0) for label in labels.tolist()], dtype=np.int64)
        status = np.where(seen, "tracking", "searching")
        return Targets(self.frames - 1, ids, boxes, np.where(seen, scores, 0.0), status).select(ids > 0)

    def _number(self, labels: IntArray, believed: BoolArray) -> None:
        """Give ids to labels that were now seen often enough, in the order in which they first appeared."""
        new = {label: trust for label, trust in zip(labels.tolist(), believed, strict=True) if label not in self._ids}
        for label in new:
            first, count = self._seen.get(label, (self._labels, 0))
            self._labels += count == 0
            self._seen[label] = first, count + 1
        named = [label for label, trust in new.items() if trust and self._seen[label][1] >= self.min_length]
        for label in sorted(named, key=self._seen.__getitem__):
            del self._seen[label]
            self._ids[label] = len(self._ids) + 1

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
