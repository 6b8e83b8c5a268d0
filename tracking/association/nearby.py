"""Pairs of boxes that lie near each other, by frame and place, without looking at all pairs."""

from __future__ import annotations

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
    x, furthest = centre[:, 0], float(reach[tails, 0].max())
    left = min(float(x[tails].min()), float(x[heads].min()))
    # One sorted key holds frame and x. A frame is wider than any strip, so no strip runs into the next frame.
    width = max(float(x[tails].max()), float(x[heads].max())) - left + 2 * furthest + 1.0
    ordered = heads[np.lexsort((x[heads], frames[heads]))]
    origin = int(frames[heads].min())
    key = (frames[ordered] - origin) * width + (x[ordered] - left)
    target = (frames[tails] + gap - origin) * width + (x[tails] - left)
    first = np.searchsorted(key, target - reach[tails, 0])
    count = np.searchsorted(key, target + reach[tails, 0], side="right") - first
    tail = np.repeat(tails, count)
    head = ordered[np.arange(len(tail)) - np.repeat(np.cumsum(count) - count - first, count)]
    near = np.abs(centre[head, 1] - centre[tail, 1]) <= reach[tail, 1]
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
