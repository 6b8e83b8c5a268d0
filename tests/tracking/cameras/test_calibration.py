"""Cameras from known points: exact data give the camera back, noise the stated uncertainty; bad sets are refused."""

import numpy as np
import pytest

from tsuiseki.tracking.cameras.calibration import (
    calibrate_camera,
    decompose,
    locate_camera,
    projection_matrix,
)
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError

CAMERA = PinholeCamera(
    800,
    600,
    np.array([700.0, 680.0]),
    np.array([410.0, 290.0]),
    PinholeCamera.look_at(np.array([4.0, 1.0, 1.5]), np.array([0.0, 0.0, 1.0]), 1.0, 2, 2, roll=0.2).rotation,
    np.array([4.0, 1.0, 1.5]),
)


def cloud(count, seed=0):
    points = np.random.default_rng(seed).uniform([-1, -1, 0], [1, 1, 2], (count, 3))
    return points, CAMERA.project(points)[0]


@pytest.mark.parametrize("count", [6, 7, 40])
def test_exact_points_give_the_matrix_and_the_camera_back(count):
    points, pixels = cloud(count)
    matrix = projection_matrix(points, pixels)
    np.testing.assert_allclose(matrix, CAMERA.matrix, rtol=1e-6, atol=1e-6)
    found = decompose(matrix, 800, 600)
    np.testing.assert_allclose(found.position, CAMERA.position, atol=1e-6)
    np.testing.assert_allclose(found.rotation, CAMERA.rotation, atol=1e-6)
    refined = calibrate_camera(points, pixels, 800, 600)
    np.testing.assert_allclose(refined.camera.focal, CAMERA.focal, rtol=1e-6)
    assert refined.residuals.shape == (count,)
    assert refined.root_mean_square < 1e-5


def test_refinement_lowers_the_error_and_states_its_uncertainty():
    away = []
    for seed in range(30):
        points, pixels = cloud(20, seed)
        pixels = pixels + np.random.default_rng(seed + 100).normal(0, 0.5, pixels.shape)
        found = calibrate_camera(points, pixels, 800, 600)
        plain = decompose(projection_matrix(points, pixels), 800, 600).project(points)[0]
        assert found.root_mean_square <= np.sqrt(np.square(plain - pixels).sum(axis=1).mean()) + 1e-9
        gap = found.camera.position - CAMERA.position
        away.append(gap @ np.linalg.solve(found.covariance, gap))
    # Chi-square with 3 degrees of freedom: mean 3, so the mean of 30 has a standard deviation of 0.45.
    assert 1.5 < np.mean(away) < 5.0


def test_known_intrinsics_place_a_distorting_camera_from_points_on_a_plane():
    lens = PinholeCamera(
        800, 600, CAMERA.focal, CAMERA.principal_point, distortion=np.array([-0.2, 0.05, 0.001, -0.001, 0.0])
    )
    true = PinholeCamera(800, 600, lens.focal, lens.principal_point, CAMERA.rotation, CAMERA.position, lens.distortion)
    points = np.random.default_rng(3).uniform([-1, -1, 0], [1, 1, 0], (10, 3))
    found = locate_camera(points, true.project(points)[0], lens)
    np.testing.assert_allclose(found.camera.position, true.position, atol=1e-5)
    assert found.root_mean_square < 1e-4


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda p, x: (p[:5], x[:5]), "at least 6 points"),
        (lambda p, x: (p * [1, 1, 0], x), "coplanar"),
        (lambda p, x: (p * [1, 0, 0], x), "collinear"),
        (lambda p, x: (np.repeat(p[:6], 2, axis=0)[:9], np.repeat(x[:6], 2, axis=0)[:9]), "degenerate"),
        (lambda p, x: (np.where(p > 9, p, np.nan), x), "finite"),
    ],
    ids=["five points", "one plane", "one line", "five different points", "not a number"],
)
def test_degenerate_sets_are_refused_with_the_reason(change, reason):
    with pytest.raises(RequestError, match=reason):
        calibrate_camera(*change(*cloud(12)), 800, 600)


def test_points_behind_the_camera_are_refused():
    points, _ = cloud(10)
    behind = 2 * CAMERA.position - points[:3]
    both = np.concatenate([points, behind])
    homogeneous = np.column_stack([both, np.ones(13)]) @ CAMERA.matrix.T
    with pytest.raises(RequestError, match="3 of 13 behind it"):
        projection_matrix(both, homogeneous[:, :2] / homogeneous[:, 2:])
