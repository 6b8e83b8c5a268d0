"""Log-weights: sums, effective sample size and estimates against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.filters.resampling import (
    best_particle,
    circular_mean,
    effective_sample_size,
    log_sum,
    normalise,
    probabilities,
    weighted_covariance,
    weighted_mean,
)


def test_log_sum_survives_weights_that_underflow():
    assert log_sum(np.array([-2000.0, -2000.0])) == pytest.approx(-2000.0 + np.log(2.0))
    assert log_sum(np.array([-np.inf, -np.inf])) == -np.inf
    assert log_sum(np.empty(0)) == -np.inf


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_log_sum_refuses_what_is_no_weight(bad):
    with pytest.raises(ValueError, match="log-weights below infinity"):
        log_sum(np.array([0.0, bad]))


def test_normalise_sums_to_one_and_falls_back_to_equal_weights():
    assert np.exp(normalise(np.array([-1000.0, -1001.0, -np.inf]))).sum() == pytest.approx(1.0)
    np.testing.assert_allclose(probabilities(np.full(4, -np.inf)), 0.25)
    with pytest.raises(ValueError, match="at least one particle"):
        normalise(np.empty(0))


@pytest.mark.parametrize(("weights", "size"), [([1, 1, 1, 1], 4), ([1, 0, 0, 0], 1), ([3, 1], 1.6)])
def test_effective_sample_size(weights, size):
    with np.errstate(divide="ignore"):
        assert effective_sample_size(np.log(np.array(weights, dtype=float))) == pytest.approx(size)


def test_circular_mean_crosses_the_branch_cut():
    angles = np.array([np.pi - 0.1, -np.pi + 0.3])
    assert np.angle(np.exp(1j * (circular_mean(angles, np.ones(2)) - (np.pi + 0.1)))) == pytest.approx(0.0, abs=1e-12)


def test_moments_treat_circular_columns_on_the_circle():
    particles = np.array([[1.0, np.pi - 0.1], [3.0, -np.pi + 0.1]])
    log_weights = np.log([0.75, 0.25])
    mean = weighted_mean(particles, log_weights, circular=[1])
    # Direction of 0.75 and 0.25 unit vectors 0.2 apart about pi.
    assert mean == pytest.approx([1.5, np.pi - np.arctan(0.5 * np.tan(0.1))])
    covariance = weighted_covariance(particles, log_weights, circular=[1])
    assert covariance[0, 0] == pytest.approx(0.75)
    assert covariance[1, 1] == pytest.approx(0.75 * 0.05**2 + 0.25 * 0.15**2, rel=1e-2)  # sine is nearly its argument
    np.testing.assert_array_equal(best_particle(particles, log_weights), particles[0])
