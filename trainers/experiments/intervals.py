"""Intervals of means over clips or seeds."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import FloatArray


def paired_interval(first: FloatArray, second: FloatArray) -> tuple[float, float, float]:
    """Mean of ``first - second`` over paired seeds ``(S,)``, and its interval of 95 % by Student's t."""
    return interval(np.asarray(first, dtype=np.float64) - np.asarray(second, dtype=np.float64))


def interval(values: FloatArray) -> tuple[float, float, float]:
    """Mean of ``values`` ``(S,)`` and its interval of 95 % by Student's t; NaN ends for one value.

    >>> interval(np.array([1.0, 2.0, 3.0]))[0]
    2.0
    """
    from scipy.stats import t

    mean = float(np.mean(values))
    if len(values) < 2:
        return mean, float("nan"), float("nan")
    half = float(t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return mean, mean - half, mean + half
