from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes import training_pictures
from tsuiseki.datamodules.scenes.clip import people_in_view
from tsuiseki.datamodules.scenes.people.outfit import Outfit, similar_outfit
from tsuiseki.datamodules.scenes.people.person import paste, render_person_sprite
from tsuiseki.datamodules.scenes.render.composing import Sighting
from tsuiseki.datamodules.scenes.render.degrade import Degradation, by_night, degrade, random_degradation
from tsuiseki.datamodules.scenes.render.shading import Light, hard_sun, random_light
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_settings import TrainingSettings, settings_of_scene
from tsuiseki.tracking.errors import RequestError

SMALL = TrainingSettings((160, 120), people=(2, 5), person_height=(12, 70), clutter=(2, 5), samples=2)


@pytest.mark.parametrize("height", [20, 60, 150])
@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.0])
def test_sprite_is_tight_and_about_as_tall_as_asked(height: float, tilt: float) -> None:
    rng = np.random.default_rng(int(height * 10 + tilt))
    for _ in range(4):
        sprite = render_person_sprite(rng, height, tilt)
        alpha = sprite[:, :, 3]
        assert all(edge.any() for edge in (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]))
        # A stride, an umbrella of the view's tilt and the build change the height by less than half.
        assert 0.6 * height < sprite.shape[0] < 1.4 * height
        assert ((alpha > 0) & (alpha < 255)).any()
        assert (alpha == 255).mean() > 0.1


def test_sprites_follow_the_seed() -> None:
    one, two, other = (render_person_sprite(np.random.default_rng(s), 50) for s in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert one.shape != other.shape or (one != other).any()


@pytest.mark.parametrize(("height", "tilt"), [(1, 0.0), (float("nan"), 0.0), (50, -0.1), (50, 2.0)])
def test_impossible_sprites_are_refused(height: float, tilt: float) -> None:
    with pytest.raises(ValueError, match="expected a"):
        render_person_sprite(np.random.default_rng(0), height, tilt)


def test_paste_blends_and_cuts_off() -> None:
    canvas = np.zeros((4, 4, 3), dtype=np.float32)
    sprite = np.full((3, 3, 4), 200, dtype=np.uint8)
    sprite[:, :, 3] = 51
    paste(canvas, sprite, 2, -1)
    np.testing.assert_allclose(canvas[:2, 2:], 40, atol=1e-4)
    assert canvas.sum() == pytest.approx(4 * 3 * 40, rel=1e-5)
    paste(canvas, sprite, 10, 10)
    assert canvas.sum() == pytest.approx(4 * 3 * 40, rel=1e-5)


def test_look_alikes_share_most_of_their_clothes() -> None:
    rng = np.random.default_rng(0)
    shared = []
    for _ in range(50):
        look = Outfit(rng)
        other = similar_outfit(rng, look)
        shared.append(sum(getattr(look, n) == getattr(other, n) for n in ("upper", "lower", "hair", "bag")))
        assert look != other
    assert np.mean(shared) > 2


def test_training_scenes_hold_their_promises() -> None:
    counts = []
    for seed in range(6):
        image, boxes, visibility = random_training_scene(np.random.default_rng(seed), SMALL)
        assert image.shape == (120, 160, 3)
        assert image.dtype == np.uint8
        assert len(boxes) == len(visibility) <= 5
        counts.append(len(boxes))
        assert (boxes[:, :2] >= 0).all()
        assert (boxes[:, 2:] <= [160, 120]).all()
        assert (boxes[:, 2:] > boxes[:, :2]).all()
        assert ((visibility > 0) & (visibility <= 1)).all()
    assert max(counts) > 1


def test_training_scenes_follow_the_seed() -> None:
    digests = []
    for seed in (4, 4, 5):
        image, boxes, _ = random_training_scene(np.random.default_rng(seed), SMALL)
        digests.append(hashlib.sha256(image.tobytes() + boxes.tobytes()).hexdigest())
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize(
    "change", [{"people": (5, 2)}, {"size": (8, 480)}, {"samples": 0}, {"camera_height": (-1.0, 2.0)}], ids=str
)
def test_impossible_training_settings_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match=next(iter(change))):
        TrainingSettings(**change)  # type: ignore[arg-type]


