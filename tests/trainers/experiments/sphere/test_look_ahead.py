"""The local fit that stands beside the smoothed filter."""

import numpy as np

from tsuiseki.tracking.evaluation.space import acceleration
from tsuiseki.trainers.experiments.sphere.look_ahead import local_fit


def test_a_parabola_with_gaps_is_kept_and_gaps_stay():
    t = np.arange(60) * 0.04
    points = np.stack([t, 1 - t**2, 3 * t**2], axis=1)
    points[20:23] = np.nan
    fitted = local_fit(points, 6, 3, 2)
    np.testing.assert_allclose(fitted, points, atol=1e-9)


def test_a_window_of_one_kind_is_the_mean():
    points = np.random.default_rng(0).normal(size=(30, 3))
    np.testing.assert_allclose(local_fit(points, 2, 2, 0)[10], points[8:13].mean(axis=0))


def test_any_low_pass_halves_the_acceleration():
    rng, times = np.random.default_rng(1), np.arange(400) * 0.04
    path = np.stack([np.sin(times), np.cos(times), 0 * times], axis=1)
    noisy = path + 0.02 * rng.normal(size=path.shape)
    for behind, ahead in ((6, 0), (6, 6), (12, 12)):
        fitted = local_fit(noisy, behind, ahead, 1)
        assert acceleration(times, fitted, 0.04) < 0.5 * acceleration(times, noisy, 0.04)


def test_a_point_without_neighbours_stays():
    points = np.full((9, 3), np.nan)
    points[4] = 7.0
    np.testing.assert_array_equal(local_fit(points, 3, 3, 1), points)
