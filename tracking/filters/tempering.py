"""Weighing in stages, for likelihoods much narrower than the cloud of particles.

Weighed at once, a narrow likelihood leaves one or two particles alive. In stages, a share of the log-likelihood that
keeps enough particles is applied first; those are drawn, spread by a kernel that keeps the cloud's mean and covariance
(Liu and West, "Combined parameter and state estimation in simulation-based filtering", 2001), and weighed by the rest.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.filters.resampling import systematic
from tsuiseki.tracking.filters.weights import effective_sample_size, normalise, probabilities
from tsuiseki.tracking.types import FloatArray, IntArray

BISECTIONS = 16


def bearable_share(log_likelihoods: FloatArray, size: float, most: float = 1.0) -> float:
    """The largest share, up to ``most``, of log-likelihoods ``(N,)`` with an effective sample size of ``size``."""
    if effective_sample_size(normalise(most * log_likelihoods)) >= size:
        return most
    low, high = 0.0, most
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        enough = effective_sample_size(normalise(middle * log_likelihoods)) >= size
        low, high = (middle, high) if enough else (low, middle)
    return low


def drawn_and_spread(
    particles: FloatArray, log_weights: FloatArray, width: float, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """Particles ``(N, D)`` drawn by ``log_weights`` ``(N,)`` and spread, and the ``(N,)`` index each was drawn from.

    Args:
        particles: ``(N, D)``.
        log_weights: ``(N,)``, not necessarily normalised.
        width: standard deviation of the kernel over that of the drawn particles, (0, 1).
        rng: random numbers.
    """
    chosen = systematic(probabilities(log_weights), len(particles), rng)
    drawn = particles[chosen]
    mean = drawn.mean(axis=0)
    away = drawn - mean
    values, vectors = np.linalg.eigh(away.T @ away / len(drawn))
    noise = rng.standard_normal(drawn.shape) * np.sqrt(np.maximum(values, 0.0))
    return mean + np.sqrt(1 - width**2) * away + width * noise @ vectors.T, chosen
