"""The contour and background likelihoods on images whose content is known in closed form."""

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cameras.outline import sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.sphere import views as contour
from tsuiseki.tracking.sphere.views import (
    ContourSettings,
    colour_difference,
    median_background,
    outline_support,
    polar_maps,
)

RADIUS = 0.1
CAMERA = PinholeCamera.look_at(np.array([3.0, 0.0, 1.2]), np.array([0.0, 0.0, 1.0]), 300.0, 320, 240)
BALL = np.array([0.1, 0.4, 0.9])


def picture(camera, centre, ball=(200, 60, 40), room=(90, 110, 100), noise=3.0, fine=3):
    """A ball by its exact silhouette, anti-aliased by ``fine`` x ``fine`` rays a pixel."""
    at = (np.arange(camera.width * fine) + 0.5) / fine, (np.arange(camera.height * fine) + 0.5) / fine
    rays = camera.rays(np.stack(np.meshgrid(*at), axis=-1).reshape(-1, 2))
    toward = centre - camera.position
    along = rays @ toward
    hit = (toward @ toward - along**2 < RADIUS**2) & (along > 0)
    share = cv2.resize(
        hit.reshape(len(at[1]), -1).astype(np.float32), (camera.width, camera.height), interpolation=cv2.INTER_AREA
    )[:, :, None]
    clean = share * np.array(ball) + (1 - share) * np.array(room)
    return np.clip(clean + np.random.default_rng(0).normal(0, noise, clean.shape), 0, 255).astype(np.uint8)


IMAGE = picture(CAMERA, BALL)


def support(points, image=IMAGE, settings=None):
    settings = settings or ContourSettings()
    return outline_support(image, polar_maps(CAMERA, np.atleast_2d(points), RADIUS, settings), settings).T


@pytest.mark.parametrize("image", [IMAGE, np.ascontiguousarray(IMAGE[:, :, 0])], ids=["colour", "one channel"])
def test_the_best_particle_is_the_true_one_along_every_axis(image):
    for axis in np.eye(3):
        steps = np.linspace(-0.25, 0.25, 101)
        values, _ = support(BALL + steps[:, None] * axis, image)
        # One pixel is a centimetre here; along the optical axis an outline tells ten times less than across it.
        allowed = 0.06 if axis[0] else 0.01
        assert abs(steps[values.argmax()]) <= allowed


def test_a_true_outline_gets_most_of_the_support_and_a_bare_wall_little():
    assert support(BALL)[0][0] > 0.6
    assert support([0.0, -0.6, 1.0])[0][0] < 0.2


def test_the_polar_samples_lie_where_the_outline_says():
    settings = ContourSettings(angles=8, radii=5, reach=0.5)
    maps = polar_maps(CAMERA, BALL[None], RADIUS, settings)
    outlines = sphere_outlines(CAMERA, BALL[None], RADIUS)
    spokes = outlines.points(8)[0] - outlines.centre[0]
    expected = outlines.centre[0] + np.linspace(0.5, 1.5, 5)[:, None, None] * spokes - 0.5
    found = np.stack([maps.columns.reshape(5, 8), maps.rows.reshape(5, 8)], axis=-1)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_the_radius_is_that_of_the_depth():
    nearer = CAMERA.position + 0.5 * (BALL - CAMERA.position)
    # Half way to the camera the same image point would need a ball of half the radius.
    assert support(BALL)[0][0] > support(nearer)[0][0] + 0.3


def test_without_an_outline_in_the_image_there_is_nothing_to_say():
    outside = CAMERA.position + np.array([-1.0, 3.0, 0.0])
    behind = CAMERA.position + np.array([1.0, 0.0, 0.0])
    values, share = support(np.stack([outside, behind, BALL]))
    np.testing.assert_array_equal(share, [0, 0, 1])
    assert np.isfinite(values).all()


@pytest.mark.parametrize("pixel", [(0.5, 120.5), (319.5, 120.5), (160.5, 0.5), (160.5, 239.5)])
def test_of_an_outline_that_leaves_the_picture_that_share_counts_which_lies_in_it(pixel):
    centre = CAMERA.position + 3.0 * CAMERA.rays(np.array([pixel]))[0]
    _, (share,) = support(centre)
    assert 0.35 < share < 0.5  # half of its rays, less those along the border


def test_more_particles_than_opencv_has_columns_give_the_same(monkeypatch):
    points = BALL + np.random.default_rng(1).normal(0, 0.1, (50, 3))
    whole = support(points)
    monkeypatch.setattr(contour, "MOST_COLUMNS", 7)
    np.testing.assert_array_equal(support(points), whole)


def test_the_background_difference_is_the_colour_distance_at_the_point():
    empty = np.full((240, 320, 3), 100, np.uint8)
    changed = empty + np.array([30, 0, 40], np.uint8)
    outside = CAMERA.position + np.array([-1.0, 3.0, 0.0])
    difference, inside = colour_difference(CAMERA, changed, empty, np.stack([BALL, outside]))
    np.testing.assert_allclose(difference, [50.0, 0.0])
    np.testing.assert_array_equal(inside, [True, False])


def test_the_median_forgets_what_covers_a_pixel_less_than_half_the_time():
    frames = [np.full((4, 4, 3), value, np.uint8) for value in (10, 10, 10, 250, 250)]
    assert (median_background(frames) == 10).all()


def test_strong_and_even_texture_says_nothing():
    texture = np.random.default_rng(2).integers(0, 256, IMAGE.shape, dtype=np.uint8)
    values, _ = support(BALL + np.random.default_rng(3).normal(0, 0.1, (200, 3)), texture)
    # The contrast of 60 grey levels takes a fiftieth of what 15 steps of 3 channels have here.
    assert np.median(values) == pytest.approx(contour.CLUTTER, abs=0.015)
