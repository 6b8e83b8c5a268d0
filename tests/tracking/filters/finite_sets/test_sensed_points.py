"""Motions and sensors in two and three dimensions against closed forms."""

import numpy as np
import pytest

from tsuiseki.tracking.filters.finite_sets.births import newborn
from tsuiseki.tracking.filters.finite_sets.pairs import find_pairs
from tsuiseki.tracking.filters.finite_sets.point_model import GaussianSensor, linear_sensor, polar_sensor
from tsuiseki.tracking.filters.point_motion import constant_velocity, coordinated_turn, straight, taking_turns


def test_in_two_dimensions_straight_is_the_motion_of_the_point_models():
    states = np.random.default_rng(0).standard_normal((50, 4))
    ours, theirs = (f(states, 0.7, np.random.default_rng(1)) for f in (straight(3.0, 2), constant_velocity(3.0)))
    np.testing.assert_allclose(ours, theirs)


def test_a_turn_keeps_the_speed_and_goes_straight_on_along_z():
    state = np.array([[0.0, 3.0, 0.0, 4.0, 1.0, 2.0, 0.3]])
    moved = coordinated_turn(0.0, 0.0, 3)(state, 2.0, np.random.default_rng(0))
    assert np.hypot(moved[0, 1], moved[0, 3]) == pytest.approx(5.0)
    assert np.arctan2(moved[0, 3], moved[0, 1]) - np.arctan2(4, 3) == pytest.approx(0.6)
    np.testing.assert_allclose(moved[0, 4:], [5.0, 2.0, 0.3])


@pytest.mark.parametrize("dimensions", [2, 3])
def test_polar_measurements_lead_back_to_the_place(dimensions):
    origin = np.arange(1.0, dimensions + 1)
    project, invert = polar_sensor(dimensions, origin)
    states = np.random.default_rng(2).uniform(-50, 50, (40, 2 * dimensions))
    np.testing.assert_allclose(invert(project(states)), states[:, ::2], atol=1e-9)
    north = np.zeros((1, 2 * dimensions))
    north[0, ::2] = origin + np.eye(dimensions)[1] * 7
    assert project(north)[0, 0] == pytest.approx(np.pi / 2)
    assert project(north)[0, -1] == pytest.approx(7.0)


def test_motions_take_turns_as_a_markov_chain():
    still, fast = straight(0.0, 2), straight(10.0, 2)
    move = taking_turns([still, fast], rate=0.5)
    particles = np.zeros((20000, 5))
    moved = move(particles, 1.0, np.random.default_rng(3))
    # Two modes: the chance of the other after t at rate r is (1 - exp(-2 r t)) / 2; four standard errors.
    expected = 0.5 * (1 - np.exp(-1.0))
    assert moved[:, -1].mean() == pytest.approx(expected, abs=4 * np.sqrt(0.25 / 20000))
    assert not moved[moved[:, -1] == 0, :4].any()
    assert moved[moved[:, -1] == 1, 1].std() == pytest.approx(10.0, rel=0.1)
    # The same law in two halves.
    halves = move(move(particles, 0.5, np.random.default_rng(4)), 0.5, np.random.default_rng(5))
    assert halves[:, -1].mean() == pytest.approx(expected, abs=4 * np.sqrt(0.25 / 20000))


def test_each_measurement_may_have_a_covariance_of_its_own():
    project, _ = linear_sensor(2, np.zeros(2))
    covariances = np.array([[[4.0, 1.0], [1.0, 9.0]], [[100.0, 0.0], [0.0, 25.0]]])
    sensor = GaussianSensor(project, np.ones(2)).of_scan(covariances)
    states, measurements = np.array([[1.0, 0, 2.0, 0]]), np.array([[0.0, 0.0], [3.0, -1.0]])
    pairs = find_pairs(states, np.array([0]), measurements, sensor)
    assert pairs.measurement.tolist() == [0, 1]
    for k, covariance in enumerate(covariances):
        away = measurements[k] - [1.0, 2.0]
        expected = -0.5 * away @ np.linalg.solve(covariance, away) - 0.5 * np.log(np.linalg.det(2 * np.pi * covariance))
        assert pairs.log_likelihood[k] == pytest.approx(expected)
    np.testing.assert_allclose(sensor.deviations(2), [[2.0, 3.0], [10.0, 5.0]])
    drawn = sensor.spread(np.random.default_rng(0).standard_normal((2, 40000, 2)))
    np.testing.assert_allclose(np.cov(drawn[0].T), covariances[0], rtol=0.05, atol=0.05)
    with pytest.raises(ValueError, match="positive definite"):
        sensor.of_scan(np.array([[[1.0, 2.0], [2.0, 1.0]]]))


def test_the_newborn_have_all_columns():
    _, invert = polar_sensor(3, np.zeros(3))
    complete = newborn(invert, 3, speed=2.0, turn=0.1, modes=3)
    states = complete(np.tile([0.5, 0.1, 100.0], (5000, 1)), np.random.default_rng(0))
    assert states.shape == (5000, 8)
    np.testing.assert_allclose(states[:, [1, 3, 5]].std(axis=0), 2.0, rtol=0.05)
    assert states[:, 6].std() == pytest.approx(0.1, rel=0.05)
    assert set(np.unique(states[:, 7])) == {0.0, 1.0, 2.0}
