"""The contour likelihood as printed: the plain sum, written out."""

import numpy as np
import pytest

from tsuiseki.tracking.cameras.outline import sphere_circles, sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.sphere.views import ContourSettings, PrintedContourLikelihood

CAMERA = PinholeCamera.look_at(np.array([3.0, 0.0, 1.2]), np.array([0.0, 0.0, 1.0]), 300.0, 320, 240)
BALL = np.array([0.1, 0.4, 0.9])
RADIUS = 0.1


def disk(value=200):
    """A disk exactly where the circle of `sphere_circles` is, on a bare wall."""
    outline = sphere_circles(CAMERA, BALL[None], RADIUS)
    y, x = np.mgrid[:240, :320] + 0.5
    inside = np.hypot(x - outline.centre[0, 0], y - outline.centre[0, 1]) < outline.first[0, 0]
    return np.where(inside[..., None], value, 100).astype(np.uint8).repeat(3, axis=2)


def test_the_sum_is_that_of_the_paper_written_out():
    image, settings = disk(), ContourSettings(angles=16, radii=11)
    centre = BALL + np.array([0.0, 0.02, -0.01])
    (found,) = PrintedContourLikelihood([CAMERA], RADIUS, settings)(centre[None], [image])[:, 0]
    outline = sphere_circles(CAMERA, centre[None], RADIUS)
    total = 0.0
    shares = np.linspace(0.5, 1.5, 11)
    for angle in np.arange(16) * 2 * np.pi / 16:
        ray = outline.centre[0] + shares[:, None] * outline.first[0, 0] * [np.cos(angle), np.sin(angle)]
        left, top = np.floor(ray - 0.5).astype(int).T
        fx, fy = (ray - 0.5 - np.stack([left, top], axis=1)).T
        grey = image[:, :, 0].astype(float)
        values = (
            grey[top, left] * (1 - fx) * (1 - fy) + grey[top, left + 1] * fx * (1 - fy)
            + grey[top + 1, left] * (1 - fx) * fy + grey[top + 1, left + 1] * fx * fy
        )  # fmt: skip
        middles = (shares[1:] + shares[:-1]) / 2
        total += 3 * np.sum(np.exp(-0.5 * ((middles - 1) / settings.width) ** 2) * np.abs(np.diff(values)))
    # OpenCV interpolates in steps of 1/32 pixel and rounds to grey levels.
    assert np.exp(found) == pytest.approx(total, rel=0.03)


def test_a_stronger_edge_counts_in_proportion_and_a_lamp_outweighs_a_ball():
    settings = ContourSettings()
    weak, strong = (
        PrintedContourLikelihood([CAMERA], RADIUS, settings)(BALL[None], [disk(v)])[0, 0] for v in (120, 180)
    )
    assert np.exp(strong - weak) == pytest.approx(4.0, rel=0.02)


def test_cameras_are_multiplied_and_an_empty_view_says_nothing():
    two = PrintedContourLikelihood([CAMERA, CAMERA], RADIUS)
    ratios = two(BALL[None], [disk(), None])
    assert ratios[0, 1] == 0.0
    np.testing.assert_allclose(two(BALL[None], [disk(), disk()]).sum(), 2 * ratios[0, 0])
    fourth = PrintedContourLikelihood([CAMERA, CAMERA], RADIUS, power=4.0)
    np.testing.assert_allclose(fourth(BALL[None], [disk(), None]), 4 * ratios)


def test_circle_and_ellipse_agree_on_the_axis_only():
    ahead = CAMERA.position + 3 * CAMERA.rotation[2]
    aside = ahead + 1.2 * CAMERA.rotation[0]
    for place, close in ((ahead, True), (aside, False)):
        circle, ellipse = (f(CAMERA, place[None], RADIUS).points(8) for f in (sphere_circles, sphere_outlines))
        assert (np.abs(circle - ellipse).max() < 0.02) == close
    behind = CAMERA.position - CAMERA.rotation[2]
    assert np.isnan(sphere_circles(CAMERA, behind[None], RADIUS).points(4)).all()
