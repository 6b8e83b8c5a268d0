"""Things of towns: they stand where they are put, are as large as such things, and label nobody."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes.things.street_things import fronts_behind, reach_of
from tsuiseki.datamodules.scenes.things.town import THINGS, front, made, random_thing
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_settings import TrainingSettings

PLACE = np.array([3.0, 12.0])
SMALL = TrainingSettings((160, 120), people=(2, 5), person_height=(12, 70), clutter=(0, 0), samples=1)


@pytest.mark.parametrize("make", THINGS)
def test_things_stand_on_their_place_and_are_of_a_sensible_size(make):
    for seed in range(12):
        solids = made(np.random.default_rng(seed), make, PLACE, 0.7).solids
        top = solids.start[:, 2] + np.where(solids.box, solids.scale[:, 2], solids.length + solids.radius[:, 1])
        assert 0.4 < top.max() < 7.0
        assert reach_of(solids, PLACE) < 12.0
        # No part lies wholly under the ground.
        assert (top > 0).all()
        assert ((solids.colour >= 0) & (solids.colour <= 1)).all()


def test_the_same_seed_gives_the_same_thing_and_another_one_another():
    one, two, other = (random_thing(np.random.default_rng(s), PLACE).solids for s in (4, 4, 5))
    np.testing.assert_array_equal(one.start, two.start)
    np.testing.assert_array_equal(one.colour, two.colour)
    assert len(one) != len(other) or (one.colour != other.colour).any()


def test_a_front_has_openings_within_its_wall():
    for seed in range(8):
        solids = made(np.random.default_rng(seed), front, PLACE, 0.0).solids
        wall, parts = solids.scale[0], solids.select(solids.box).start[1:] - [*PLACE, 0]
        assert solids.box[0]
        assert len(parts) >= 2
        assert (np.abs(parts[:, 0]) <= wall[0] + 0.5).all()
        assert (parts[:, 2] <= 2 * wall[2] + 0.5).all()


def test_fronts_keep_clear_of_people():
    taken = np.random.default_rng(0).uniform([-6, 6], [6, 20], (40, 2))
    for seed in range(20):
        for thing in fronts_behind(np.random.default_rng(seed), 3, taken, 20.0):
            wall = thing.solids.select(np.array([0]))
            offset = taken - wall.start[0, :2]
            local = offset @ (wall.to_local[0, :2, :2] * wall.scale[0, :2, None]).T
            assert not ((np.abs(local[:, 0]) < min(wall.scale[0, 0], 7.9)) & (np.abs(local[:, 1]) < 0.5)).any()


@pytest.mark.slow
def test_a_town_hides_people_and_adds_none():
    fewer = 0
    for seed in range(6):
        plain, boxes, visibility = random_training_scene(np.random.default_rng(seed), SMALL)
        town = replace(SMALL, town=(10, 14))
        image, there, shown = random_training_scene(np.random.default_rng(seed), town)
        assert (image != plain).any()
        same = np.abs(there[:, None] - boxes[None]).max(axis=2) < 1e-9
        assert same.any(axis=1).all()
        assert (shown <= visibility[same.argmax(axis=1)] + 1e-9).all()
        fewer += int(len(there) < len(boxes) or (shown < visibility[same.argmax(axis=1)] - 1e-9).any())
    assert fewer > 0


def test_more_at_least_than_at_most_is_refused():
    with pytest.raises(ValidationError, match="town"):
        replace(SMALL, town=(3, 1))
