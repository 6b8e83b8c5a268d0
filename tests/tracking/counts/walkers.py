"""People who walk where a test says."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import Track

HEIGHT = 50.0


def walker(feet, number=1, frames=None, height=HEIGHT, observed=None):
    """A track of somebody whose feet are at ``(T, 2)`` places."""
    feet = np.asarray(feet, dtype=float)
    boxes = np.column_stack([feet[:, 0] - 10, feet[:, 1] - height, feet[:, 0] + 10, feet[:, 1]])
    numbers = np.arange(len(feet)) if frames is None else frames
    return Track(number, numbers, boxes, np.ones(len(feet)), np.ones(len(feet), bool) if observed is None else observed)


def down(x, ys):
    """Places one below the other."""
    return [(x, y) for y in ys]
