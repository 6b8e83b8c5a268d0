"""Motion in space: laws that do not depend on how the time is cut, and bounces that keep energy."""

import numpy as np
import pytest

from tsuiseki.tracking.filters.point_motion import Ballistic, ConstantVelocity3D, RandomWalk3D

MANY = 40000


@pytest.mark.parametrize(
    "motion",
    [RandomWalk3D(0.3), ConstantVelocity3D(0.7)],
    ids=["walk", "velocity"],
)
def test_one_long_step_has_the_law_of_several_short_ones(motion):
    start = np.zeros((MANY, 6))
    start[:, 3:] = 0.0 if isinstance(motion, RandomWalk3D) else 0.5
    long = motion(start, 0.6, np.random.default_rng(0))
    short = start
    rng = np.random.default_rng(1)
    for seconds in (0.1, 0.2, 0.3):
        short = motion(short, seconds, rng)
    # 40000 draws fix a mean to 0.5 % and a covariance to about 1 % of the variance.
    np.testing.assert_allclose(long.mean(axis=0), short.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(np.cov(long.T), np.cov(short.T), atol=0.03 * np.cov(long.T).max())


def test_the_spread_is_the_stated_one():
    walk = RandomWalk3D(0.3)(np.zeros((MANY, 6)), 4.0, np.random.default_rng(2))
    np.testing.assert_allclose(walk[:, :3].std(axis=0), 0.6, rtol=0.02)
    assert (walk[:, 3:] == 0).all()
    flight = ConstantVelocity3D(0.7)(np.zeros((MANY, 6)), 4.0, np.random.default_rng(3))
    np.testing.assert_allclose(flight[:, 3:].std(axis=0), 1.4, rtol=0.02)
    np.testing.assert_allclose(flight[:, :3].std(axis=0), 0.7 * np.sqrt(4.0**3 / 3), rtol=0.02)


def test_the_law_of_constant_velocity_is_that_of_white_noise_acceleration():
    start, seconds = np.array([0.1, 0.2, 0.3, 1.0, -2.0, 0.5]), 0.6
    transition = np.kron(np.array([[1.0, seconds], [0.0, 1.0]]), np.eye(3))
    shape = np.array([[seconds**3 / 3, seconds**2 / 2], [seconds**2 / 2, seconds]])
    noise = 0.7**2 * np.kron(shape, np.eye(3))
    drawn = ConstantVelocity3D(0.7)(np.tile(start, (MANY, 1)), seconds, np.random.default_rng(4))
    np.testing.assert_allclose(drawn.mean(axis=0), transition @ start, atol=0.02)
    np.testing.assert_allclose(np.cov(drawn.T), noise, atol=0.03 * noise.max())


def dropped(motion, seconds, height=1.1):
    state = np.array([[0.0, 0.0, height, 0.3, 0.0, 0.0]])
    rng = np.random.default_rng(0)
    heights = []
    for _ in range(round(3.0 / seconds)):
        state = motion(state, seconds, rng)
        heights.append(state[0, 2])
    return np.array(heights)


def test_free_fall_and_bounce_follow_the_closed_form():
    motion = Ballistic(0.1, restitution=0.8, agitation=1e-9)
    heights = dropped(motion, 0.01)
    fall = np.sqrt(2 * 1.0 / 9.81)
    times = 0.01 * np.arange(1, 301)
    np.testing.assert_allclose(heights[times < fall], 1.1 - 0.5 * 9.81 * times[times < fall] ** 2, atol=1e-9)
    first = heights[(times > fall) & (times < fall * (1 + 2 * 0.8))]
    # A ball that bounces with 0.8 of its speed comes back to 0.64 of the height of the fall.
    assert first.max() == pytest.approx(0.1 + 0.64, abs=1e-3)


def test_the_bounce_does_not_depend_on_how_the_time_is_cut():
    motion = Ballistic(0.1, restitution=0.8, agitation=1e-9)
    np.testing.assert_allclose(dropped(motion, 0.03)[:40], dropped(motion, 0.01)[2::3][:40], atol=2e-3)


def test_a_ball_at_rest_stays_on_the_floor():
    state = np.array([[0.0, 0.0, 0.6, 0.0, 0.0, 0.0]])
    motion = Ballistic(0.1, floor=0.5, agitation=1e-9)
    for _ in range(50):
        state = motion(state, 0.04, np.random.default_rng(0))
    assert state[0, 2] == pytest.approx(0.6, abs=0.02)


def test_air_and_spin_bend_a_flight_as_their_equations_say():
    start = np.array([[0.0, 0.0, 50.0, 20.0, 0.0, 0.0]])
    plain = Ballistic(0.0, agitation=1e-9)
    thrown = Ballistic(0.0, agitation=1e-9, drag=0.02, spin=(0.0, 0.0, 0.5))
    states, free = start, start
    rng = np.random.default_rng(0)
    for _ in range(200):
        states, free = thrown(states, 0.005, rng), plain(free, 0.005, rng)
    # Integrated by SciPy to ten digits.
    from scipy.integrate import solve_ivp

    def change(_, y):
        v = y[3:]
        return np.concatenate([v, np.cross([0, 0, 0.5], v) - 0.02 * np.linalg.norm(v) * v - [0, 0, 9.81]])

    exact = solve_ivp(change, (0, 1), start[0], rtol=1e-10, atol=1e-10).y[:, -1]
    np.testing.assert_allclose(states[0], exact, atol=0.05)
    assert np.linalg.norm(states[0, :3] - free[0, :3]) > 2
