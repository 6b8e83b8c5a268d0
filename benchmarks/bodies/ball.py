"""How near the tracker keeps to a ball that squashes: random walk and learnt proposals at equal numbers of particles.

    OMP_NUM_THREADS=1 python -m benchmarks.bodies.ball

Motion is learnt from a wide 3,000-particle run over one clip, and again from that clip's exact states; the others are
tested on. Errors are means over clips, seeds and frames.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.scenes.body_clip import BouncingBallSettings, BouncingClip
from tsuiseki.tracking.bodies.body import Ball
from tsuiseki.tracking.bodies.contour import EdgeImage, Extraction
from tsuiseki.tracking.bodies.settings import DeformableSettings
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.features.colour_region import parse_colour
from tsuiseki.tracking.filters.body_motion import BodyMotion, Noise, RandomWalk
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.learn_motion import learn_motion

BODY = Ball()
EXTRACTION = Extraction(parse_colour("red"))
LEARNING_CLIP, TEST_CLIPS, SEEDS = 100, (200, 201), (0, 1)
WIDE = Noise.independent(np.zeros(4), np.array([12.0, 12.0, np.pi / 4, 0.15]))
SQUASHED = 0.15


@dataclass(frozen=True)
class Clip:
    """Exact states ``(T, 4)`` and the edges of each frame."""

    states: FloatArray
    edges: list[EdgeImage]


def make_clip(seed: int, settings: BouncingBallSettings) -> Clip:
    """A generated clip as the tracker sees it."""
    images, states = zip(*BouncingClip(settings, seed).frames(), strict=True)
    return Clip(np.stack(states)[:, 0], [EdgeImage.of(image, EXTRACTION) for image, _ in images])


def follow(clip: Clip, motion: BodyMotion, particles: int, seed: int = 0) -> FloatArray:
    """Estimated states ``(T, 4)``."""
    settings = DeformableSettings(particles, spread=10.0)
    tracker = DeformableTracker(BODY, motion, EXTRACTION, settings, clip.states[:1], seed)
    for index, edges in enumerate(clip.edges):
        tracker.update_edges(index, edges)
    return tracker.tracks()[0].states


def errors(clip: Clip, states: FloatArray) -> tuple[float, float]:
    """Mean error of the centre in pixels, and of the squash where the ball is squashed."""
    squashed = clip.states[:, 3] > SQUASHED
    centre = np.linalg.norm(states[:, :2] - clip.states[:, :2], axis=1).mean()
    return float(centre), float(np.abs(states[squashed, 3] - clip.states[squashed, 3]).mean())


def main() -> None:
    """Prints the table."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    settings = BouncingBallSettings(frames=240)
    learning, *tests = (make_clip(seed, settings) for seed in (LEARNING_CLIP, *TEST_CLIPS))
    wide = follow(learning, RandomWalk(WIDE), 3000)
    mean_squash = learning.states[learning.states[:, 3] > SQUASHED, 3].mean()
    print("wide run: centre {:.2f} px, squash {:.3f} of {:.3f}".format(*errors(learning, wide), mean_squash))
    for source, states in (("wide run", wide), ("exact states", learning.states)):
        learnt = learn_motion([states], BODY.name, BODY.fields, BODY.angles, settings.frame_rate)
        motions: dict[str, BodyMotion] = {
            "walk": learnt.random_walk(),
            "independent": learnt.independent(),
            "learnt": learnt.proposal(),
        }
        for particles in (50, 300):
            for name, motion in motions.items():
                found = [errors(clip, follow(clip, motion, particles, seed)) for clip in tests for seed in SEEDS]
                centre, squash = np.mean(found, axis=0)
                print(
                    f"from {source}, {particles:>4} particles, {name:12} centre {centre:5.2f} px, squash {squash:.3f}"
                )


if __name__ == "__main__":
    main()