def test_a_size_no_camera_shows_is_refused() -> None:
    settings = TrainingSettings((64, 64), person_height=(5000, 6000))
    with pytest.raises(RequestError, match="person_height"):
        random_training_scene(np.random.default_rng(0), settings)


def test_degradation_does_what_it_says() -> None:
    rng = np.random.default_rng(0)
    grey = np.full((40, 40, 3), 0.25, dtype=np.float32)
    np.testing.assert_allclose(degrade(grey, Degradation(), rng), 127, atol=1)
    assert degrade(grey, Degradation(exposure=2.0), rng).mean() == pytest.approx(255 * np.sqrt(0.5), abs=1)
    colour = grey * np.array([2.0, 1.0, 0.5], dtype=np.float32)
    drained = degrade(colour, Degradation(saturation=0.0), rng)
    assert np.ptp(drained.astype(int), axis=2).max() <= 1
    noisy = degrade(grey, Degradation(noise=8.0), rng).astype(float)
    assert 4 < noisy.std() < 12
    edge = grey.copy()
    edge[:, 20:] = 0.81
    sharp, blurred = (degrade(edge, Degradation(blur=b), rng).astype(int) for b in (0.0, 2.0))
    assert np.abs(np.diff(blurred, axis=1)).max() < 0.5 * np.abs(np.diff(sharp, axis=1)).max()


def test_varied_pictures_hold_crowds_and_nobody_and_are_the_same_with_one_seed() -> None:
    counts = []
    for seed in range(12):
        first, again = (settings_of_scene("varied", np.random.default_rng(seed), (96, 72)) for _ in range(2))
        assert first == again
        counts.append(first.people)
    assert {(0, 0), (25, 60)} <= set(counts)


def test_a_night_is_darker_less_even_and_has_the_same_people() -> None:
    day, night = (
        random_training_scene(np.random.default_rng(4), replace(SMALL, night=chance)) for chance in (0.0, 1.0)
    )
    np.testing.assert_array_equal(day[1], night[1])
    light = by_night(np.ones((60, 80, 3), np.float32), np.random.default_rng(0))
    assert np.isfinite(light).all()
    assert light.min() >= 0
    assert np.median(light) < 1
    assert light.mean(axis=2).std() > 0.1


def test_a_hard_sun_leaves_less_light_in_shadows_than_other_days() -> None:
    def left(light: Light) -> float:
        """The share of the light on level ground that a shadow keeps."""
        return float((light.sky / (light.sky + light.sun * light.direction[2])).mean())

    lights = [[make(np.random.default_rng(seed)) for seed in range(200)] for make in (hard_sun, random_light)]
    hard, soft = ([left(light) for light in some] for some in lights)
    assert min(hard) > 0.08
    assert max(hard) < 0.27 < np.quantile(soft, 0.05)


def test_a_hard_sun_changes_the_light_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_pictures, "random_degradation", partial(random_degradation, strength=0.0))
    plain, sunny = (random_training_scene(np.random.default_rng(4), replace(SMALL, sun=sun)) for sun in (0.0, 1.0))
    np.testing.assert_array_equal(plain[1], sunny[1])
    assert np.abs(plain[0].astype(int) - sunny[0]).mean() > 3


def test_a_chance_of_sun_is_one() -> None:
    with pytest.raises(ValidationError, match=r"sun\n.*less than or equal to 1"):
        replace(SMALL, sun=1.2)


def test_whose_box_lies_outside_though_an_arm_is_seen_is_left_out() -> None:
    within, beside, unseen = (
        Sighting(np.array([x, 5.0, x + 10, 30.0]), share) for x, share in ((-4, 0.5), (-11, 0.1), (40, 0.0))
    )
    truth, rows = people_in_view([within, None, beside, unseen], (60, 40), 1e-9, 0.0)
    assert truth.boxes.tolist() == [[0, 5, 6, 30]]
    assert truth.visibility.tolist() == [0.5]
    assert rows.tolist() == [0]


def test_an_unknown_way_to_draw_boxes_is_refused() -> None:
    with pytest.raises(ValidationError, match="'silhouettes' or 'steady'"):
        TrainingSettings(boxes="stedy")  # type: ignore[arg-type]
