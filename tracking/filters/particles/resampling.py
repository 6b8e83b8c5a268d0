"""Log-weights of particles and what is read off them.

Contract: a log-weight array is ``(N,)`` float64 with values in [-inf, inf) and no NaN; ``-inf`` is a particle
that cannot be. Arrays need not be normalised unless a docstring says so.

Resampling: which particles go on, and how often.

Contract of every resampler: ``resample(weights, count, rng)`` takes ``(N,)`` weights that are finite and not negative
(normalised or not, with a sum above zero) and returns ``(count,)`` int64 indices in ascending order. It is unbiased:
the expected number of copies of particle ``i`` is ``count * weights[i] / weights.sum()``. A particle of weight zero is
never drawn. Douc, Cappe and Moulines, "Comparison of resampling schemes for particle filtering" (2005), compares them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

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
    """Weights ``(N,)`` in [0, 1] that sum to one, equation (17) of the finite-sets paper.

    Raises:
        ValueError: as :func:`normalise`.
    """
    weights = np.exp(normalise(log_weights))
    return np.asarray(weights / weights.sum())


def effective_sample_size(log_weights: FloatArray) -> float:
    """How many equally weighted particles these are worth, in [1, N], equation (18) of the finite-sets paper."""
    return float(1.0 / np.sum(probabilities(log_weights) ** 2))


def circular_mean(angles: FloatArray, weights: FloatArray) -> float:
    """Direction of the weighted sum of unit vectors, radians in (-pi, pi].

    Args:
        angles: ``(N,)`` radians.
        weights: ``(N,)`` not negative.
    """
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
    """The particle ``(D,)`` of greatest weight, the first of equals."""
    best: FloatArray = particles[int(np.argmax(log_weights))].copy()
    return best


class Resampler(Protocol):
    """Draws ``count`` indices of particles in proportion to their weights."""

    def __call__(self, weights: FloatArray, count: int, rng: np.random.Generator) -> IntArray: ...


def multinomial(weights: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """Independent draws, equation (16) of the finite-sets paper."""
    copies = np.bincount(_index(_cumulative(weights), rng.random(count)), minlength=len(weights))
    return _repeat(copies)


def stratified(weights: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """One independent draw in each of ``count`` equal slices of the cumulative weight."""
    return _index(_cumulative(weights), (np.arange(count) + rng.random(count)) / max(count, 1))


def systematic(weights: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """One common offset in each of ``count`` equal slices: least variance of the copies of one particle.

    Slice ``k`` draws particle ``i`` when ``C[i-1] <= (k + u) / count < C[i]``, so the copies follow from rounding
    ``count * C - u`` up, with no search.
    """
    cumulative = _cumulative(weights)
    edges = np.ceil(count * cumulative - rng.random())
    # With an offset next to 1 the subtraction rounds to count - 1: the end of the scale is known exactly.
    edges[cumulative >= 1.0] = count
    np.maximum(edges, 0.0, out=edges)
    edges[1:] -= edges[:-1].copy()
    return _repeat(edges.astype(np.int64))


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


def residual(weights: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """The whole part of ``count * weight`` copies for certain, the rest by independent draws from the remainders."""
    expected = count * (weights / _total(weights))
    whole = np.floor(expected).astype(np.int64)
    remaining = count - int(whole.sum())
    if remaining > 0:
        rest = _index(_cumulative(expected - whole), rng.random(remaining))
        whole += np.bincount(rest, minlength=len(weights))
    return _repeat(whole)


def _total(weights: FloatArray) -> float:
    total = float(np.sum(weights)) if len(weights) else 0.0
    if not (np.isfinite(total) and total > 0.0) or np.min(weights) < 0.0:
        raise ValueError(f"expected finite weights >= 0 with a sum above zero, got {len(weights)} with sum {total}")
    return total


def _cumulative(weights: FloatArray) -> FloatArray:
    """Cumulative weights that end at exactly 1, whatever the rounding of the sum."""
    _total(weights)
    cumulative = np.cumsum(weights)
    return np.asarray(cumulative / cumulative[-1])


def _index(cumulative: FloatArray, positions: FloatArray) -> IntArray:
    """First particle whose cumulative weight exceeds each position; (count - 1 + u) / count may round to 1."""
    return np.searchsorted(cumulative, np.minimum(positions, np.nextafter(1.0, 0.0)), side="right").astype(np.int64)


def _repeat(copies: IntArray) -> IntArray:
    return np.repeat(np.arange(len(copies), dtype=np.int64), copies)
