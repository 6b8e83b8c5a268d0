"""Pairs of boxes that lie near each other, found without comparing all pairs, and how much of a box is hidden.

A box is hidden by boxes nearer to the camera, or outside the image. Of two people on the ground the one whose feet are
lower in the image is nearer. Parts that several boxes hide count once for each, up to the whole box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import FloatArray, IntArray

Pairs = tuple[IntArray, IntArray]
# Boxes whose pairs are searched together: as many as the processor holds close by.
BOXES_AT_ONCE = 4096
# Pixels by which the ranges of what hides a box are widened, since the keys of long videos are rounded.
ROUNDING = 1e-3


def near_pairs(frames: IntArray, centre: FloatArray, reach: FloatArray, gap: int) -> Pairs:
    """``(P,)`` indices of earlier and later boxes ``gap`` frames apart, 0 or more, whose centres lie within reach.

    Args:
        frames: ``(N,)``.
        centre: ``(N, 2)`` pixels.
        reach: ``(N, 2)`` largest difference from each earlier box in x and in y, pixels.
        gap: frames between the two.
    """
    indices, places = np.arange(len(frames)), centre.T.copy()
    strips = Strips.of(frames, places[0], indices, None, float(reach[:, 0].max(initial=0.0)))
    pairs = []
    for start in range(0, len(indices), BOXES_AT_ONCE):
        part = indices[start : start + BOXES_AT_ONCE]
        pairs.append(near_places(strips, places, part, frames[part] + gap, reach[part]))
    return joined(pairs)


@dataclass(frozen=True)
class Strips:
    """Boxes in the order of frame and x.

    Attributes:
        ordered: ``(H,)`` indices of the boxes in this order.
        key: ``(H,)`` increasing: frame and x of ``ordered`` in one number, see `keys`.
        frame: the first of the frames.
        left: the least x.
        width: of a frame in the keys. A frame is wider than any reach, so none leads into the next frame.
    """

    ordered: IntArray
    key: FloatArray
    frame: int
    left: float
    width: float

    @classmethod
    def of(
        cls, frames: IntArray, x: FloatArray, which: IntArray, others: IntArray | None = None, furthest: float = 0.0
    ) -> Strips:
        """Of the boxes at ``(H,)`` indices ``which`` of ``(N,)`` frames and ``(N,)`` x.

        Args:
            frames: ``(N,)``.
            x: ``(N,)``.
            which: ``(H,)``.
            others: indices of the boxes near whose places those are searched; by default the same.
            furthest: the largest reach.
        """
        if len(which) == 0:
            return cls(which, np.empty(0), 0, 0.0, 1.0)
        ordered = which[np.lexsort((x[which], frames[which]))]
        all_x = x[ordered] if others is None else np.append(x[which], x[others])
        left, frame = float(all_x.min()), int(frames[ordered[0]])
        width = float(all_x.max()) - left + 2 * furthest + 1.0
        return cls(ordered, (frames[ordered] - frame) * width + (x[ordered] - left), frame, left, width)

    def keys(self, when: IntArray, x: FloatArray) -> FloatArray:
        """``(P,)`` keys of places in ``(P,)`` frames, which need not be among those of the boxes."""
        return np.asarray((when - self.frame) * self.width + (x - self.left))

    def between(self, low: FloatArray, high: FloatArray) -> tuple[IntArray, IntArray]:
        """``(P,)`` first places in ``ordered`` of boxes with keys from ``low`` to ``high``, and how many there are."""
        first = np.searchsorted(self.key, low)
        return first, np.maximum(np.searchsorted(self.key, high, side="right") - first, 0)


def ranges(first: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """The places of P ranges one after the other: ``(K,)`` which range each belongs to, and ``(K,)`` the place."""
    end = np.cumsum(count)
    place = np.arange(int(end[-1]) if len(end) else 0) + np.repeat(first - end + count, count)
    return np.repeat(np.arange(len(first)), count), place


def near_places(strips: Strips, places: FloatArray, tails: IntArray, when: IntArray, reach: FloatArray) -> Pairs:
    """``(P,)`` indices of others, and of the boxes of ``strips`` in given frames whose centres lie within their reach.

    Args:
        strips: by the centres' x.
        places: ``(2, N)`` x and y of the centres of all boxes.
        tails: ``(T,)`` indices of the others.
        when: ``(T,)`` frames.
        reach: ``(T, 2)`` in x and in y.
    """
    x, y = places
    target, (reach_x, reach_y) = strips.keys(when, x[tails]), reach.T
    tail, place = ranges(*strips.between(target - reach_x, target + reach_x))
    head = strips.ordered[place]
    near = np.flatnonzero(np.abs(y[head] - y[tails][tail]) <= reach_y[tail])
    return tails[tail[near]], head[near]


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


# Boxes of a frame beyond which it is dense.
DENSE = 400
# Boxes of a dense frame that each box is compared with, on average.
AROUND = 64
# Nearest boxes of a dense frame that each box keeps.
NEAREST = 8


def dense_reach(frames: IntArray, boxes: FloatArray) -> float | None:
    """Half the side of a square that holds `AROUND` boxes ``(N, 4)`` where ``(N,)`` frames are dense; or None."""
    crowd = int(np.bincount(frames - frames.min()).max()) if len(frames) else 0
    if crowd <= DENSE:
        return None
    middle = centres(boxes)
    return float(np.sqrt(AROUND * (middle.max(axis=0) - middle.min(axis=0)).prod() / (4 * crowd)))


def nearest(i: IntArray, j: IntArray, frames: IntArray, places: FloatArray) -> Pairs:
    """Of the pairs of a box with those of a frame, those with the `NEAREST`.

    Args:
        i: ``(P,)`` indices of the earlier boxes; pairs of one with others of one frame lie together.
        j: ``(P,)`` of the later ones.
        frames: ``(N,)``.
        places: ``(2, N)`` x and y of the centres.
    """
    first = np.flatnonzero(np.append(True, (np.diff(i) != 0) | (np.diff(frames[j]) != 0))[: len(i)])
    group = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(i))))
    (x, y) = places[:, j] - places[:, i]
    order = np.lexsort((np.square(x) + np.square(y), group))
    near = np.sort(order[np.arange(len(i)) - first[group] < NEAREST])
    return i[near], j[near]


def hidden_parts(frames: IntArray, boxes: FloatArray) -> FloatArray:
    """``(N,)`` share in [0, 1] of each of ``(N, 4)`` boxes in the image behind nearer boxes of its frame ``(N,)``."""
    hiding = Occluders.of(frames, boxes, None)
    return np.asarray(np.minimum(hiding.area(frames, *boxes.T) / sizes(boxes).prod(axis=1), 1))


@dataclass(frozen=True)
class Occluders:
    """What hides people: the boxes of all frames, and the borders of the image.

    Attributes:
        frames: ``(N,)`` increasing.
        columns: ``(4, N)`` x1, y1, x2, y2, pixels, where the image shows the boxes.
        strips: the boxes by frame and left edge.
        widest: width of the widest box.
        size: width and height of the image; None where it is not known.
    """

    frames: IntArray
    columns: FloatArray
    strips: Strips
    widest: float
    size: tuple[int, int] | None

    @classmethod
    def of(cls, frames: IntArray, boxes: FloatArray, size: tuple[int, int] | None) -> Occluders:
        """By ``(N, 4)`` boxes of ``(N,)`` increasing frames."""
        columns = boxes.T.copy()
        strips = Strips.of(frames, columns[0], np.arange(len(boxes)))
        return cls(frames, columns, strips, float((columns[2] - columns[0]).max(initial=0.0)), size)

    def between(self, tails: IntArray, heads: IntArray) -> FloatArray:
        """``(P,)`` share of a person hidden or outside the image in the middle of the gap from ``tails`` to
        ``heads``.
        """
        hidden = np.zeros(len(tails))
        apart = np.flatnonzero(self.frames[heads] - self.frames[tails] > 1)
        tail, head = tails[apart], heads[apart]
        since, until = self.frames[tail], self.frames[head]
        middle = (since + until) // 2
        share = (middle - since) / (until - since)
        x1, y1, x2, y2 = (column[tail] * (1 - share) + column[head] * share for column in self.columns)
        area = (x2 - x1) * (y2 - y1)
        lost = self.area(middle, x1, y1, x2, y2)
        if self.size is not None:
            width = np.minimum(x2, self.size[0]) - np.maximum(x1, 0)
            height = np.minimum(y2, self.size[1]) - np.maximum(y1, 0)
            lost += area - np.maximum(width, 0) * np.maximum(height, 0)
        hidden[apart] = np.minimum(lost / area, 1)
        return hidden

    def area(self, when: IntArray, x1: FloatArray, y1: FloatArray, x2: FloatArray, y2: FloatArray) -> FloatArray:
        """``(P,)`` area of ``(P,)`` boxes in given frames behind those of these whose lower edge is lower.

        A box overlaps only those whose left edge is left of its right edge, and not further left of its left edge than
        the widest box is wide.
        """
        strips = self.strips
        low = strips.keys(when, np.maximum(x1 - self.widest, strips.left)) - ROUNDING
        high = strips.keys(when, np.minimum(x2, strips.left + strips.width - 1)) + ROUNDING
        box, place = ranges(*strips.between(low, high))
        occluder = self.strips.ordered[place]
        other_x1, other_y1, other_x2, other_y2 = self.columns
        nearer = other_y2[occluder] > y2[box]
        nearer &= other_x2[occluder] > x1[box]
        nearer &= other_x1[occluder] < x2[box]
        covering = np.flatnonzero(nearer)
        box, occluder = box[covering], occluder[covering]
        width = np.minimum(x2[box], other_x2[occluder]) - np.maximum(x1[box], other_x1[occluder])
        height = y2[box] - np.maximum(y1[box], other_y1[occluder])
        return np.bincount(box, np.maximum(width, 0) * np.maximum(height, 0), len(when)).astype(np.float64)
