"""The ball's film: the truth is where the picture shows the ball."""

import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes.sphere_clip import CarriedBallSettings, SphereClip, ball_cameras
from tsuiseki.tracking.cameras.outline import sphere_outlines

SEED = 1


@pytest.fixture(scope="module")
def scene():
    return SphereClip(CarriedBallSettings(frames=3, samples=2, noise=0.0), SEED)


@pytest.fixture(scope="module")
def images(scene):
    return [images for images, _ in scene.frames()]


def test_cameras_are_those_of_the_experiment():
    cameras = ball_cameras(6)
    truth = SphereClip(CarriedBallSettings(frames=100, samples=1), SEED).truth
    assert len(cameras) == 6
    for camera in cameras:
        assert (camera.width, camera.height) == (800, 600)
        assert 2 * np.degrees(np.arctan(400 / camera.focal[0])) == pytest.approx(60.0)
    for camera in cameras[:2]:
        distances = np.linalg.norm(truth - camera.position, axis=1)
        assert distances.min() >= 3.0
        assert distances.max() <= 5.1


@pytest.mark.slow
def test_the_ball_is_drawn_within_its_true_outline(scene, images):
    # Inside the outline lies the ball (or the hand that holds it), not the room: nearly every pixel differs.
    empty = scene.backgrounds()
    for k, camera in enumerate(scene.cameras):
        outline = sphere_outlines(camera, scene.truth[:1], scene.settings.radius)
        centre, reach = outline.middle[0], np.linalg.norm(outline.second[0])
        rows, columns = np.mgrid[0:600, 0:800] + 0.5
        away = np.hypot(columns - centre[0], rows - centre[1])
        changed = np.abs(images[0][k].astype(int) - empty[k]).sum(axis=2) > 12
        assert changed[away < 0.9 * reach].mean() > 0.95


def test_the_person_is_in_view_besides_the_ball(scene, images):
    empty = scene.backgrounds()
    ball = np.pi * np.linalg.norm(sphere_outlines(scene.cameras[0], scene.truth[:1], 0.1).second[0]) ** 2
    changed = np.abs(images[0][0].astype(int) - empty[0]).sum(axis=2) > 12
    assert changed.sum() > 5 * ball


@pytest.mark.slow
def test_the_same_seed_makes_the_same_film_and_another_one_another():
    settings = CarriedBallSettings(frames=1, samples=1)
    first, again, other = (next(SphereClip(settings, s).frames())[0][0] for s in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.3


def test_noise_has_the_stated_strength():
    settings = CarriedBallSettings(frames=1, samples=1, noise=3.0)
    scene = SphereClip(settings, SEED)
    first = scene.backgrounds()
    scene.seed = 2
    second = scene.backgrounds()
    difference = first[0].astype(float) - second[0]
    # Of 1.4 million differences; rounding to grey levels adds a twelfth to each variance.
    assert difference.std() == pytest.approx(np.sqrt(2 * (9 + 1 / 12)), rel=0.02)


@pytest.mark.slow
def test_a_board_hides_the_scene_from_one_camera_only(images):
    settings = CarriedBallSettings(frames=3, samples=2, noise=0.0, covers=((1, 1, 1),))
    covered = [images for images, _ in SphereClip(settings, SEED).frames()]
    np.testing.assert_array_equal(covered[0][1], images[0][1])
    np.testing.assert_array_equal(covered[1][0], images[1][0])
    assert (covered[1][1] != images[1][1]).mean() > 0.9


@pytest.mark.parametrize("wrong", [{"cameras": 1}, {"cameras": 7}, {"frames": 0}, {"radius": 0.0}, {"noise": -1.0}])
def test_impossible_films_are_refused(wrong):
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        CarriedBallSettings(**wrong)
