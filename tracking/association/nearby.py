"""Pairs of boxes that lie near each other, by frame and place, without looking at all pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray

Pairs = tuple[IntArray, IntArray]


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
    return Strips.of(frames, centre, tails, heads, float(reach[tails, 0].max())).near(tails, reach[tails], gap)


@dataclass(frozen=True)
class Strips:
    """Boxes in the order of frame and x, so that those near a place follow each other.

    Attributes:
        centre: ``(N, 2)`` of all boxes, pixels.
        ordered: ``(H,)`` indices of the boxes that may be the later one.
        key: ``(H,)`` increasing: frame and x in one number.
        width: of a frame in it. A frame is wider than any strip, so no strip runs into the next frame.
        frame: ``(N,)`` of all boxes, counted from the first one in the key.
        x: ``(N,)`` of all boxes, counted from the leftmost one in the key.
    """

    centre: FloatArray
    ordered: IntArray
    key: FloatArray
    width: float
    frame: IntArray
    x: FloatArray

    @classmethod
    def of(cls, frames: IntArray, centre: FloatArray, tails: IntArray, heads: IntArray, furthest: float) -> Strips:
        """For boxes of which at least one may be the earlier, one the later, and no more than ``furthest`` in x."""
        x = centre[:, 0]
        left = min(float(x[tails].min()), float(x[heads].min()))
        width = max(float(x[tails].max()), float(x[heads].max())) - left + 2 * furthest + 1.0
        ordered = heads[np.lexsort((x[heads], frames[heads]))]
        frame, place = frames - int(frames[heads].min()), x - left
        return cls(centre, ordered, frame[ordered] * width + place[ordered], width, frame, place)

    def near(self, tails: IntArray, reach: FloatArray, gap: int | IntArray) -> Pairs:
        """As `near_pairs`, for ``(T, 2)`` reaches of the ``(T,)`` earlier boxes, and one gap or ``(T,)`` of them."""
        target = (self.frame[tails] + gap) * self.width + self.x[tails]
        first = np.searchsorted(self.key, target - reach[:, 0])
        count = np.searchsorted(self.key, target + reach[:, 0], side="right") - first
        tail = np.repeat(tails, count)
        head = self.ordered[np.arange(len(tail)) - np.repeat(np.cumsum(count) - count - first, count)]
        near = np.abs(self.centre[head, 1] - self.centre[tail, 1]) <= np.repeat(reach[:, 1], count)
        return tail[near], head[near]


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
