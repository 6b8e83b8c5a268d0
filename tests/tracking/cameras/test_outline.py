"""The outline of a sphere: its points look along tangents."""

import numpy as np
import pytest

from tsuiseki.tracking.cameras.outline import sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera

CAMERA = PinholeCamera.look_at(np.array([4.0, 0.0, 1.5]), np.array([0.0, 0.0, 1.0]), 693.0, 800, 600)


def gap_to_sphere(camera, pixels, centre):
    rays = camera.rays(pixels)
    return np.linalg.norm(np.cross(rays, centre - camera.position), axis=1)


@pytest.mark.parametrize("radius", [0.02, 0.1, 0.6])
def test_every_point_of_the_outline_looks_along_a_tangent(radius):
    centres = np.array([[0.0, 0.0, 1.0], [0.5, 1.4, 0.2], [2.4, -0.6, 1.9]])
    outlines = sphere_outlines(CAMERA, centres, radius)
    for k, centre in enumerate(centres):
        np.testing.assert_allclose(gap_to_sphere(CAMERA, outlines.points(24)[k], centre), radius, rtol=1e-9)


def test_on_the_axis_it_is_a_circle_and_off_the_axis_longer_away_from_it():
    ahead = CAMERA.position + 3 * CAMERA.rotation[2]
    aside = ahead + 1.5 * CAMERA.rotation[0]
    outlines = sphere_outlines(CAMERA, np.stack([ahead, aside]), 0.1)
    first, second = (np.linalg.norm(axis, axis=1) for axis in (outlines.first, outlines.second))
    expected = 693 * 0.1 / np.sqrt(3**2 - 0.1**2)
    np.testing.assert_allclose([first[0], second[0], second[1]], expected, rtol=1e-9)
    assert first[1] / second[1] == pytest.approx(np.sqrt((1.5**2 + 9 - 0.01) / (9 - 0.01)), rel=1e-9)


def test_a_distorting_lens_bends_it_and_the_ellipse_follows():
    lens = np.array([-0.25, 0.07, 0.001, -0.001, 0.0])
    camera = PinholeCamera(800, 600, CAMERA.focal, CAMERA.principal_point, CAMERA.rotation, CAMERA.position, lens)
    for centre in np.array([[0.5, 1.2, 0.4], [0.0, -1.4, 1.8]]):
        points = sphere_outlines(camera, centre[None], 0.1).points(24)[0]
        pixel = np.linalg.norm(centre - camera.position) / 693
        # k1 a^3 of the focal length is left, with half axis a = 0.1 / 4: 0.003 pixels.
        assert np.abs(gap_to_sphere(camera, points, centre) - 0.1).max() < 0.003 * pixel


def test_a_sphere_at_or_behind_the_camera_has_no_outline():
    behind = CAMERA.position - CAMERA.rotation[2]
    around = CAMERA.position + 0.05 * CAMERA.rotation[2]
    assert np.isnan(sphere_outlines(CAMERA, np.stack([behind, around]), 0.1).points(8)).all()
