"""Sudden turns, by the definition of section 5, from exact states."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray

SUDDEN_ANGLE = np.deg2rad(60.0)
WITHIN_FRAMES = 4


def sudden_turns(centres: FloatArray, least_step: float = 3.0) -> BoolArray:
    """Frames ``(T,)`` by which the direction of motion has turned by over 60 degrees within 4 frames.

    The direction in frame ``t`` is that of the step from ``t - 1``. A fish that hangs still or sways has no direction,
    so both steps must be long enough.

    Args:
        centres: ``(T, 2)`` of one body, pixels; further columns are ignored.
        least_step: pixels a frame.
    """
    steps = np.diff(centres[:, :2], axis=0)
    direction = np.arctan2(steps[:, 1], steps[:, 0])
    moving = np.linalg.norm(steps, axis=1) >= least_step
    turned = np.zeros(len(centres), dtype=np.bool_)
    for lag in range(1, min(WITHIN_FRAMES, len(steps) - 1) + 1):
        change = np.abs(np.angle(np.exp(1j * (direction[lag:] - direction[:-lag]))))
        turned[1 + lag :] |= (change > SUDDEN_ANGLE) & moving[lag:] & moving[:-lag]
    return turned


def count_sudden_turns(centres: FloatArray, least_step: float = 3.0) -> int:
    """How many turns :func:`sudden_turns` finds; frames that follow each other are one turn.

    >>> way = np.cumsum([[5.0, 0]] * 9 + [[0, 5.0]] * 9, axis=0)
    >>> count_sudden_turns(way)
    1
    """
    turned = sudden_turns(centres, least_step)
    return int(turned[0]) + int(np.count_nonzero(turned[1:] & ~turned[:-1]))
