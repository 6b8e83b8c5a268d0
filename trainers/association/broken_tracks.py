"""Joins of labelled identity to learn from: tracks of labelled people that are broken on purpose.

The flow over detections bridges most gaps by itself, so a real sequence holds one labelled join or none. A tracklet of
a labelled person is therefore cut: all its detections within a gap are dropped, as if nobody had found the person
there. What is before and after the gap are two tracklets that belong together. Gaps are drawn more often where others
hide the person, as real ones are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.association.detection_tables import DetectionTable
from tsuiseki.tracking.association.nearby import hidden_parts
from tsuiseki.tracking.types import FloatArray, IntArray

# Chance of a gap at a detection that nobody hides, beside that of one that is hidden altogether.
SHOWN = 0.1


@dataclass(frozen=True)
class Breaks:
    """How tracks are broken.

    Attributes:
        copies: of a sequence, each with gaps of its own; 0 for none.
        every: seconds of a track that hold a gap on average.
        shortest: of a gap, seconds.
        longest: likewise; all lengths between are as likely on a logarithmic scale.
        seed: of the gaps.
    """

    copies: int = 0
    every: float = 4.0
    shortest: float = 0.4
    longest: float = 2.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.copies < 0 or self.every <= 0 or not 0 < self.shortest <= self.longest:
            raise ValueError("expected copies from 0, every above 0 and gaps above 0 seconds, the shortest first")


def broken(
    seen: DetectionTable, labels: IntArray, owners: IntArray, breaks: Breaks, rng: np.random.Generator
) -> tuple[IntArray, IntArray]:
    """Tracklets with gaps.

    Args:
        seen: the N detections.
        labels: ``(N,)`` tracklet of each from 0 on, -1 for none.
        owners: ``(M,)`` whose each tracklet is; only those of owners from 0 on are broken.
        breaks: how.
        rng: draws the gaps.

    Returns:
        ``(K,)`` indices of the detections that are left, and ``(K,)`` their tracklets, numbered from 0 on.
    """
    chance = SHOWN + hidden_parts(seen.frames, seen.image)
    kept, pieces, count = np.ones(len(seen), np.bool_), labels.copy(), 0
    for label, owner in enumerate(owners):
        mine = np.flatnonzero(labels == label)
        times = seen.frames[mine] / seen.frame_rate
        gaps = _gaps(times, chance[mine], breaks, rng) if owner >= 0 and len(mine) else np.empty((0, 2))
        inside = ((times[:, None] >= gaps[:, 0]) & (times[:, None] < gaps[:, 1])).any(axis=1)
        kept[mine[inside]] = False
        # A new piece begins where detections were dropped just before.
        pieces[mine] = count + np.cumsum(np.diff(inside.astype(np.int64), prepend=0) < 0)
        count = int(pieces[mine].max(initial=count - 1)) + 1
    left = np.flatnonzero(kept)
    found = np.full(count + 1, -1)
    used = np.unique(pieces[left][pieces[left] >= 0])
    found[used] = np.arange(len(used))
    return left, found[pieces[left]]


def _gaps(times: FloatArray, chance: FloatArray, breaks: Breaks, rng: np.random.Generator) -> FloatArray:
    """``(G, 2)`` beginnings and ends of gaps within a track, seconds; its first and last detections are kept."""
    inner = np.arange(1, len(times) - 1)
    if not len(inner):
        return np.empty((0, 2))
    count = rng.poisson((times[-1] - times[0]) / breaks.every)
    first = times[rng.choice(inner, count, p=chance[inner] / chance[inner].sum())]
    seconds = np.exp(rng.uniform(np.log(breaks.shortest), np.log(breaks.longest), count))
    return np.stack([first, np.minimum(first + seconds, times[-1])], axis=1)
