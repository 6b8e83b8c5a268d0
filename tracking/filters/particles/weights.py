"""Log-weights of particles and what is read off them.

Contract: a log-weight array is ``(N,)`` float64 with values in [-inf, inf) and no NaN; ``-inf`` is a particle
that cannot be. Arrays need not be normalised unless a docstring says so.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.types import FloatArray


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
