from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.datamodules.scenes import likenesses
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.people.poses import FREE, draw_pose
from tsuiseki.datamodules.scenes.people.posture import Build
from tsuiseki.datamodules.scenes.render.weather import rained_on, recorded
from tsuiseki.datamodules.scenes.things import foliage
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_places import in_queues
from tsuiseki.datamodules.scenes.training_settings import EVERYDAY, TrainingSettings, settings_of_scene
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import ImageArray

SIZE = (96, 72)
CAMERA = PinholeCamera.look_at(np.array([0.0, 0.0, 4.0]), np.array([0.0, 8.0, 0.0]), 100.0, *SIZE)
PLAIN = TrainingSettings(SIZE, people=(3, 6), person_height=(15.0, 60.0), clutter=(0, 2))


def test_people_in_queues_stand_on_nearly_one_line_of_sight() -> None:
    rng = np.random.default_rng(0)
    spots = rng.uniform([-3, 5], [3, 15], (200, 2))
    moved = in_queues(rng, spots, CAMERA, 1.0)
    first = np.arange(200) % 5 == 0
    np.testing.assert_array_equal(moved[first], spots[first])
    before, behind = np.roll(moved, 1, axis=0)[~first], moved[~first]
    # Farther from a camera over the origin, and less than a pair of shoulders aside.
    assert (np.linalg.norm(behind, axis=1) > np.linalg.norm(before, axis=1)).all()
    direction = before / np.linalg.norm(before, axis=1, keepdims=True)
    aside = np.abs(((behind - before) @ np.array([[0, -1], [1, 0]]) * direction).sum(axis=1))
    assert (aside >= 0.08 - 1e-9).all()
    assert (aside <= 0.42 + 1e-9).all()
    np.testing.assert_array_equal(in_queues(rng, spots, CAMERA, 0.0), spots)


@pytest.mark.slow
def test_crowds_hide_people_to_a_half_and_three_quarters() -> None:
    settings = replace(PLAIN, size=(160, 120), people=(5, 5), clutter=(0, 0), beside=0.0)
    shares = {}
    for behind in (0.0, 1.0):
        scenes = [random_training_scene(np.random.default_rng(n), replace(settings, behind=behind)) for n in range(5)]
        visible = np.concatenate([visibility for _, _, visibility in scenes])
        shares[behind] = float(((visible > 0.2) & (visible < 0.8)).mean())
    assert shares[1.0] > 2 * shares[0.0]


@pytest.mark.parametrize("scene", ["crowded", "lifeless", "everyday"])
def test_each_scene_can_be_drawn_and_follows_the_seed(scene: str) -> None:
    pictures = []
    for _ in range(2):
        rng = np.random.default_rng(3)
        settings = replace(settings_of_scene(scene, rng, SIZE), people=(0, 3) if scene != "lifeless" else (0, 0))
        pictures.append(random_training_scene(rng, replace(settings, person_height=(10.0, 60.0), posed=None)))
    np.testing.assert_array_equal(pictures[0][0], pictures[1][0])
    np.testing.assert_array_equal(pictures[0][1], pictures[1][1])
    if scene == "lifeless":
        assert len(pictures[0][1]) == 0


def test_an_everyday_set_draws_all_its_parts() -> None:
    drawn = {settings_of_scene("everyday", np.random.default_rng(seed), SIZE) for seed in range(60)}
    assert len(drawn) == len(EVERYDAY)
    assert sum(share for share, _ in EVERYDAY) == pytest.approx(1)


@pytest.mark.slow
def test_posed_people_need_a_library_that_has_them(library: Path) -> None:
    # The library's people stand and walk.
    settings = replace(PLAIN, rendered=1.0, posed=1.0)
    with pytest.raises(RequestError, match="simulate sprites --poses"):
        random_training_scene(np.random.default_rng(0), settings, SpriteLibrary(library))
    assert len(random_training_scene(np.random.default_rng(0), replace(settings, posed=0.0), SpriteLibrary(library))[1])


def test_every_free_pose_can_be_drawn() -> None:
    for name in set(FREE):
        assert draw_pose(0, Build(), name) != draw_pose(1, Build(), name)


def test_likenesses_are_nobody(library: Path) -> None:
    settings = replace(PLAIN, people=(0, 0), likenesses=(6, 6), leaves=1.0)
    plain, boxes, _ = random_training_scene(np.random.default_rng(2), replace(settings, likenesses=(0, 0), leaves=0.0))
    shown, others, _ = random_training_scene(np.random.default_rng(2), settings, SpriteLibrary(library))
    assert len(boxes) == len(others) == 0
    assert (np.abs(plain.astype(int) - shown).max(axis=2) > 20).mean() > 0.01


