"""Balls: the walls squash them by what they reach beyond, and nothing else does."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes.body_clip import DIAMETER, GRAVITY, WALL, BouncingBallSettings, BouncingClip
from tsuiseki.tracking.bodies.body import Ball
from tsuiseki.tracking.formats.body_states import silhouette_of

SETTINGS = BouncingBallSettings(frames=300, balls=2)


@pytest.fixture(scope="module")
def ways():
    return BouncingClip(SETTINGS, 4).states


def reach_beyond_walls(centres, radius):
    """How far a round ball would reach beyond the nearest wall, and that wall's direction."""
    gaps = np.stack(
        [centres[..., 0] - WALL, SETTINGS.width - WALL - centres[..., 0],
         centres[..., 1] - WALL, SETTINGS.height - WALL - centres[..., 1]], axis=-1,
    )  # fmt: skip
    return radius - gaps.min(axis=-1), np.array([np.pi, 0, -np.pi / 2, np.pi / 2])[gaps.argmin(axis=-1)]


def test_a_touching_ball_just_fits_before_its_wall(ways):
    radius = DIAMETER / 2
    depth, direction = reach_beyond_walls(ways[..., :2], radius)
    touching = depth > 3.0  # more than a step of the simulation moves
    assert touching.sum() > 10
    # The state is written after the ball moved and before it is squashed: one step of 1/240 s lies between.
    assert ways[touching, 3] * radius == pytest.approx(depth[touching], abs=3.0)
    assert np.array_equal(ways[touching, 2], direction[touching])


def test_a_free_ball_is_round_and_never_turns(ways):
    depth, _ = reach_beyond_walls(ways[..., :2], DIAMETER / 2)
    free = (depth[1:] < -20) & (depth[:-1] < -20)
    assert free.sum() > 100
    assert np.all(np.diff(ways[..., 2], axis=0)[free] == 0)
    assert ways[1:][free][:, 3].max() < 0.02
    assert ways[..., 3].min() >= 0


def test_gravity_alone_accelerates_a_free_ball(ways):
    depth, _ = reach_beyond_walls(ways[..., :2], DIAMETER / 2)
    free = (depth[2:] < -5) & (depth[1:-1] < -5) & (depth[:-2] < -5)
    bend = np.diff(ways[..., :2], n=2, axis=0)[free]
    assert bend == pytest.approx(np.tile([0, GRAVITY / SETTINGS.frame_rate**2], (len(bend), 1)), abs=1e-6)


def test_balls_never_gain_energy(ways):
    """Against the walls and its losses a bounce never lifts a ball above where it came from."""
    for k in range(2):
        energy = 0.5 * (np.diff(ways[:, k, :2], axis=0) * SETTINGS.frame_rate) ** 2
        height = SETTINGS.height - ways[1:, k, 1]
        total = energy.sum(axis=1) + GRAVITY * height
        depth, _ = reach_beyond_walls(ways[1:, k, :2], DIAMETER / 2)
        free = total[depth < -25]
        assert free.max() < 1.08 * free[:5].mean()  # an explicit step of 1/240 s adds a little against a stiff wall


def test_the_body_fits_the_drawing():
    clip = BouncingClip(BouncingBallSettings(frames=60), seed=3)
    for (_, silhouettes), states in (clip.draw_frame(number) for number in range(0, 60, 4)):
        own = silhouette_of(silhouettes, 1).astype(np.uint8) * 255
        distance = cv2.distanceTransform(255 - cv2.Canny(own, 100, 200), cv2.DIST_L2, 5)
        at = np.clip(np.floor(Ball().contour(states)[0]).astype(int), 0, [639, 479])
        assert distance[at[:, 1], at[:, 0]].max() < 4.0


@pytest.mark.parametrize("wrong", [{"balls": 0}, {"balls": 6}, {"frames": 0}, {"frame_rate": 0.0}, {"height": 200}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        BouncingBallSettings(**wrong)
