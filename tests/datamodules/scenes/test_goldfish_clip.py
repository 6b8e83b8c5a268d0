"""Goldfish clips: exact states, silhouettes, water."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes import fish, goldfish_clip
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.fish import swim
from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishClip, GoldfishSettings
from tsuiseki.tracking.bodies.body import Goldfish
from tsuiseki.tracking.formats.body_states import centre_inside, read_silhouettes, read_states, silhouette_of
from tsuiseki.tracking.video.source import open_source

SHORT = GoldfishSettings(frames=12, fish=3)


def drawn(settings, seed):
    """Images, silhouettes and states of all frames."""
    views, states = zip(*GoldfishClip(settings, seed).frames(), strict=True)
    images, silhouettes = zip(*views, strict=True)
    return np.stack(images), np.stack(silhouettes), np.stack(states)


@pytest.fixture(scope="module")
def clip():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(goldfish_clip, "SPREAD", 0.0)
        return drawn(SHORT, seed=5)


def test_contours_of_exact_states_lie_on_the_drawn_outlines(clip):
    """Drawing and body share no code. A fin is 10 pixels wide, so that its middle is 5 from an edge."""
    body = Goldfish()
    _, silhouettes, states = (each[::3] for each in clip)
    for shown, exact in zip(silhouettes, states, strict=True):
        contours = body.contour(exact)
        assert len(contours) == 3
        for k, contour in enumerate(contours):
            own = silhouette_of(shown, k + 1).astype(np.uint8) * 255
            distance = cv2.distanceTransform(255 - cv2.Canny(own, 100, 200), cv2.DIST_L2, 5)
            at = np.floor(contour).astype(int)
            assert distance[at[:, 1], at[:, 0]].max() < 6.5
            tail_end = contour[-2]
            assert own[int(tail_end[1]), int(tail_end[0])], "the fin lies where the bend says"


def test_silhouettes_hold_the_centres_and_keep_what_others_cover(clip):
    _, silhouettes, states = clip
    for k in range(3):
        assert centre_inside(silhouettes, k + 1, states[:, k, :2]).all()
    areas = [silhouette_of(silhouettes, k + 1).sum(axis=(1, 2)) for k in range(3)]
    assert all(area.min() > 0.9 * area.max() for area in areas)


def test_fish_are_orange_on_green_and_the_water_moves(clip):
    images, silhouettes, _ = clip
    body = silhouette_of(silhouettes[0], 1)
    red, green, blue = images[0][body].mean(axis=0)
    assert red > green + 50 > blue
    still = ~silhouette_of(silhouettes[0] | silhouettes[-1], 1)
    assert np.abs(images[0][still].astype(int) - images[-1][still]).mean() > 4


def test_same_seed_same_clip_and_another_seed_another():
    settings = replace(SHORT, frames=2)
    one, same, other = (drawn(settings, seed) for seed in (1, 1, 2))
    for a, b in zip(one, same, strict=True):
        assert np.array_equal(a, b)
    assert not np.array_equal(one[2], other[2])


def body_fixed(states):
    """Forward and sideways steps ``(T - 1, 2)``."""
    steps, heading = np.diff(states[:, :2], axis=0), states[1:, 2]
    return np.stack(
        [np.cos(heading) * steps[:, 0] + np.sin(heading) * steps[:, 1],
         -np.sin(heading) * steps[:, 0] + np.cos(heading) * steps[:, 1]], axis=1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def ways():
    return [swim(150, 15.0, (640, 480), np.random.default_rng(seed)) for seed in range(8)]


def test_fish_swim_forwards_and_stay_in_the_tank(ways):
    for way in ways:
        assert way[:, :2].min() > 40
        assert np.all(way[:, :2].max(axis=0) < [600, 440])
        forward, aside = body_fixed(way).T
        assert np.mean(forward) > 2
        assert np.abs(aside).mean() < forward.mean()


def test_bend_drives_motion(ways):
    """Shape and motion are correlated frame by frame, and not when the bends are those of another fish."""
    bending = np.concatenate([np.diff(way[:, 3])[1:] for way in ways])
    aside = np.concatenate([np.diff(body_fixed(way)[:, 1]) for way in ways])
    turning = np.concatenate([np.diff(way[:, 2])[1:] for way in ways])
    assert np.corrcoef(bending, aside)[0, 1] < -0.5
    assert np.corrcoef(bending, turning)[0, 1] > 0.2
    assert abs(np.corrcoef(np.roll(bending, 149), aside)[0, 1]) < 0.2


def test_a_fish_without_a_beat_only_glides(monkeypatch):
    monkeypatch.setattr(fish, "LIVELY", 0.0)
    driven = swim(150, 15.0, (640, 480), np.random.default_rng(3))
    monkeypatch.setattr(fish, "BURSTS", 0.0)
    monkeypatch.setattr(fish, "GLIDES", 1.0)
    gliding = swim(150, 15.0, (640, 480), np.random.default_rng(3))
    assert body_fixed(gliding)[60:, 0].mean() < 0.5 * body_fixed(driven)[60:, 0].mean()


def test_clips_on_disk(tmp_path):
    settings = replace(SHORT, frames=3)
    folder = write_clip(tmp_path / "clip", GoldfishClip(settings, 5))
    images, silhouettes, states = drawn(settings, seed=5)
    source = open_source(folder)
    assert (source.frame_rate, source.length) == (15.0, 3)
    image = next(iter(source.frames())).image
    assert np.abs(image.astype(int) - images[0]).mean() < 4
    tracks = read_states(folder / "states.csv", ("a", "b", "theta", "phi"))
    assert np.stack([t.states for t in tracks], axis=1) == pytest.approx(states, abs=1e-4)
    assert np.array_equal(read_silhouettes(folder), silhouettes)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"fish": 0}, "greater than or equal to 1"),
        ({"fish": 6}, "less than or equal to 5"),
        ({"frames": 0}, "greater than 0"),
        ({"frame_rate": 0.0}, "greater than 0"),
        ({"width": 100}, "greater than or equal to 224"),
    ],
)
def test_wrong_settings_are_refused(wrong, message):
    with pytest.raises(ValidationError, match=message):
        GoldfishSettings(**wrong)
