"""Weights of particles: what is read off them, which particles go on, and weighing in stages or by several views.

A log-weight array is ``(N,)`` float64 with values in [-inf, inf) and no NaN; ``-inf`` is a particle that cannot be.
Arrays need not be normalised unless a docstring says so.

Resampling takes ``(N,)`` weights that are finite and not negative (normalised or not, with a sum above zero) and
returns ``(count,)`` int64 indices in ascending order. It is unbiased: the expected number of copies of particle ``i``
is ``count * weights[i] / weights.sum()``. A particle of weight zero is never drawn. Douc, Cappe and Moulines,
"Comparison of resampling schemes for particle filtering" (2005), compares schemes.

Stages are for likelihoods much narrower than the cloud of particles. Weighed at once, such a likelihood leaves one or
two particles alive. In stages, only a share of it is applied first, as large as the particles bear. They are resampled,
spread by a kernel that keeps the mean and covariance (Liu and West, "Combined parameter and state estimation in
simulation-based filtering", 2001), and weighed by the rest. How the likelihood grows with the share is an argument. A
product of mixtures must not be raised to a power as a whole: narrow peaks of single factors would win before the place
where all factors agree is found.

Of several views each may be covered. View c gives particle i a log-ratio l_ci: how likely its picture is if the target
is at the particle, over how likely it is if the view is covered. The view is open with probability v_c, so its weight
for the particle is ``v_c exp(l_ci) + 1 - v_c``. A view that speaks against all particles weighs them all alike, and
does not pull the estimate away. v_c follows a two-state Markov chain and is updated by Bayes' rule.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray


def log_sum(log_weights: FloatArray) -> float:
    """Logarithm of the sum of the weights; ``-inf`` for no particle or only impossible ones.

    Raises:
        ValueError: a log-weight is NaN or +inf.
    """
    if len(log_weights) == 0:
        return -np.inf
    largest = float(np.max(log_weights))
    if np.isnan(largest) or largest == np.inf:
        raise ValueError(f"expected log-weights below infinity and no NaN, got {largest}")
    if largest == -np.inf:
        return -np.inf
    return largest + float(np.log(np.sum(np.exp(log_weights - largest))))


def logarithms(weights: FloatArray) -> FloatArray:
    """Log-weights of weights >= 0, of any shape; ``-inf`` for zero."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(weights))


def normalise(log_weights: FloatArray) -> FloatArray:
    """Log-weights whose weights sum to one; equal ones where every particle was impossible.

    Raises:
        ValueError: there is no particle, or a log-weight is NaN or +inf.
    """
    if len(log_weights) == 0:
        raise ValueError("expected at least one particle, got none")
    total = log_sum(log_weights)
    if total == -np.inf:
        return np.full(len(log_weights), -np.log(len(log_weights)))
    return log_weights - total


def probabilities(log_weights: FloatArray) -> FloatArray:
    """Weights ``(N,)`` in [0, 1] that sum to one, Eq. (17) of the finite-sets paper.

    Raises:
        ValueError: as :func:`normalise`.
    """
    weights = np.exp(normalise(log_weights))
    return np.asarray(weights / weights.sum())


def effective_sample_size(log_weights: FloatArray) -> float:
    """How many equally weighted particles these are worth, in [1, N], Eq. (18) of the finite-sets paper."""
    return float(1.0 / np.sum(probabilities(log_weights) ** 2))


def circular_mean(angles: FloatArray, weights: FloatArray) -> float:
    """Direction of the sum of unit vectors at ``(N,)`` angles, weighted, radians in (-pi, pi]."""
    return float(np.arctan2(weights @ np.sin(angles), weights @ np.cos(angles)))


def weighted_mean(particles: FloatArray, log_weights: FloatArray, circular: Sequence[int] = ()) -> FloatArray:
    """Mean of the particles ``(N, D)`` as a ``(D,)`` state.

    Args:
        particles: ``(N, D)``.
        log_weights: ``(N,)``.
        circular: the columns that are angles in radians; their mean is taken on the circle.
    """
    weights = probabilities(log_weights)
    mean = np.asarray(weights @ particles, dtype=np.float64)
    for column in circular:
        mean[column] = circular_mean(particles[:, column], weights)
    return mean


def weighted_covariance(particles: FloatArray, log_weights: FloatArray, circular: Sequence[int] = ()) -> FloatArray:
    """Covariance ``(D, D)`` of particles ``(N, D)`` about their weighted mean, angles by their shortest difference."""
    difference = particles - weighted_mean(particles, log_weights, circular)
    for column in circular:
        difference[:, column] = np.angle(np.exp(1j * difference[:, column]))
    covariance: FloatArray = (probabilities(log_weights)[:, None] * difference).T @ difference
    return covariance


