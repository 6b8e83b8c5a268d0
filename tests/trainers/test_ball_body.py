"""Nothing in tracker and learning is about fish: a ball that squashes, learnt and tracked by the same code."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.body_clip import BouncingBallSettings, BouncingClip
from tsuiseki.tracking.bodies.body import Ball
from tsuiseki.tracking.bodies.contour import EdgeImage, Extraction
from tsuiseki.tracking.bodies.settings import DeformableSettings
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.features.colour_region import parse_colour
from tsuiseki.tracking.filters.body_motion import Noise, RandomWalk
from tsuiseki.tracking.formats.body_states import centre_inside
from tsuiseki.trainers.learn_motion import learn_motion

pytestmark = pytest.mark.slow

BODY = Ball()
EXTRACTION = Extraction(parse_colour("red"))


class BallClip:
    """Exact states ``(T, 4)``, silhouettes and edges of one ball."""

    def __init__(self, seed):
        frames = list(BouncingClip(BouncingBallSettings(frames=150, frame_rate=30.0), seed).frames())
        self.states = np.stack([states[0] for _, states in frames])
        self.silhouettes = np.stack([shown for (_, shown), _ in frames])
        self.edges = [EdgeImage.of(image, EXTRACTION) for (image, _), _ in frames]

    def track(self, motion, particles, seed=0):
        settings = DeformableSettings(particles=particles, spread=10.0)
        tracker = DeformableTracker(BODY, motion, EXTRACTION, settings, self.states[:1], seed)
        for index, edges in enumerate(self.edges):
            tracker.update_edges(index, edges)
        (track,) = tracker.tracks()
        return track.states

    def misses(self, states):
        return np.linalg.norm(states[:, :2] - self.states[:, :2], axis=1)


@pytest.fixture(scope="module")
def clips():
    return [BallClip(seed) for seed in (100, 200)]


@pytest.fixture(scope="module")
def wide(clips):
    """The track of a slow run with wide noise over the first clip, as for learning."""
    noise = Noise.independent(np.zeros(4), np.array([12.0, 12.0, np.pi / 4, 0.15]))
    return clips[0].track(RandomWalk(noise), 3000)


def test_the_ball_is_followed_and_its_squash_is_seen(clips, wide):
    exact = clips[0].states
    assert centre_inside(clips[0].silhouettes, 1, wide[:, :2]).all()
    squashed = exact[:, 3] > 0.15
    assert squashed.sum() >= 5
    assert np.abs(wide[squashed, 3] - exact[squashed, 3]).mean() < 0.4 * exact[squashed, 3].mean()
    # Axis theta and theta + pi are the same.
    assert np.median(np.abs(np.sin(wide[squashed, 2] - exact[squashed, 2]))) < 0.3


def test_the_learnt_motion_keeps_nearer_than_the_walk(clips, wide):
    """Over seeds, at equal numbers of particles, on a clip that was not learnt from."""
    learnt = learn_motion([wide], BODY.name, BODY.fields, BODY.angles, 30.0)
    walk, own = (
        np.mean([clips[1].misses(clips[1].track(motion, 50, seed)).mean() for seed in range(3)])
        for motion in (learnt.random_walk(), learnt.proposal())
    )
    assert own < 0.7 * walk
