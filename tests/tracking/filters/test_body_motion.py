"""Motions of bodies (8), (9), (16)-(18) against their equations, with the noise known."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.filters.body_motion import (
    BodyFixedVelocity,
    ConstantVelocity,
    Noise,
    RandomWalk,
    conditions,
    turned,
)

STATES = np.array([[100.0, 50.0, 0.3, -0.2], [20.0, 80.0, -3.0, 0.4], [0.0, 0.0, 3.1, 0.0]])
STILL = Noise(np.zeros(4), np.zeros((4, 4)))
FORWARD = Noise(np.array([5.0, 1.0]), np.zeros((2, 2)))


def rng():
    return np.random.default_rng(0)


def test_random_walk_adds_noise_and_nothing_else():
    noise = Noise.independent(np.array([1.0, -2.0, 0.1, 0.0]), np.array([3.0, 1.0, 0.2, 0.4]))
    many = np.repeat(STATES[:1], 40_000, axis=0)
    moved = RandomWalk(noise)(many, 1, rng()) - STATES[0]
    # Five standard errors.
    np.testing.assert_allclose(moved.mean(axis=0), noise.mean, atol=5 * 3.0 / 200)
    np.testing.assert_allclose(np.cov(moved.T), np.diag(noise.deviation**2), atol=5 * 9.0 * np.sqrt(2) / 200)
    np.testing.assert_allclose(RandomWalk(noise).moved(STATES, noise.mean), STATES + noise.mean)


def test_constant_velocity_goes_straight_whatever_the_heading():
    motion = ConstantVelocity(STILL, FORWARD)
    particles = motion.start(STATES, rng())
    step = turned(np.tile([5.0, 1.0], (3, 1)), STATES[:, 2])
    for count in range(1, 4):
        particles = motion(particles, 1, rng())
        np.testing.assert_allclose(particles[:, :2], STATES[:, :2] + count * step)
    np.testing.assert_allclose(particles[:, 2:4], STATES[:, 2:])


def test_constant_velocity_is_the_difference_of_the_positions():
    noise = Noise.independent(np.zeros(4), np.array([2.0, 2.0, 0.1, 0.1]))
    motion = ConstantVelocity(noise, FORWARD)
    before = motion.start(STATES, rng())
    after = motion(before, 1, rng())
    np.testing.assert_allclose(after[:, -2:], after[:, :2] - before[:, :2])


def test_body_fixed_velocity_turns_with_the_body():
    # A turn of 0.1 a frame at constant body-fixed velocity is a circle whose chord is the speed.
    motion = BodyFixedVelocity(Noise(np.array([0, 0, 0.1, 0]), np.zeros((4, 4))), FORWARD)
    particles = motion.start(STATES, rng())
    way = [particles[:, :2]]
    for _ in range(63):
        particles = motion(particles, 1, rng())
        way.append(particles[:, :2])
    way = np.array(way)
    radius = np.hypot(5.0, 1.0) / (2 * np.sin(0.05))
    centre = way[:63].mean(axis=0)  # 62.8 frames are a full circle
    np.testing.assert_allclose(np.linalg.norm(way - centre, axis=2), radius, rtol=0.02)


def test_body_fixed_step_is_equations_16_and_17():
    covariance = np.diag([4.0, 1.0, 0.04, 0.09])
    covariance[1, 2] = covariance[2, 1] = -0.1
    noise = Noise(np.array([0.5, 0.0, 0.02, -0.01]), np.linalg.cholesky(covariance))
    motion = BodyFixedVelocity(noise, FORWARD)
    before = motion.start(np.repeat(STATES[1:2], 20_000, axis=0), rng())
    after = motion(before, 1, rng())
    delta = after[:, 4:] - before[:, 4:]  # the rates of heading and shape start at 0
    np.testing.assert_allclose(after[:, 2:4], before[:, 2:4] + after[:, 6:])
    heading = after[:, 2]
    step = after[:, :2] - before[:, :2]
    np.testing.assert_allclose(step[:, 0], np.cos(heading) * after[:, 4] - np.sin(heading) * after[:, 5])
    np.testing.assert_allclose(step[:, 1], np.sin(heading) * after[:, 4] + np.cos(heading) * after[:, 5])
    np.testing.assert_allclose(delta.mean(axis=0), noise.mean, atol=5 * 2.0 / np.sqrt(20_000))
    np.testing.assert_allclose(np.cov(delta.T), covariance, atol=5 * 4.0 * np.sqrt(2 / 20_000))


def test_gain_moves_the_expected_increment():
    gain = np.zeros((4, 6))
    gain[2, 2] = 0.05  # turning by speed times bend
    gain[3, 5] = 0.9  # the bend goes on
    motion = BodyFixedVelocity(STILL, FORWARD, gain)
    particles = motion.start(STATES, rng())
    particles[:, 7] = 0.3
    moved = motion.moved(particles, np.zeros((3, 4)))
    np.testing.assert_allclose(moved[:, 2], STATES[:, 2] + 0.05 * 5.0 * STATES[:, 3])
    np.testing.assert_allclose(moved[:, 3], STATES[:, 3] + 0.9 * 0.3)
    assert conditions(particles[:, :4], particles[:, 4:]).shape == (3, 6)


def test_noise_without_correlation_keeps_the_variances():
    factor = np.array([[2.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 0.5, 0.3]])
    noise = Noise(np.ones(3), factor)
    apart = noise.without_correlation()
    np.testing.assert_allclose(apart.factor @ apart.factor.T, np.diag(np.diag(factor @ factor.T)))
    np.testing.assert_allclose(apart.mean, noise.mean)
    np.testing.assert_allclose(noise.widened(1.5).deviation, 1.5 * noise.deviation)


@pytest.mark.parametrize("angle", [0.0, 1.0, -3.0, np.pi])
def test_turning_there_and_back(angle):
    vectors = np.random.default_rng(1).normal(size=(5, 2))
    angles = np.full(5, angle)
    np.testing.assert_allclose(turned(turned(vectors, angles), -angles), vectors)
    np.testing.assert_allclose(turned(np.array([[1.0, 0.0]]), angles[:1]), [[np.cos(angle), np.sin(angle)]])
