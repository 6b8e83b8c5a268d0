"""What it is worth that bodies know of each other: fish followed together and each on its own, from the same edges.

    OMP_NUM_THREADS=1 python -m benchmarks.bodies.neighbours [--clips 4] [--particles 500]

Generated clips of five fish, which cross often; the wide random walk of the paper's learning run, and motion learnt
from the exact states of another clip. A fish is followed to the end when its centre never leaves the silhouette.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.papers.goldfish import BODY, TRACKER, FishClip, prepare_clip
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishClip, GoldfishSettings
from tsuiseki.tracking.bodies.contour import wide_noise
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.filters.body_motion import BodyMotion, RandomWalk
from tsuiseki.tracking.formats.body_states import centre_inside
from tsuiseki.trainers.learn_motion import learn_motion

FISH, FIRST_SEED = 5, 8_000_000


def followed(clip: FishClip, motion: BodyMotion, particles: int, rows: list[int]) -> int:
    """How many of the fish ``rows``, followed by one tracker from their exact first states, are there to the end."""
    starts = np.array([clip.fish[row].states[0] for row in rows])
    tracker = DeformableTracker(BODY, motion, None, replace(TRACKER, particles=particles), starts, 0)
    inside = np.ones(len(rows), dtype=np.bool_)
    for index, edges in enumerate(clip.edges):
        tracker.update_edges(index, edges)
        for place, target in enumerate(tracker.targets):
            shown = clip.silhouettes[index : index + 1]
            inside[place] &= centre_inside(shown, clip.fish[rows[place]].id, target.estimate[None, :2])[0]
    return int(inside.sum())


def main() -> None:
    """Print a row for each motion."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=4)
    parser.add_argument("--particles", type=int, default=500)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folders = [
            write_clip(Path(folder) / f"{n}", GoldfishClip(GoldfishSettings(fish=FISH), FIRST_SEED + n))
            for n in range(asked.clips + 1)
        ]
        clips = [prepare_clip(one) for one in folders]
    exact = [fish.states for fish in clips.pop(0).fish]
    learnt = learn_motion(exact, BODY.name, BODY.fields, BODY.angles, GoldfishSettings().frame_rate)
    motions: Mapping[str, BodyMotion] = {
        "wide random walk": RandomWalk(wide_noise(BODY)),
        "learnt, 1.6 times as wide": learnt.widened(1.6).proposal(),
    }
    print(f"{asked.clips * FISH} fish, {asked.particles} particles each      together    each on its own")
    for name, motion in motions.items():
        together = sum(followed(clip, motion, asked.particles, list(range(FISH))) for clip in clips)
        alone = sum(followed(clip, motion, asked.particles, [row]) for clip in clips for row in range(FISH))
        print(f"{name:36}{together:10}{alone:19}")


if __name__ == "__main__":
    main()
