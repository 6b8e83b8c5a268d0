"""Pairs of boxes that lie near each other, by frame and place, without looking at all pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray

Pairs = tuple[IntArray, IntArray]
# As many as the processor holds close by.
BOXES_AT_ONCE = 4096
MOST_CELLS = 512
# Pixels by which ranges are widened, since the keys of long videos are rounded.
ROUNDING = 1e-3


def near_pairs(
    frames: IntArray, centre: FloatArray, reach: FloatArray, gap: int, tails: IntArray, heads: IntArray
) -> Pairs:
    """Pairs of boxes ``gap`` frames apart whose centres differ by no more than a reach in x and in y.

    Args:
        frames: ``(N,)``.
        centre: ``(N, 2)`` pixels.
        reach: ``(N, 2)`` largest difference from each earlier box, pixels.
        gap: frames between the two, 0 or more.
        tails: indices of the boxes that may be the earlier one.
        heads: of those that may be the later one.

    Returns:
        ``(P,)`` indices of the earlier and of the later boxes.
    """
    if len(tails) == 0 or len(heads) == 0:
        return tails[:0], heads[:0]
    x, y = centre.T.copy()
    strips = Strips.of(frames, x, heads, tails, float(reach[tails, 0].max()))
    pairs = []
    for start in range(0, len(tails), BOXES_AT_ONCE):
        part = tails[start : start + BOXES_AT_ONCE]
        pairs.append(near_places(strips, x, y, part, frames[part] + gap, reach[part, 0], reach[part, 1]))
    return joined(pairs)


@dataclass(frozen=True)
class Strips:
    """Boxes in the order of frame and x, in cells whose first box is known: so nothing is searched for.

    Attributes:
        ordered: ``(H,)`` indices of the boxes in this order.
        first: ``(F * cells + 1,)`` of F frames the first place in it of each cell.
        frame: the first of the frames.
        left: the least x.
        cell: width of a cell.
        cells: of a frame.
        key: ``(H,)`` increasing: frame and x of ``ordered`` in one number.
        width: of a frame in it. A frame is wider than any reach, so none leads into the next frame.
    """

    ordered: IntArray
    first: IntArray
    frame: int
    left: float
    cell: float
    cells: int
    key: FloatArray
    width: float

    @classmethod
    def of(
        cls, frames: IntArray, x: FloatArray, which: IntArray, others: IntArray | None = None, furthest: float = 0.0
    ) -> Strips:
        """For the boxes at ``(H,)`` indices of ``(N,)`` frames and ``(N,)`` x.

        Args:
            frames: ``(N,)``.
            x: ``(N,)``.
            which: ``(H,)`` indices.
            others: of the boxes near whose places those are looked up; by default the same.
            furthest: the largest reach.
        """
        if len(which) == 0:
            return cls(which, np.zeros(1, dtype=np.int64), 0, 0.0, 1.0, 1, np.empty(0), 1.0)
        ordered = which[np.lexsort((x[which], frames[which]))]
        row, others = frames[ordered] - int(frames[ordered[0]]), ordered if others is None else others
        left, count = min(float(x[others].min()), float(x[which].min())), int(row[-1]) + 1
        width = max(float(x[others].max()), float(x[which].max())) - left + 2 * furthest + 1.0
        place = x[ordered] - left
        # About two cells a box; beyond so many an image has no columns worth telling apart.
        cells = int(np.clip(2 * len(ordered) // count, 1, MOST_CELLS))
        cell = max(float(place.max()), 1e-6) / cells
        within = row * cells + np.minimum(place / cell, cells - 1).astype(np.int64)
        first = np.searchsorted(within, np.arange(count * cells + 1))
        return cls(ordered, first, int(frames[ordered[0]]), left, cell, cells, row * width + place, width)

    def between(self, when: IntArray, low: FloatArray, high: FloatArray) -> tuple[IntArray, IntArray]:
        """Ranges of ``ordered`` that hold all boxes of given frames with x from ``low`` to ``high``, and some more.

        Args:
            when: ``(P,)`` frames, which need not be among those of the boxes.
            low: ``(P,)``.
            high: ``(P,)``, no less.

        Returns:
            ``(P,)`` first places, and ``(P,)`` how many there are.
        """
        row, last = (when - self.frame) * self.cells, len(self.first) - 1
        low = np.minimum(np.maximum((low - self.left) / self.cell, 0), self.cells - 1)
        high = np.minimum(np.maximum((high - self.left) / self.cell + 1, 0), self.cells)
        # Frames before the first one and after the last one have no boxes.
        first = self.first[np.minimum(np.maximum(row + low.astype(np.int64), 0), last)]
        end = self.first[np.minimum(np.maximum(row + high.astype(np.int64), 0), last)]
        return first, np.maximum(end - first, 0)


def ranges(first: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """The places of P ranges one after the other: ``(K,)`` which range each belongs to, and ``(K,)`` the place."""
    end = np.cumsum(count)
    place = np.arange(int(end[-1]) if len(end) else 0) + np.repeat(first - end + count, count)
    return np.repeat(np.arange(len(first)), count), place


def near_places(
    strips: Strips,
    x: FloatArray,
    y: FloatArray,
    tails: IntArray,
    when: IntArray,
    reach_x: FloatArray,
    reach_y: FloatArray,
) -> Pairs:
    """Boxes of ``strips`` in given frames whose centres differ from others' by no more than a reach in x and in y.

    Args:
        strips: by the centres' x.
        x: ``(N,)`` of the centres of all boxes.
        y: ``(N,)`` likewise.
        tails: ``(T,)`` indices of the others.
        when: ``(T,)`` frames.
        reach_x: ``(T,)``.
        reach_y: ``(T,)``.

    Returns:
        ``(P,)`` indices of the others and of the boxes near them.
    """
    at = x[tails]
    target = (when - strips.frame) * strips.width + (at - strips.left)
    tail, place = ranges(*strips.between(when, at - reach_x - ROUNDING, at + reach_x + ROUNDING))
    head, key = strips.ordered[place], strips.key[place]
    near = np.abs(y[head] - y[tails][tail]) <= reach_y[tail]
    near &= key >= (target - reach_x)[tail]
    near &= key <= (target + reach_x)[tail]
    kept = np.flatnonzero(near)
    return tails[tail[kept]], head[kept]


def centres(boxes: FloatArray) -> FloatArray:
    """``(N, 2)`` centres of ``(N, 4)`` boxes."""
    return np.asarray((boxes[:, :2] + boxes[:, 2:]) / 2)


def sizes(boxes: FloatArray) -> FloatArray:
    """``(N, 2)`` widths and heights of ``(N, 4)`` boxes."""
    return np.asarray(boxes[:, 2:] - boxes[:, :2])


def gaps(longest: float, frame_rate: float) -> int:
    """Whole frames in so many seconds, at least 1."""
    return max(1, round(longest * frame_rate))


def joined(pairs: list[Pairs]) -> Pairs:
    """Several sets of pairs one after the other."""
    none = np.empty(0, dtype=np.int64)
    return np.concatenate([none, *(i for i, _ in pairs)]), np.concatenate([none, *(j for _, j in pairs)])