def best_particle(particles: FloatArray, log_weights: FloatArray) -> FloatArray:
    """The particle ``(D,)`` of greatest weight, Eq. (2.9) of the thesis; the first of equals."""
    best: FloatArray = particles[int(np.argmax(log_weights))].copy()
    return best


def systematic(weights: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """Draws of Eq. (16) by one common offset in each of ``count`` equal slices: least variance of a particle's copies.

    Slice ``k`` draws particle ``i`` when ``C[i-1] <= (k + u) / count < C[i]``, so the copies follow from rounding
    ``count * C - u`` up, with no search.
    """
    total = float(np.sum(weights)) if len(weights) else 0.0
    if not (np.isfinite(total) and total > 0.0) or np.min(weights) < 0.0:
        raise ValueError(f"expected finite weights >= 0 with a sum above zero, got {len(weights)} with sum {total}")
    drawn: IntArray = systematic_rows(weights[None], count, rng)[0]
    return drawn


def systematic_rows(weights: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """:func:`systematic` of each row of ``(T, N)`` weights with its own offset, as ``(T, count)`` columns."""
    rows, columns = weights.shape
    cumulative = np.cumsum(weights, axis=1)
    cumulative /= cumulative[:, -1:]
    edges = np.ceil(count * cumulative - rng.random((rows, 1))).astype(np.int64)
    # With an offset next to 1 the subtraction rounds to count - 1: the end of the scale is known exactly.
    edges[cumulative >= 1.0] = count
    copies = np.diff(np.maximum(edges, 0), axis=1, prepend=0)
    drawn: IntArray = np.repeat(np.tile(np.arange(columns, dtype=np.int64), rows), copies.ravel())
    return drawn.reshape(rows, count)


BISECTIONS = 10
"""Halvings of the range of a share."""
SMALLEST_SHARE = 1e-4
"""Least share that is added in a stage, so that every stage goes on."""

Path = Callable[[float], FloatArray]
"""Log-likelihoods ``(N,)`` of the particles at a share in [0, 1]: a way from none (0) to all (1)."""


def bearable_share(path: Path, size: float, done: float = 0.0) -> float:
    """The largest share that, after ``done`` was applied, leaves an effective sample size of at least ``size``.

    Args:
        path: to the whole log-likelihood.
        size: in [1, N].
        done: share by which the particles were drawn already.
    """
    applied = path(done)
    if effective_sample_size(path(1.0) - applied) >= size:
        return 1.0
    # The logarithm of what is added is bisected, for a narrow likelihood bears a small share only.
    low, high = np.log(SMALLEST_SHARE), np.log(1 - done)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        enough = effective_sample_size(path(done + np.exp(middle)) - applied) >= size
        low, high = (middle, high) if enough else (low, middle)
    return done + float(np.exp(low))


def drawn_and_spread(
    particles: FloatArray, log_weights: FloatArray, width: float, rng: np.random.Generator
) -> FloatArray:
    """Particles ``(N, D)`` drawn by ``log_weights`` ``(N,)``, normalised or not, and spread.

    The kernel's standard deviation is ``width`` times that of the drawn particles, in (0, 1).
    """
    drawn = particles[systematic(probabilities(log_weights), len(particles), rng)]
    mean = drawn.mean(axis=0)
    away = drawn - mean
    values, vectors = np.linalg.eigh(away.T @ away / len(drawn))
    noise = rng.standard_normal(drawn.shape) * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(mean + np.sqrt(1 - width**2) * away + width * noise @ vectors.T)


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
        steady = self.opens / total
        open_now = steady + (open_before - steady) * np.exp(-total * seconds)
        return np.asarray(np.clip(open_now, self.floor, 1 - self.floor))


def weigh_views(log_ratios: FloatArray, open_before: FloatArray) -> FloatArray:
    """``log(v_c exp(l_ci) + 1 - v_c)`` ``(N, C)`` for log-ratios ``(N, C)`` and ``(C,)`` probabilities in (0, 1)."""
    return np.logaddexp(np.log(open_before) + log_ratios, np.log1p(-open_before))


def open_after(log_ratios: FloatArray, open_before: FloatArray, weights: FloatArray) -> FloatArray:
    """v_c ``(C,)`` given what the views showed: the mean over particles, weighted after weighing, of Bayes' rule."""
    share = np.exp(np.log(open_before) + log_ratios - weigh_views(log_ratios, open_before))
    return np.asarray(weights @ share)
