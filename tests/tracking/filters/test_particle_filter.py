"""Particle filters against the Kalman filter, which is exact on a linear Gaussian model."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.resampling import (
    weighted_covariance,
    weighted_mean,
)

TRANSITION = np.array([[1.0, 1.0], [0.0, 1.0]])
MEASURED = np.array([[1.0, 0.0]])
MOTION_NOISE = np.diag([0.3, 0.1])
NOISE = 0.5
START = np.diag([2.0, 1.0])
PARTICLES = 4000


def kalman(observations, motion_noise=MOTION_NOISE, noise=NOISE):
    """Posterior means and covariances at every step, and the log-evidence."""
    mean, covariance, total = np.zeros(2), START, 0.0
    means, covariances = [], []
    for y in observations:
        mean, covariance = TRANSITION @ mean, TRANSITION @ covariance @ TRANSITION.T + motion_noise
        spread = (MEASURED @ covariance @ MEASURED.T).item() + noise**2
        total += norm.logpdf(y, mean[0], np.sqrt(spread))
        gain = covariance @ MEASURED.T / spread
        mean = mean + gain[:, 0] * (y - mean[0])
        covariance = covariance - gain @ MEASURED @ covariance
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances), total


def simulate(steps, seed):
    rng = np.random.default_rng(seed)
    state = rng.multivariate_normal(np.zeros(2), START)
    observations = []
    for _ in range(steps):
        state = TRANSITION @ state + rng.multivariate_normal(np.zeros(2), MOTION_NOISE)
        observations.append(state[0] + NOISE * rng.standard_normal())
    return np.array(observations)


def motion(particles, seconds, rng):
    assert seconds == 1.0
    return particles @ TRANSITION.T + rng.standard_normal(particles.shape) * np.sqrt(np.diag(MOTION_NOISE))


def likelihood(particles, y):
    return norm.logpdf(y, particles[:, 0], NOISE)


def optimal(particles, y, rng):
    """The proposal p(x | previous, y); its correction makes the weight p(y | previous)."""
    predicted = particles @ TRANSITION.T
    spread = MOTION_NOISE[0, 0] + NOISE**2
    gain = MOTION_NOISE[:, :1] / spread
    mean = predicted + (y - predicted[:, :1]) @ gain.T
    covariance = MOTION_NOISE - gain @ MEASURED @ MOTION_NOISE
    moved = mean + rng.standard_normal(mean.shape) @ np.linalg.cholesky(covariance).T
    log_f = multivariate_normal.logpdf(moved - predicted, np.zeros(2), MOTION_NOISE)
    return moved, log_f - multivariate_normal.logpdf(moved - mean, np.zeros(2), covariance)


def run(particle_filter, observations, seed=0, count=PARTICLES):
    rng = np.random.default_rng(seed)
    state = particle_filter.init(rng.standard_normal((count, 2)) * np.sqrt(np.diag(START)))
    states, infos = [], []
    for y in observations:
        state, info = particle_filter.step(state, y, rng)
        states.append(state)
        infos.append(info)
    return states, infos


@pytest.mark.parametrize("proposal", [bootstrap(motion), optimal], ids=["bootstrap", "guided"])
def test_posterior_and_evidence_equal_kalman(proposal):
    observations = simulate(25, seed=4)
    means, covariances, evidence = kalman(observations)
    states, infos = run(ParticleFilter(proposal, likelihood), observations)
    # Standard error of a mean of as many particles as the weights are worth; five times, doubled for the dependence
    # that resampling leaves.
    worth = np.array([info.effective_sample_size for info in infos])
    tolerance = 10 * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2) / worth[:, None])
    found = np.array([weighted_mean(s.particles, s.log_weights) for s in states])
    assert np.all(np.abs(found - means) <= tolerance)
    last = weighted_covariance(states[-1].particles, states[-1].log_weights)
    np.testing.assert_allclose(last, covariances[-1], atol=10 * covariances[-1].max() / np.sqrt(worth[-1]))
    assert sum(info.log_evidence for info in infos) == pytest.approx(evidence, abs=0.3)
    assert any(info.resampled for info in infos)


@pytest.mark.parametrize("threshold", [0.0, 1.0], ids=["never", "always"])
def test_evidence_is_unbiased_with_and_without_resampling(threshold):
    observations = simulate(4, seed=5)
    _, _, evidence = kalman(observations)
    particle_filter = ParticleFilter(bootstrap(motion), likelihood, threshold=threshold)
    runs = [sum(i.log_evidence for i in run(particle_filter, observations, seed, 500)[1]) for seed in range(200)]
    ratios = np.exp(np.array(runs) - evidence)
    # The evidence, not its logarithm, is unbiased: five standard errors of the mean of 200 runs.
    assert abs(ratios.mean() - 1.0) <= 5 * ratios.std() / np.sqrt(200)
    assert ratios.std() < 0.5


def test_threshold_decides_when_particles_are_drawn_anew():
    observations = simulate(10, seed=6)
    _, never = run(ParticleFilter(bootstrap(motion), likelihood, threshold=0.0), observations, count=500)
    _, always = run(ParticleFilter(bootstrap(motion), likelihood, threshold=1.0), observations, count=500)
    assert not any(info.resampled for info in never)
    assert all(info.resampled for info in always[1:])
    assert not always[0].resampled


def test_guided_proposal_wastes_fewer_particles():
    observations = simulate(10, seed=7)
    _, blind = run(ParticleFilter(bootstrap(motion), likelihood, threshold=1.0), observations)
    _, guided = run(ParticleFilter(optimal, likelihood, threshold=1.0), observations)
    assert np.mean([i.effective_sample_size for i in guided]) > np.mean([i.effective_sample_size for i in blind])


def impossible_likelihood(particles, _):
    return np.full(len(particles), -np.inf)


def test_an_impossible_observation_keeps_the_prediction():
    particle_filter = ParticleFilter(bootstrap(motion), impossible_likelihood)
    state, info = particle_filter.step(particle_filter.init(np.zeros((10, 2))), 0.0, np.random.default_rng(0))
    assert info.log_evidence == -np.inf
    np.testing.assert_allclose(np.exp(state.log_weights), 0.1)


@pytest.mark.parametrize("particles", [np.empty((0, 2)), np.zeros(3), np.array([[np.nan, 0.0]])])
def test_init_refuses_broken_particles(particles):
    with pytest.raises(ValueError, match="finite particles"):
        ParticleFilter(bootstrap(motion), likelihood).init(particles)


def test_same_seed_same_particles():
    observations = simulate(5, seed=10)
    first, _ = run(ParticleFilter(bootstrap(motion), likelihood), observations, seed=3, count=100)
    second, _ = run(ParticleFilter(bootstrap(motion), likelihood), observations, seed=3, count=100)
    np.testing.assert_array_equal(first[-1].particles, second[-1].particles)
