"""Points from several cameras."""

import numpy as np
import pytest

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.sphere.points import triangulate

CAMERAS = [
    PinholeCamera.look_at(np.array(place), np.array([0.0, 0.0, 1.0]), 700.0, 800, 600)
    for place in ([4.0, 0.0, 1.5], [0.0, 4.0, 2.0], [-3.0, -3.0, 1.0])
]


def seen(points, cameras=CAMERAS):
    return np.stack([c.project(points)[0] for c in cameras], axis=1)


def test_exact_pixels_give_the_points_back():
    points = np.random.default_rng(0).uniform([-1, -1, 0], [1, 1, 2], (20, 3))
    found, covariance = triangulate(CAMERAS, seen(points))
    np.testing.assert_allclose(found, points, atol=1e-9)
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_covariance_is_that_of_repeated_measurements():
    point = np.array([[0.3, -0.2, 1.2]])
    noise = np.random.default_rng(1).normal(0, 0.8, (4000, 2, 2))
    found, covariance = triangulate(CAMERAS[:2], seen(point, CAMERAS[:2]) + noise, sigma=0.8)
    # 4000 draws fix each entry to a few percent of the largest one.
    np.testing.assert_allclose(np.cov(found.T), covariance[0], atol=0.08 * covariance[0].max())


def test_what_cannot_be_triangulated_is_nan():
    points = np.tile([0.0, 0.0, 1.0], (4, 1))
    pixels = seen(points)
    pixels[0, 1:] = np.nan
    pixels[1] = np.nan
    pixels[2, 2] = np.nan
    found, covariance = triangulate(CAMERAS, pixels)
    assert np.isnan(found[:2]).all()
    assert np.isnan(covariance[:2]).all()
    np.testing.assert_allclose(found[2:], points[2:], atol=1e-9)


def test_parallel_rays_and_points_behind_a_camera_are_nan():
    middle = np.array([[[400.0, 300.0], [400.0, 300.0]]])
    same = PinholeCamera(
        800,
        600,
        np.full(2, 700.0),
        np.array([400.0, 300.0]),
        CAMERAS[0].rotation,
        CAMERAS[0].position + CAMERAS[0].rotation[0],
    )
    assert np.isnan(triangulate([CAMERAS[0], same], middle)[0]).all()
    apart = np.array([[[300.0, 300.0], [500.0, 300.0]]])
    assert np.isnan(triangulate([CAMERAS[0], same], apart)[0]).all()


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match=r"\(N, 3, 2\)"):
        triangulate(CAMERAS, np.zeros((5, 2, 2)))
