"""Weighing in stages, for likelihoods much narrower than the cloud of particles.

Weighed at once, a narrow likelihood leaves one or two particles alive. In stages, only a share of it is applied first,
as large as the particles bear. They are resampled, spread by a kernel that keeps the mean and covariance (Liu and West,
"Combined parameter and state estimation in simulation-based filtering", 2001), and weighed by the rest.

How the likelihood grows with the share is an argument. A product of mixtures must not be raised to a power as a whole:
narrow peaks of single factors would win before the place where all factors agree is found.

Weighing particles by several views, each of which may be covered.

View c gives particle i a log-ratio l_ci: how likely its picture is if the target is at the particle, over how likely it
is if the view is covered. The view is open with probability v_c, so its weight for the particle is
``v_c exp(l_ci) + 1 - v_c``. A view that speaks against all particles weighs them all alike, and does not pull the
estimate away. v_c follows a two-state Markov chain and is updated by Bayes' rule.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.particles.resampling import effective_sample_size, normalise, probabilities, systematic
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


@dataclass(frozen=True)
class Covering:
    """How views get covered and free again.

    Attributes:
        covers: rate at which an open view is covered, 1/s.
        opens: rate at which a covered view opens, 1/s.
        floor: v_c stays in [floor, 1 - floor].
    """

    covers: float = 0.5
    opens: float = 1.5
    floor: float = 0.02

    def predict(self, open_before: FloatArray, seconds: float) -> FloatArray:
        """v_c after ``seconds`` without an observation, ``(C,)``."""
        total = self.covers + self.opens
        rest = self.opens / total
        after = rest + (open_before - rest) * np.exp(-total * seconds)
        return np.asarray(np.clip(after, self.floor, 1 - self.floor))


def weigh_views(log_ratios: FloatArray, open_before: FloatArray) -> FloatArray:
    """``log(v_c exp(l_ci) + 1 - v_c)`` ``(N, C)`` for log-ratios ``(N, C)`` and ``(C,)`` probabilities in (0, 1)."""
    return np.logaddexp(np.log(open_before) + log_ratios, np.log1p(-open_before))


def open_after(log_ratios: FloatArray, open_before: FloatArray, weights: FloatArray) -> FloatArray:
    """v_c ``(C,)`` given what the views showed: the mean over particles, weighted after weighing, of Bayes' rule."""
    share = np.exp(np.log(open_before) + log_ratios - weigh_views(log_ratios, open_before))
    return np.asarray(weights @ share)