def test_a_statue_stands_on_its_plinth_in_one_colour(library: Path) -> None:
    rng = np.random.default_rng(0)
    figure = likenesses.statue(rng, SpriteLibrary(library), CAMERA, np.array([0.0, 7.0]))
    (block,) = [likenesses.plinth(rng, figure)]
    top = block.solids.start[0, 2] + block.solids.scale[0, 2]
    assert top == pytest.approx(figure.base, abs=1e-5)
    layer = figure.trace(CAMERA, 1)
    assert layer is not None
    foot = CAMERA.project(np.array([[0.0, 7.0, figure.base]]))[0][0, 1]
    rows = np.flatnonzero(layer.mask.any(axis=1)) + layer.top
    assert rows.max() == pytest.approx(foot, abs=3)
    colours = figure.sprite.albedo[figure.sprite.label > 0].astype(float)
    hue = colours / np.maximum(colours.sum(axis=1, keepdims=True), 1)
    assert hue[colours.sum(axis=1) > 60].std(axis=0).max() < 0.03


def test_a_chair_is_behind_who_faces_the_camera_and_before_who_does_not() -> None:
    spot, rng = np.array([0.0, 7.0]), np.random.default_rng(0)
    towards, away = (
        likenesses.chair_under(rng, spot, CAMERA, heading).solids.start[:, 1].mean() for heading in (np.pi, 0.0)
    )
    assert away < towards
    assert abs(towards - 7) < 0.6


def test_leaves_lie_on_the_ground_alone() -> None:
    ground = np.full((72, 96, 3), 0.2, np.float32)
    level = PinholeCamera.look_at(np.array([0.0, 0.0, 2.0]), np.array([0.0, 10.0, 2.0]), 80.0, *SIZE)
    covered = foliage.fallen_leaves(np.random.default_rng(1), ground, level)
    changed = np.abs(covered - ground).max(axis=2) > 0.01
    assert changed[40:].mean() > 0.02
    # The horizon is the middle row of a level camera.
    assert not changed[:34].any()


@pytest.mark.parametrize("within", ["heap", "hedge", "branch"])
def test_leaf_pictures_are_partly_leaves(within: str) -> None:
    picture = foliage.leaf_picture(np.random.default_rng(4), 90, 70, within)
    assert picture.shape == (70, 90, 4)
    assert 0.02 < (picture[..., 3] > 127).mean() < 1


def test_a_branch_hides_people() -> None:
    picture = np.zeros((72, 96, 4), np.uint8)
    picture[:, :48] = 255
    layer = foliage.Branch(picture).trace(CAMERA, 2)
    assert layer is not None
    assert layer.distance.shape == (144, 192)
    assert (layer.distance[:, :96] < 1).all()
    assert np.isinf(layer.distance[:, 96:]).all()
    assert foliage.Branch(np.zeros((72, 96, 4), np.uint8)).trace(CAMERA, 2) is None


def test_rain_adds_streaks_and_takes_contrast() -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    image[:, 40:] = 200
    wet = rained_on(image, np.random.default_rng(0))
    assert np.median(wet[:, 40:]) - np.median(wet[:, :40]) < 200
    assert wet[:, :40].std() > 2
    np.testing.assert_array_equal(wet, rained_on(image, np.random.default_rng(0)))


def test_recorders_keep_the_size_and_lose_detail() -> None:
    rng = np.random.default_rng(0)
    image: ImageArray = rng.integers(0, 256, (240, 640, 3)).astype(np.uint8)
    kept = [recorded(image, np.random.default_rng(seed)) for seed in range(8)]
    assert all(picture.shape == image.shape and picture.dtype == np.uint8 for picture in kept)
    fine = np.abs(np.diff(image.astype(int), axis=1)).mean()
    assert all(np.abs(np.diff(picture.astype(int), axis=1)).mean() < 0.6 * fine for picture in kept)
    assert any(np.ptp(picture.astype(int), axis=2).mean() < 4 for picture in kept)


def test_pictures_of_earlier_settings_have_no_new_things() -> None:
    settings = TrainingSettings()
    new = (
        settings.behind,
        settings.screened,
        settings.likenesses[1],
        settings.leaves,
        settings.rain,
        settings.recorded,
    )
    assert not any(new)
    assert settings.posed is None
