"""Bodies that bend, drawn by hand, followed: alone, crossing, gone and back."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.tracking.bodies.body import Ball, Goldfish
from tsuiseki.tracking.bodies.contour import EdgeImage, Extraction, contours_mask, find_starts, wide_noise
from tsuiseki.tracking.bodies.settings import DeformableSettings
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.features.colour_region import NAMED_COLOURS
from tsuiseki.tracking.filters.body_motion import BodyFixedVelocity, Noise, RandomWalk
from tsuiseki.tracking.types import Frame

ORANGE = Extraction(NAMED_COLOURS["orange"])
FISH = Goldfish()
MOTION = BodyFixedVelocity(
    Noise.independent(np.zeros(4), np.array([1.0, 1.0, 0.06, 0.2])),
    Noise.independent(np.array([7.0, 0.0]), np.array([2.0, 1.0])),
)


def picture(states, body=FISH):
    """Bodies ``(K, D)`` in orange over grey-green."""
    image = np.full((480, 640, 3), (40, 90, 90), np.uint8)
    for contour in body.contour(np.atleast_2d(states)) if len(states) else ():
        for stroke in body.strokes:
            points = np.round(contour[stroke.first : stroke.last] * 16).astype(np.int32)
            if stroke.closed:
                cv2.fillPoly(image, [points], (255, 140, 20), cv2.LINE_AA, 4)
            else:
                cv2.polylines(image, [points], False, (255, 140, 20), 7, cv2.LINE_AA, 4)
    return image


def swimming(frames, heading, seed, middle=(320.0, 240.0), speed=7.0):
    """A fish that beats its tail and passes ``middle`` half way."""
    time = np.arange(frames)
    bend = 0.5 * np.sin(2 * np.pi * time / 14 + seed)
    turned = heading + np.cumsum(0.1 * bend)
    way = np.cumsum((speed + 3 * np.abs(bend))[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1), axis=0)
    return np.column_stack([way - way[frames // 2] + middle, turned, bend])


def follow(tracker, states, body=FISH):
    for index, now in enumerate(states):
        tracker.update(Frame(index, index / 25, picture(now, body)))
    return tracker.tracks()


def worst(track, states):
    return float(np.linalg.norm(track.states[:, :2] - states[:, :2], axis=1).max())


def test_one_fish_is_followed_with_heading_and_bend():
    way = swimming(40, 0.4, seed=1)
    (track,) = follow(DeformableTracker(FISH, MOTION, ORANGE, starts=way[:1]), way[:, None])
    assert worst(track, way) < 6.0
    error = np.abs(np.angle(np.exp(1j * (track.states - way)[5:, 2:])))
    assert np.all(error.mean(axis=0) < [0.1, 0.2])
    assert set(track.statuses) == {"tracking"}
    assert 0.0 < track.scores.min() <= track.scores.max() <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.5, 1.5])
def test_fish_that_cross_keep_apart(angle):
    ways = [swimming(50, angle / 2, seed=1), swimming(50, -angle / 2, seed=2)]
    both = np.stack(ways, axis=1)
    assert np.linalg.norm(both[:, 0, :2] - both[:, 1, :2], axis=1).min() < 10.0
    kept = 0
    for seed in range(4):
        tracks = follow(DeformableTracker(FISH, MOTION, ORANGE, starts=both[0], seed=seed), both)
        kept += sum(worst(track, way) < 20.0 for track, way in zip(tracks, ways, strict=True))
    assert kept >= 7


def test_bodies_are_found_where_nothing_is_known():
    now = np.array([[150.0, 120.0, 2.5, 0.6], [450.0, 300.0, -0.8, -0.4]])
    found = find_starts(EdgeImage.of(picture(now), ORANGE), FISH, np.random.default_rng(0))
    found = found[np.argsort(found[:, 0])]
    np.testing.assert_allclose(found[:, :2], now[:, :2], atol=4.0)
    np.testing.assert_allclose(np.angle(np.exp(1j * (found[:, 2:] - now[:, 2:]))), 0.0, atol=0.3)


def test_known_bodies_are_not_found_again():
    now = np.array([[300.0, 200.0, 0.0, 0.0], [330.0, 260.0, 0.6, 0.3]])
    edges = EdgeImage.of(picture(now), ORANGE)
    (other,) = find_starts(edges, FISH, np.random.default_rng(0), list(FISH.contour(now[:1])))
    np.testing.assert_allclose(other[:2], now[1, :2], atol=4.0)
    assert len(find_starts(edges, FISH, np.random.default_rng(0), list(FISH.contour(now)))) == 0


def test_a_body_that_vanishes_is_lost_and_found_again():
    way = swimming(60, 0.2, seed=3, speed=5.0)
    tracker = DeformableTracker(FISH, MOTION, ORANGE, starts=way[:1])
    hidden = range(15, 40)
    (track,) = follow(tracker, [way[i : i + 1] if i not in hidden else way[:0] for i in range(60)])
    assert set(track.statuses[15:40]) == {"lost"}
    assert np.isfinite(track.states).all()
    assert track.statuses[-1] == "tracking"
    assert np.linalg.norm(track.states[-1, :2] - way[-1, :2]) < 8.0


def test_a_body_that_goes_elsewhere_is_searching_and_then_lost():
    way = np.tile([[300.0, 240.0, 0.0, 0.0]], (25, 1))
    away = np.array([[80.0, 60.0, 0.0, 0.0]])
    settings = DeformableSettings(particles=200, patience=8)
    walk = RandomWalk(Noise.independent(np.zeros(4), np.array([1.0, 1.0, 0.02, 0.02])))
    tracker = DeformableTracker(FISH, walk, ORANGE, settings, way[:1])
    (track,) = follow(tracker, [way[i : i + 1] if i < 5 else away for i in range(25)])
    assert track.statuses[:5] == ("tracking",) * 5
    assert track.statuses[5:13] == ("searching",) * 8
    # Lost, it is put onto the region that nothing explains.
    assert "tracking" in track.statuses[13:]
    np.testing.assert_allclose(track.states[-1, :2], away[0, :2], atol=8.0)


def test_the_ball_is_followed_by_the_same_tracker():
    body = Ball(diameter=50.0)
    frames = np.arange(30)
    squash = np.where(np.abs(frames - 15) < 3, 0.35, 0.0)
    way = np.column_stack([320 + 9.0 * np.abs(frames - 15), 100 + 7.0 * frames, 0.0 * frames, squash])
    walk = RandomWalk(Noise.independent(np.zeros(4), np.array([10.0, 8.0, 0.6, 0.2])))
    (track,) = follow(DeformableTracker(body, walk, ORANGE, starts=way[:1]), way[:, None], body)
    assert worst(track, way) < 6.0
    assert np.all(np.abs(track.states[:, 3]) <= body.limits[3, 1])
    # The axis of a round ball is anywhere, and takes a frame or two to turn: the outline tells, not the state.
    extents = np.ptp(body.contour(track.states[14:18]), axis=1)
    assert extents[:, 0].mean() < 0.85 * extents[:, 1].mean()
    assert wide_noise(body).deviation[3] == pytest.approx(0.15)


def test_same_seed_same_states():
    way = swimming(6, 0.4, seed=1)
    first, second, other = (
        follow(DeformableTracker(FISH, MOTION, ORANGE, starts=way[:1], seed=seed), way[:, None])[0].states
        for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)


def test_the_mask_of_contours_covers_them_and_their_margin():
    contour = FISH.contour(np.array([[200.0, 200.0, 0.3, 0.2]]))[0]
    mask = contours_mask((640, 480), [contour])
    inside = mask[tuple(np.round(contour).astype(int).T[::-1])]
    assert np.all(inside == 255)
    assert mask[200, 240] == 0


@pytest.mark.parametrize(
    "bad",
    [{"particles": 0}, {"patience": -1}, {"smooth": 4}, {"spread": 0.0}],
)
def test_impossible_settings_are_refused_by_name(bad):
    with pytest.raises(ValidationError, match=next(iter(bad))):
        DeformableSettings(**bad)
