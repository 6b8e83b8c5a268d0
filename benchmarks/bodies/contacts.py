"""Two drawn animals that meet, for `animals.py`: how they walk, and what became of their identities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.tracking.types import FloatArray

MEETINGS = ("cross", "touch and part", "rest side by side and part")
FOUND = 12.0
"""A track is on an animal within so many pixels."""
ALONE = 30
"""Frames at either end of a film in which the two are apart."""
REST = 40
# Pixels from the middle line at the ends, and the share of their widths by which resting and touching bodies overlap.
APART, OVERLAP = 80.0, 0.3
LEFT, RIGHT, MIDDLE = 50.0, 270.0, 120.0


@dataclass(frozen=True)
class Contact:
    """What became of two identities.

    Attributes:
        outcome: both kept, exchanged, or one of them lost.
        away: errors of the place of both while they were in contact, pixels; of those that had a track.
    """

    outcome: Literal["kept", "exchanged", "lost"]
    away: FloatArray


def meeting(
    kind: str, lengths: tuple[float, float], frames: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """``(T, 2, 3)`` x, y, heading of two animals, and ``(2, 2)`` their lengths and widths."""
    sizes = np.array(lengths)[:, None] * rng.uniform(0.97, 1.03, (2, 1)) * [1.0, 0.4]
    time = np.linspace(0, 1, frames)
    if kind == MEETINGS[2]:
        moving = frames - REST
        time = np.concatenate([np.linspace(0, 0.5, moving // 2), np.full(REST, 0.5), np.linspace(0.5, 1, moving // 2)])
    along = 2 * time - 1
    # A hyperbola: they come as near as their widths less the overlap, and turn away.
    nearest = (1 - OVERLAP) * sizes[:, 1].mean() / 2 / APART
    away = along if kind == MEETINGS[0] else -np.sqrt(along**2 + nearest**2)
    sway = 4.0 * np.sin(2 * np.pi * (time + rng.uniform()))
    paths = np.empty((frames, 2, 3))
    for animal, side in enumerate((1.0, -1.0)):
        paths[:, animal, 0] = LEFT + (RIGHT - LEFT) * time + side * rng.uniform(0, 3)
        paths[:, animal, 1] = MIDDLE + side * APART * away + sway
    step = np.gradient(paths[..., :2], axis=0)
    walking = np.linalg.norm(step, axis=2) > 0.2
    headings = np.arctan2(step[..., 1], step[..., 0])
    for animal in range(2):
        # Who rests looks where it looked before.
        last = np.maximum.accumulate(np.where(walking[:, animal], np.arange(frames), 0))
        paths[:, animal, 2] = headings[last, animal]
    return paths, sizes


def compared(places: FloatArray, paths: FloatArray, sizes: FloatArray) -> Contact:
    """What ``(K, T, 2)`` places of tracks say of the identities of two animals."""
    gaps = np.linalg.norm(places[:, None] - np.moveaxis(paths[..., :2], 1, 0)[None], axis=3)
    gaps[~np.isfinite(gaps)] = np.inf
    before, after = (
        [_most(gaps[:, animal, part]) for animal in range(2)] for part in (slice(ALONE), slice(-ALONE, None))
    )
    touching = np.linalg.norm(paths[:, 0, :2] - paths[:, 1, :2], axis=1) < sizes[:, 0].mean()
    away = gaps[:, :, touching].min(axis=0).ravel() if len(gaps) else np.empty(0)
    outcome: Literal["kept", "exchanged", "lost"] = "lost"
    if None not in before and before[0] != before[1]:
        outcome = "kept" if after == before else "exchanged" if after == before[::-1] else "lost"
    return Contact(outcome, away[np.isfinite(away)])


def _most(gaps: FloatArray) -> int | None:
    """The track that is on an animal in most of the frames; None where it has none. ``gaps`` ``(K, T)`` in pixels."""
    if not len(gaps):
        return None
    on = np.where(gaps.min(axis=0) < FOUND, gaps.argmin(axis=0), -1)
    best = int(np.bincount(on + 1).argmax()) - 1
    return None if best < 0 else best
