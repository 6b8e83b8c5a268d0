"""The smoother against the joint Gaussian of all states and measurements."""

import numpy as np
import pytest

from tsuiseki.tracking.filters.kalman import smooth
from tsuiseki.tracking.filters.motion.space import ConstantVelocity3D

TIMES = np.cumsum([0.0, 0.1, 0.1, 0.3, 0.1, 0.2, 0.1])
NOISE = 0.05
MOTION = ConstantVelocity3D(2.0)
SEES = np.eye(3, 6)


def joint(measured):
    """Mean ``(K, T * 6)`` and covariance of all states given the first k measurements, for k = 1 ... T."""
    count = len(TIMES)
    prior = np.zeros((6 * count, 6 * count))
    prior[:6, :6] = np.eye(6)
    for k in range(1, count):
        transition, noise = MOTION.linear(TIMES[k] - TIMES[k - 1])
        now, before = slice(6 * k, 6 * k + 6), slice(6 * k - 6, 6 * k)
        prior[now, : 6 * k] = transition @ prior[before, : 6 * k]
        prior[: 6 * k, now] = prior[now, : 6 * k].T
        prior[now, now] = transition @ prior[before, before] @ transition.T + noise
    found = []
    for k in range(1, count + 1):
        sees = np.kron(np.eye(k, count), SEES)
        gain = prior @ sees.T @ np.linalg.inv(sees @ prior @ sees.T + NOISE**2 * np.eye(3 * k))
        found.append((gain @ measured[:k].ravel(), prior - gain @ sees @ prior))
    return found


@pytest.mark.parametrize("lag", [0.0, 0.2, 0.35, 10.0])
def test_it_gives_the_conditional_of_the_joint_gaussian(lag):
    measured = np.random.default_rng(0).normal(size=(len(TIMES), 3))
    found = joint(measured)
    parts = [slice(6 * k, 6 * k + 6) for k in range(len(TIMES))]
    means = np.stack([found[k][0][p] for k, p in enumerate(parts)])
    covariances = np.stack([found[k][1][p, p] for k, p in enumerate(parts)])
    smoothed, left = smooth(TIMES, means, covariances, MOTION, lag)
    for k, part in enumerate(parts):
        last = int((TIMES[k] + lag + 1e-9 >= TIMES).sum()) - 1
        np.testing.assert_allclose(smoothed[k], found[last][0][part], atol=1e-9)
        np.testing.assert_allclose(left[k], found[last][1][part, part], atol=1e-9)


def test_one_state_is_its_own_smoothing():
    mean, covariance = smooth(np.zeros(1), np.ones((1, 6)), np.eye(6)[None], MOTION, 1.0)
    np.testing.assert_array_equal(mean, np.ones((1, 6)))
    np.testing.assert_array_equal(covariance, np.eye(6)[None])
