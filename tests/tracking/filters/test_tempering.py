"""Weighing in stages: enough particles stay, the cloud keeps its moments, and the result is that of Bayes' rule."""

import numpy as np
import pytest

from tsuiseki.tracking.filters.resampling import (
    bearable_share,
    drawn_and_spread,
    effective_sample_size,
    normalise,
    probabilities,
)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_share_leaves_the_asked_sample_size_or_is_the_whole(scale):
    values = scale * np.random.default_rng(0).normal(size=500)
    share = bearable_share(lambda b: b * values, 100.0)
    left = effective_sample_size(normalise(share * values))
    # Normal values of scale 1 leave 500 / e; ten bisections fix the share to one percent.
    if scale <= 1:
        assert share == 1.0
    else:
        assert 100 <= left < 110


def test_spreading_keeps_mean_and_covariance():
    rng = np.random.default_rng(1)
    cloud = rng.normal(size=(20000, 3)) @ np.array([[1.0, 0.5, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.01]])
    spread = drawn_and_spread(cloud, np.zeros(len(cloud)), 0.6, rng)
    # The mean of 20,000 draws has a standard deviation of 0.7 % of theirs.
    np.testing.assert_allclose(spread.mean(axis=0), cloud.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(np.cov(spread.T), np.cov(cloud.T), atol=0.03)
    assert np.abs(spread - cloud).max() > 0.1


def test_two_stages_give_the_gaussian_posterior_that_one_stage_misses():
    prior, noise, seen = 1.0, 0.02, 0.8
    expected = seen * prior**2 / (prior**2 + noise**2)
    errors = {1: [], 2: []}
    for seed in range(40):
        rng = np.random.default_rng(seed)
        cloud = rng.normal(0, prior, (300, 1))
        values = -0.5 * ((cloud[:, 0] - seen) / noise) ** 2
        errors[1].append(probabilities(values) @ cloud[:, 0] - expected)
        share = bearable_share(lambda b, values=values: b * values, 30.0)
        cloud = drawn_and_spread(cloud, share * values, 0.6, rng)
        rest = (1 - share) * -0.5 * ((cloud[:, 0] - seen) / noise) ** 2
        errors[2].append(probabilities(rest) @ cloud[:, 0] - expected)
    once, staged = (float(np.std(errors[k])) for k in (1, 2))
    # 300 particles put 6 within two deviations of the peak, the second stage a fifth of the 300.
    assert staged < 0.5 * once
    assert abs(np.mean(errors[2])) < 0.1 * noise
