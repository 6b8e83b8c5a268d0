"""Weighing in stages, for likelihoods much narrower than the cloud of particles.

Weighed at once, a narrow likelihood leaves one or two particles alive. In stages, only a share of it is applied first,
as large as the particles bear. They are resampled, spread by a kernel that keeps the mean and covariance (Liu and West,
"Combined parameter and state estimation in simulation-based filtering", 2001), and weighed by the rest.

How the likelihood grows with the share is an argument. A product of mixtures must not be raised to a power as a whole:
narrow peaks of single factors would win before the place where all factors agree is found.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tsuiseki.tracking.filters.particles.resampling import systematic
from tsuiseki.tracking.filters.particles.weights import effective_sample_size, normalise, probabilities
from tsuiseki.tracking.types import FloatArray

BISECTIONS = 10
SMALLEST_SHARE = 1e-4

Path = Callable[[float], FloatArray]
"""Log-likelihoods ``(N,)`` of the particles at a share in [0, 1]: a way from none (0) to all (1)."""


def bearable_share(path: Path, size: float, done: float = 0.0) -> float:
    """The largest share that, after ``done`` was applied, leaves an effective sample size of at least ``size``.

    Args:
        path: to the whole log-likelihood.
        size: in [1, N].
        done: share by which the particles were drawn already.
    """
    before = path(done)
    if _size(path(1.0) - before) >= size:
        return 1.0
    # The logarithm of what is added is bisected, for a narrow likelihood bears a small share only.
    low, high = np.log(SMALLEST_SHARE), np.log(1 - done)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        enough = _size(path(done + np.exp(middle)) - before) >= size
        low, high = (middle, high) if enough else (low, middle)
    return done + float(np.exp(low))


def drawn_and_spread(
    particles: FloatArray, log_weights: FloatArray, width: float, rng: np.random.Generator
) -> FloatArray:
    """Particles ``(N, D)`` drawn by ``log_weights`` ``(N,)`` and spread.

    Args:
        particles: ``(N, D)``.
        log_weights: ``(N,)``, not necessarily normalised.
        width: standard deviation of the kernel over that of the drawn particles, (0, 1).
        rng: random numbers.
    """
    drawn = particles[systematic(probabilities(log_weights), len(particles), rng)]
    mean = drawn.mean(axis=0)
    away = drawn - mean
    values, vectors = np.linalg.eigh(away.T @ away / len(drawn))
    noise = rng.standard_normal(drawn.shape) * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(mean + np.sqrt(1 - width**2) * away + width * noise @ vectors.T)


def _size(log_weights: FloatArray) -> float:
    return effective_sample_size(normalise(log_weights))
