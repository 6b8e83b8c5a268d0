"""Lens distortion against OpenCV, and back."""

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cameras.projective import PinholeCamera, distort, largest_radius, undistort

LENSES = {
    "barrel": [-0.26, 0.075, -1e-4, 2e-4, -0.009],
    "pincushion": [0.18, -0.1, -0.001, -0.003, 0.05],
    "tangential": [0.0, 0.0, 0.004, -0.006, 0.0],
    "none": [0.0] * 5,
}


@pytest.fixture(params=LENSES)
def lens(request):
    return np.array(LENSES[request.param])


def test_distortion_is_opencvs(lens):
    points = np.random.default_rng(0).uniform(-0.7, 0.7, (50, 2))
    expected, _ = cv2.projectPoints(np.column_stack([points, np.ones(50)]), np.zeros(3), np.zeros(3), np.eye(3), lens)
    np.testing.assert_allclose(distort(points, lens), expected[:, 0], atol=1e-12)


def test_undistort_inverts_distort(lens):
    points = np.random.default_rng(1).uniform(-0.7, 0.7, (50, 2))
    np.testing.assert_allclose(undistort(distort(points, lens), lens), points, atol=1e-9)


def test_points_beyond_the_lens_do_not_fold_back_into_the_image():
    lens = np.array([-0.3, 0.0, 0.0, 0.0, 0.0])
    limit = largest_radius(lens)
    assert limit == pytest.approx(np.sqrt(1 / 0.9))
    assert np.isfinite(distort(np.array([[0.99 * limit, 0.0]]), lens)).all()
    assert np.isnan(distort(np.array([[1.01 * limit, 0.0]]), lens)).all()
    assert np.isnan(undistort(np.array([[limit, 0.0]]), lens)).all()


def test_a_distorting_camera_looks_back_along_its_own_projection(lens):
    camera = PinholeCamera(
        800, 600, np.array([700.0, 690.0]), np.array([410.0, 295.0]), np.eye(3), np.array([1.0, 2.0, 3.0]), lens
    )
    points = np.random.default_rng(2).uniform([-1.5, -1, 3], [1.5, 1, 6], (30, 3)) + camera.position
    pixels, depth = camera.project(points)
    along = camera.rays(pixels)
    np.testing.assert_allclose(along * (depth / along[:, 2])[:, None], points - camera.position, atol=1e-8)
