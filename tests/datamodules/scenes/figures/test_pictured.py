"""Photographed things stand upright on the ground, in their own colours, and are nobody."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.scenes.figures.standing_sprites import pictured_things
from tsuiseki.datamodules.scenes.render.composing import compose, empty_picture
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.datamodules.scenes.render.shading import random_light
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_settings import TrainingSettings, settings_of_scene
from tsuiseki.tracking.cameras.projective import PinholeCamera

CAMERA = PinholeCamera.look_at(np.array([0.0, 0, 2.5]), np.array([0, 12.0, 0.8]), 150, 200, 150)


@pytest.fixture
def photographs(tmp_path: Path) -> Photographs:
    (tmp_path / "things").mkdir()
    picture = np.zeros((80, 30, 4), np.uint8)
    picture[..., 2:] = 255
    cv2.imwrite(str(tmp_path / "things" / "red.png"), picture)
    return Photographs(tmp_path)


def test_things_stand_where_nobody_does(photographs: Photographs) -> None:
    taken = np.array([[0.0, 8.0], [1.0, 9.0]])
    things = pictured_things(np.random.default_rng(1), photographs, CAMERA, 8, taken, 0.12)
    assert len(things) == 8
    for thing in things:
        assert thing.outfit is None
        foot = thing.solids.start[0, :2]
        assert np.linalg.norm(taken - foot, axis=1).min() > 0.4


def test_they_are_shown_in_their_colours_from_the_ground_up(photographs: Photographs) -> None:
    rng = np.random.default_rng(3)
    things = pictured_things(rng, photographs, CAMERA, 1, np.empty((0, 2)), 0.12)
    empty = empty_picture(np.zeros((150, 200, 3), np.float32), 2)
    picture, sightings = compose(empty, things, CAMERA, random_light(rng))
    shown = picture.colour.sum(axis=2) > 0
    red, rest = picture.colour[shown][:, 0].mean(), picture.colour[shown][:, 1:].mean()
    assert red > 4 * rest
    assert sightings[0] is not None
    foot, _ = CAMERA.project(np.array([[*things[0].solids.start[0, :2], 0.0]]))
    assert abs(sightings[0].box[3] - foot[0, 1]) < 2


def test_nobody_is_labelled_for_them(photographs: Photographs) -> None:
    settings = TrainingSettings((160, 120), people=(0, 0), clutter=(0, 0), things=(6, 6))
    plain = TrainingSettings((160, 120), people=(0, 0), clutter=(0, 0), things=(0, 0))
    image, boxes, _ = random_training_scene(np.random.default_rng(5), settings, photographs=photographs)
    assert len(boxes) == 0
    other, _, _ = random_training_scene(np.random.default_rng(5), plain, photographs=photographs)
    assert (image != other).any()


@pytest.mark.slow
def test_near_pictures_show_people_large() -> None:
    heights = []
    for seed in range(6):
        _, boxes, _ = random_training_scene(
            np.random.default_rng(seed), settings_of_scene("near", np.random.default_rng(0), (160, 120))
        )
        heights.append(boxes[:, 3] - boxes[:, 1])
    assert np.median(np.concatenate(heights)) > 0.4 * 120
