"""States of coloured regions: rectangles that remember where they were in the frame before, (63)."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.filters.base import Motion, each_frame
from tsuiseki.tracking.filters.finite_sets.labelled_particles import LabelledParticles, cluster_starts
from tsuiseki.tracking.types import FloatArray, IntArray

SMALLEST_SIDE = 3.0


def second_order(position: tuple[float, float], size: tuple[float, float], smallest: float = SMALLEST_SIDE) -> Motion:
    """Smooth motion (64)-(66), in frames: the position goes on by its last step, the size drifts.

    Args:
        position: standard deviations ``tau_x, tau_y`` in pixels.
        size: standard deviations ``tau_d, tau_h`` in pixels.
        smallest: least width and height in pixels. A box as small as a single spot of the colour has a greater
            ``p (1 - q)`` than the object around it.
    """
    deviation = np.array([*position, *size])

    def move(particles: FloatArray, rng: np.random.Generator) -> FloatArray:
        noise = deviation * rng.standard_normal((len(particles), 4))
        here, before = particles[:, :2], particles[:, 2:4]
        size = np.maximum(particles[:, 4:] + noise[:, 2:], smallest)
        return np.concatenate([2 * here - before + noise[:, :2], here, size], axis=1)

    return each_frame(move)


def boxes_of(states: FloatArray) -> FloatArray:
    """Boxes ``(N, 4)`` x1, y1, x2, y2 of states ``(N, 6)``."""
    half = states[:, 4:6] / 2
    return np.concatenate([states[:, :2] - half, states[:, :2] + half], axis=1)


def cluster_means(state: LabelledParticles) -> tuple[IntArray, FloatArray, FloatArray]:
    """Label, weight and mean state of each cluster."""
    starts = cluster_starts(state.labels)
    if len(starts) == 0:
        return np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 6))
    weights = np.exp(state.log_weights)
    masses = np.add.reduceat(weights, starts)
    sums = np.add.reduceat(weights[:, None] * state.particles, starts, axis=0)
    means = sums / np.maximum(masses, np.finfo(np.float64).tiny)[:, None]
    means[:, 4:] = np.maximum(means[:, 4:], SMALLEST_SIDE)
    return state.labels[starts], masses, means
