"""Things in the round: one thing from several sides, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.pairs.in_the_round import from_some_sides, of_no_class
from tsuiseki.datamodules.scenes.people.person import view_from
from tsuiseki.datamodules.scenes.render.composing import drawn_alone
from tsuiseki.datamodules.scenes.render.shading import random_light
from tsuiseki.datamodules.scenes.things.town import made

SIDE = 60


def test_a_thing_is_seen_from_some_sides() -> None:
    for seed in range(12):
        views = from_some_sides(np.random.default_rng(seed), 3, SIDE)
        assert len(views) == 3
        for view in views:
            assert view.dtype == np.uint8
            assert (view[..., 3] > 0).any(axis=1).all()
            assert SIDE / 4 < max(view.shape[:2]) < 2 * SIDE


def test_the_same_seed_shows_the_same_sides() -> None:
    first, again, other = (from_some_sides(np.random.default_rng(seed), 2, SIDE) for seed in (5, 5, 6))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert first[0].shape != other[0].shape or not np.array_equal(first[0], other[0])


def test_a_turn_shows_another_side_of_the_same_thing() -> None:
    """Half a turn is the mirror image of the silhouette, where the camera is level and rather far away."""
    light = random_light(np.random.default_rng(0))
    camera = view_from(0.0, SIDE, 1.5, 60.0)
    front, back = (
        drawn_alone(made(np.random.default_rng(3), of_no_class, np.zeros(2), yaw), camera, 4, light)[..., 3] >= 128
        for yaw in (0.4, 0.4 + np.pi)
    )
    np.testing.assert_allclose(front.shape, back.shape, atol=1)
    height, width = np.minimum(front.shape, back.shape)
    assert (front[:height, :width] == back[:height, ::-1][:, :width]).mean() > 0.9


def test_what_the_camera_does_not_see_is_refused() -> None:
    thing = made(np.random.default_rng(3), of_no_class, np.array([-50.0, 0.0]), 0.0)
    with pytest.raises(ValueError, match="expected a thing before the camera"):
        drawn_alone(thing, view_from(0.0, SIDE, 1.5, 5.0), 2, random_light(np.random.default_rng(0)))
