"""Fixed-lag smoothing of a filter's means and covariances.

The backward pass of Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", 1965. It needs
the moments of a filter only, so it serves a particle filter whose motion is linear; unlike the particles' ancestors it
does not run out of distinct pasts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tsuiseki.tracking.types import FloatArray

LinearMotion = Callable[[float], tuple[FloatArray, FloatArray]]
"""Transition ``(D, D)`` and covariance of its noise ``(D, D)`` over some seconds."""


def smooth(
    times: FloatArray, means: FloatArray, covariances: FloatArray, motion: LinearMotion, lag: float
) -> tuple[FloatArray, FloatArray]:
    """Means and covariances of each state given what was seen up to ``lag`` seconds after it.

    Args:
        times: ``(T,)`` seconds, increasing.
        means: ``(T, D)`` of the filter.
        covariances: ``(T, D, D)`` of the filter.
        motion: between two times.
        lag: seconds.

    Returns:
        ``(T, D)`` and ``(T, D, D)``.
    """
    if len(times) < 2:
        return means.copy(), covariances.copy()
    steps = np.diff(times)
    found = {float(s): motion(float(s)) for s in np.unique(steps)}
    transitions, noises = (np.stack([found[float(s)][part] for s in steps]) for part in (0, 1))
    predicted = np.einsum("tij,tj->ti", transitions, means[:-1])
    spread = transitions @ covariances[:-1] @ transitions.transpose(0, 2, 1) + noises
    gains = covariances[:-1] @ transitions.transpose(0, 2, 1) @ np.linalg.inv(spread)
    last = np.searchsorted(times, times + lag + 1e-9, side="right") - 1
    smoothed, left = means[last].copy(), covariances[last].copy()
    # All states walk back from the end of their lag at once, one time at each round.
    for behind in range(int((last - np.arange(len(times))).max()), 0, -1):
        rows = np.flatnonzero(last - np.arange(len(times)) >= behind)
        at = rows + behind - 1
        smoothed[rows] = means[at] + np.einsum("tij,tj->ti", gains[at], smoothed[rows] - predicted[at])
        left[rows] = covariances[at] + gains[at] @ (left[rows] - spread[at]) @ gains[at].transpose(0, 2, 1)
    return smoothed, left
