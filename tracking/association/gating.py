"""Which detections of different frames can be the same person at all.

The gate is deliberately wide: it only keeps the number of pairs linear in the length of the video. What a pair is
worth is decided by the costs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class GateSettings:
    """Limits of a plausible move between two detections.

    Attributes:
        window: largest gap in frames, at least 1; 1 links consecutive frames only.
        reach: distance of centres allowed at gap 1, in heights of the earlier box.
        speed: additional distance allowed for every further frame, in heights of the earlier box.
        size_ratio: the larger height over the smaller at most, at least 1.
    """

    window: int = 30
    reach: float = 0.5
    speed: float = 0.1
    size_ratio: float = 1.6

    def __post_init__(self) -> None:
        if self.window < 1:
            raise ValueError(f"expected a window of at least 1 frame, got {self.window}")
        if not (self.reach > 0 and self.speed >= 0 and self.size_ratio >= 1):
            raise ValueError(
                "expected reach > 0, speed >= 0 and size_ratio >= 1, "
                f"got {self.reach}, {self.speed} and {self.size_ratio}"
            )


def candidate_pairs(
    frames: IntArray, boxes: FloatArray, settings: GateSettings | None = None
) -> tuple[IntArray, IntArray, IntArray]:
    """Indices of all pairs of detections that lie within the gate.

    Args:
        frames: ``(N,)`` frame numbers, in any order.
        boxes: ``(N, 4)`` pixels.
        settings: the gate; by default that of ``GateSettings()``.

    Returns:
        ``(P,)`` arrays ``i``, ``j`` and ``gap`` with ``frames[j] - frames[i] == gap`` and ``1 <= gap <= window``,
        sorted by i, then by j's frame.
    """
    parts = list(pairs_by_gap(frames, boxes, settings or GateSettings()))
    if not parts:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.int64)
    gap = np.repeat([gap for _, _, gap in parts], [len(i) for i, _, _ in parts])
    i, j = np.concatenate([i for i, _, _ in parts]), np.concatenate([j for _, j, _ in parts])
    by_detection = np.lexsort((j, gap, i))
    return i[by_detection], j[by_detection], gap[by_detection]


def pairs_by_gap(
    frames: IntArray, boxes: FloatArray, settings: GateSettings
) -> Iterator[tuple[IntArray, IntArray, int]]:
    """The same pairs, one gap at a time, so that they can be priced and thinned out before the next come.

    Args:
        frames: ``(N,)`` frame numbers, in any order.
        boxes: ``(N, 4)`` pixels.
        settings: the gate.

    Yields:
        Arrays ``i`` and ``j`` of the pairs ``gap`` frames apart, and ``gap``, from 1 on.
    """
    if len(frames) == 0:
        return
    frames = np.asarray(frames, dtype=np.int64)
    x, y = (boxes[:, 0] + boxes[:, 2]) / 2, (boxes[:, 1] + boxes[:, 3]) / 2
    height = boxes[:, 3] - boxes[:, 1]
    order = np.lexsort((x, frames))
    frames, x, y, height = frames[order] - frames.min(), x[order], y[order], height[order]
    # One sorted key holds frame and x, so that a range of it is the strip of one frame within reach; the key of a
    # frame is wider than the strip, and no strip runs into the next frame.
    furthest = height.max() * (settings.reach + settings.speed * (settings.window - 1))
    x = x - x.min()
    width = x.max() + 2 * furthest + 1.0
    key = frames * width + x
    for gap in range(1, min(settings.window, int(frames[-1])) + 1):
        i, j = _pairs_at_gap(gap, key, width, x, y, height, settings)
        yield order[i], order[j], gap


def _pairs_at_gap(
    gap: int, key: FloatArray, width: float, x: FloatArray, y: FloatArray, height: FloatArray, settings: GateSettings
) -> tuple[IntArray, IntArray]:
    """Pairs within the gate at one gap, as positions in the order of the key."""
    reach = height * (settings.reach + settings.speed * (gap - 1))
    target = key + gap * width
    first = np.searchsorted(key, target - reach)
    count = np.searchsorted(key, target + reach, side="right") - first
    i = np.repeat(np.arange(len(key)), count)
    j = np.arange(len(i)) - np.repeat(np.cumsum(count) - count - first, count)
    ratio = height[j] / height[i]
    near = (x[j] - x[i]) ** 2 + (y[j] - y[i]) ** 2 <= reach[i] ** 2
    kept = near & (ratio <= settings.size_ratio) & (ratio >= 1 / settings.size_ratio)
    return i[kept], j[kept]
