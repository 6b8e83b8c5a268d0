"""Rooms under ceiling cameras: the picture and its truth against the camera's own geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes.people.walkers import dressed
from tsuiseki.datamodules.scenes.room_clip import (
    RoomClip,
    RoomSettings,
    RoomView,
    ceiling_lens,
    looking_down,
)
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens
from tsuiseki.tracking.cameras.person_model import PersonModel, build_table
from tsuiseki.tracking.errors import RequestError

SMALL = RoomSettings(size=(4.0, 9.0), frames=30, frame_rate=5.0, people=4, width=320, height=240, repeated=0.5)


@pytest.fixture(scope="module")
def drawn():
    clip = RoomClip(SMALL, 3)
    view = RoomView(clip, 0)
    return clip, view, clip.draw_frame(view, 12)


def test_feet_and_heads_lie_in_the_boxes(drawn):
    _, view, (image, truth) = drawn
    assert image.shape == (240, 320, 3)
    assert len(truth.ids) >= 2
    for place, box, shown in zip(truth.places, truth.boxes, truth.visibility, strict=True):
        body = np.array([[*place, 0.3], [*place, 1.3]])
        pixels = view.camera.project(body)[0]
        assert (pixels > box[:2] - 2).all()
        assert (pixels < box[2:] + 2).all()
        assert 0 < shown <= 1


def test_the_table_finds_people_where_they_stand(drawn):
    clip, view, _ = drawn
    table = build_table(view.camera, clip.floor, PersonModel())
    away = []
    for frame in range(0, 30, 6):
        truth = clip.draw_frame(view, frame)[1]
        whole = truth.visibility > 0.95
        away.append(np.linalg.norm(table.look_up(truth.boxes[whole])[1] - truth.places[whole], axis=1))
    # People are of other heights than the model and move their arms and legs.
    assert np.median(np.concatenate(away)) < 0.35


def test_people_stay_in_the_room_and_keep_apart():
    clip = RoomClip(replace(SMALL, frames=200), 5)
    ways = np.array([w.positions for w in clip.walkers])
    assert ways.min() >= 0.29
    assert (ways.max(axis=(0, 1)) <= np.array(SMALL.size) - 0.29).all()
    steps = np.linalg.norm(np.diff(ways, axis=1), axis=2) * 5
    assert steps.max() < 4.0


def test_the_same_seed_gives_the_same_picture(drawn):
    _, _, (image, truth) = drawn
    again = RoomClip(SMALL, 3)
    second, labels = again.draw_frame(RoomView(again, 0), 12)
    assert np.array_equal(image, second)
    assert np.array_equal(truth.boxes, labels.boxes)


def test_both_cameras_agree_on_ids_and_places(drawn):
    clip, _, (_, first) = drawn
    second = clip.draw_frame(RoomView(clip, 1), 12)[1]
    shared = set(first.ids.tolist()) & set(second.ids.tolist())
    assert shared
    for number in shared:
        assert np.allclose(first.places[first.ids == number], second.places[second.ids == number])


def test_beyond_the_rim_it_is_dark(drawn):
    _, view, _ = drawn
    x, y = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
    lens = view.camera.lens
    # A pixel's rays reach half a pixel further than its centre.
    outside = np.hypot(x - lens.centre[0], y - lens.centre[1]) > lens.rim + 1
    assert outside.mean() > 0.2
    assert view.photograph[outside].max() == 0


def test_a_given_lens_is_enlarged_to_a_half_space():
    lens = OmnidirectionalLens(640, 480, np.array([160.0, 0.0, -1.2e-3, 1e-6, -5e-9]), np.array([322.5, 238.0]))
    fitted = ceiling_lens(lens, 320, 240)
    right = fitted.project(np.array([[1.0, 0.0, 1e-9]]))[0] - fitted.centre
    assert np.isclose(right[0], 0.475 * 240, atol=0.1)
    with pytest.raises(RequestError, match="narrower lens"):
        ceiling_lens(OmnidirectionalLens(640, 480, np.array([900.0]), np.array([320.0, 240.0])), 320, 240)


def test_a_camera_that_looks_down_sees_the_floor_below():
    assert np.allclose(looking_down(0.7) @ [0, 0, -1], [0, 0, 1])
    assert np.isclose(np.linalg.det(looking_down(0.7, 0.02, -0.01)), 1)


def test_some_wear_the_clothes_of_others():
    looks = [p.outfit for p in dressed(np.random.default_rng(0), 40, 0.6)]
    assert len({(look.upper, look.lower) for look in looks}) < 34
    assert len({(p.outfit.upper, p.outfit.lower) for p in dressed(np.random.default_rng(0), 40, 0.0)}) == 40


@pytest.mark.parametrize(
    ("change", "message"),
    [({"people": 0}, "greater than 0"), ({"size": (1.0, 9.0)}, "greater than or equal to 2")],
)
def test_settings_out_of_range_are_named(change, message):
    with pytest.raises(ValidationError, match=message):
        replace(SMALL, **change)
