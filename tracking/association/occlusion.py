"""How much of a box is hidden: by boxes nearer to the camera, or outside the image.

Of two people on the ground the one whose feet are lower in the image is nearer. Parts that several boxes hide count
once for each, up to the whole box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.association.nearby import Strips, centres, near_pairs, ranges, sizes
from tsuiseki.tracking.types import FloatArray, IntArray

# As many as the processor holds close by.
PAIRS_AT_ONCE = 8192


def hidden_parts(frames: IntArray, boxes: FloatArray) -> FloatArray:
    """``(N,)`` share of each box behind nearer boxes of its frame, in [0, 1].

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels, where the image shows them.
    """
    if len(boxes) == 0:
        return np.empty(0)
    every = np.arange(len(boxes))
    size = sizes(boxes)
    # Boxes overlap if their centres differ by less than their mean sizes.
    reach = (size + size.max(axis=0)) / 2
    i, j = near_pairs(frames, centres(boxes), reach, 0, every, every)
    return np.asarray(np.minimum(_overlaps(boxes, i, boxes, j) / size.prod(axis=1), 1))


def hidden_between(
    tails: IntArray, heads: IntArray, frames: IntArray, boxes: FloatArray, size: tuple[int, int] | None
) -> FloatArray:
    """``(P,)`` share of a person hidden or outside the image in the middle of the gap between two detections.

    Args:
        tails: ``(P,)`` indices of the earlier detections.
        heads: ``(P,)`` of the later ones.
        frames: ``(N,)`` increasing.
        boxes: ``(N, 4)`` pixels, where the image shows them.
        size: width and height of the image; None where it is not known.
    """
    return Hiding.of(frames, boxes, size).between(tails, heads)


@dataclass(frozen=True)
class Hiding:
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
    def of(cls, frames: IntArray, boxes: FloatArray, size: tuple[int, int] | None) -> Hiding:
        """By ``(N, 4)`` boxes of ``(N,)`` increasing frames."""
        columns = boxes.T.copy()
        strips = Strips.of(frames, columns[0], np.arange(len(boxes)))
        return cls(frames, columns, strips, float((columns[2] - columns[0]).max(initial=0.0)), size)

    def between(self, tails: IntArray, heads: IntArray) -> FloatArray:
        """``(P,)`` share of a person hidden in the middle of the gap between two boxes, see `hidden_between`."""
        hidden = np.zeros(len(tails))
        asked = np.flatnonzero(self.frames[heads] - self.frames[tails] > 1)
        for start in range(0, len(asked), PAIRS_AT_ONCE):
            part = asked[start : start + PAIRS_AT_ONCE]
            tail, head = tails[part], heads[part]
            since, until = self.frames[tail], self.frames[head]
            middle = (since + until) // 2
            share = (middle - since) / (until - since)
            x1, y1, x2, y2 = (column[tail] * (1 - share) + column[head] * share for column in self.columns)
            area = (x2 - x1) * (y2 - y1)
            lost = self._area(middle, x1, y1, x2, y2)
            if self.size is not None:
                width = np.minimum(x2, self.size[0]) - np.maximum(x1, 0)
                height = np.minimum(y2, self.size[1]) - np.maximum(y1, 0)
                lost += area - np.maximum(width, 0) * np.maximum(height, 0)
            hidden[part] = np.minimum(lost / area, 1)
        return hidden

    def _area(self, when: IntArray, x1: FloatArray, y1: FloatArray, x2: FloatArray, y2: FloatArray) -> FloatArray:
        """``(P,)`` area of ``(P,)`` boxes in given frames behind those of these whose lower edge is lower.

        A box overlaps only those whose left edge is left of its right edge, and not further left of its left edge than
        the widest box is wide.
        """
        box, place = ranges(*self.strips.between(when, x1 - self.widest, x2))
        other = self.strips.ordered[place]
        other_x1, other_y1, other_x2, other_y2 = self.columns
        nearer = other_y2[other] > y2[box]
        nearer &= other_x2[other] > x1[box]
        nearer &= other_x1[other] < x2[box]
        kept = np.flatnonzero(nearer)
        box, other = box[kept], other[kept]
        width = np.minimum(x2[box], other_x2[other]) - np.maximum(x1[box], other_x1[other])
        height = y2[box] - np.maximum(y1[box], other_y1[other])
        return np.bincount(box, np.maximum(width, 0) * np.maximum(height, 0), len(when)).astype(np.float64)


def _overlaps(boxes: FloatArray, i: IntArray, others: FloatArray, j: IntArray) -> FloatArray:
    """``(N,)`` area that each of ``boxes`` shares with those of ``others`` whose lower edge is lower."""
    nearer = (others[j, 3] > boxes[i, 3]) & (others[j, 2] > boxes[i, 0]) & (others[j, 0] < boxes[i, 2])
    i, j = i[nearer], j[nearer]
    corner = np.minimum(boxes[i, 2:], others[j, 2:]) - np.maximum(boxes[i, :2], others[j, :2])
    return np.bincount(i, _area(corner.clip(min=0)), len(boxes)).astype(np.float64)


def _area(size: FloatArray) -> FloatArray:
    """``(N,)`` products of ``(N, 2)`` widths and heights; a product along so short an axis is slow."""
    return np.asarray(size[:, 0] * size[:, 1])
