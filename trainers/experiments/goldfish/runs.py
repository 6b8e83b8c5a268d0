"""Clips of bodies prepared once, and fish followed through them one at a time, section 5 of the goldfish paper.

Edges and distances depend on the frame alone, so that all arms, particle numbers and seeds share them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.fish.turns import count_sudden_turns
from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.bodies.contour import EdgeImage, Extraction
from tsuiseki.tracking.bodies.tracker import DeformableSettings, DeformableTracker
from tsuiseki.tracking.filters.motion.body_motion import BodyMotion
from tsuiseki.tracking.filters.particles.particle_filter import AdaptiveNumber
from tsuiseki.tracking.formats.bodies.silhouettes import centre_inside, read_silhouettes
from tsuiseki.tracking.formats.bodies.states import read_states
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.tracks import BodyTrack
from tsuiseki.tracking.video.source import open_source

# A fish that is not seen is not searched for anew: in the experiment it has failed before.
NEVER = 10**6


@dataclass(frozen=True)
class Clip:
    """A clip, ready to be tracked many times.

    Attributes:
        name: of its folder.
        frame_rate: frames per second.
        edges: of each frame.
        silhouettes: ``(T, H, W)``, see `read_silhouettes`.
        fish: exact states of each.
        preparation: CPU seconds that a frame's edges and distances took.
    """

    name: str
    frame_rate: float
    edges: tuple[EdgeImage, ...]
    silhouettes: ImageArray
    fish: tuple[BodyTrack, ...]
    preparation: float

    @property
    def turns(self) -> tuple[int, ...]:
        """Sudden turns of each fish."""
        return tuple(count_sudden_turns(fish.states) for fish in self.fish)


@dataclass(frozen=True)
class FishRun:
    """One fish of a clip, followed with the others.

    Attributes:
        survived: frames before the estimated centre was outside its silhouette; the clip's length where it never was.
        track: estimates of all frames that were run.
        particles: mean number of them.
    """

    survived: int
    track: BodyTrack
    particles: float


def prepare_clip(folder: Path, body: Body, extraction: Extraction) -> Clip:
    """Read a clip and find its edges."""
    source = open_source(folder)
    edges, seconds = [], 0.0
    for frame in source.frames():
        started = time.process_time()
        edges.append(EdgeImage.of(frame.image, extraction))
        seconds += time.process_time() - started
    fish = tuple(read_states(folder / "states.csv", body.fields))
    return Clip(folder.name, source.frame_rate, tuple(edges), read_silhouettes(folder), fish, seconds / len(edges))


def follow_fish(
    clip: Clip,
    body: Body,
    motion: BodyMotion,
    settings: DeformableSettings,
    seed: int,
    adaptive: AdaptiveNumber | None = None,
) -> list[FishRun]:
    """Follow all fish of a clip from their exact states in the first frame; stop when all have failed."""
    starts = np.array([fish.states[0] for fish in clip.fish])
    tracker = DeformableTracker(body, motion, None, settings, starts, seed, adaptive)
    survived = np.zeros(len(clip.fish), dtype=np.int64)
    numbers = np.zeros(len(clip.fish))
    for index, edges in enumerate(clip.edges):
        tracker.update_edges(index, edges)
        for row, target in enumerate(tracker.targets):
            inside = centre_inside(clip.silhouettes[index : index + 1], target.id, target.estimate[None, :2])
            survived[row] += int(inside[0] and survived[row] == index)
            numbers[row] += len(target.particles)
        if np.all(survived <= index):
            break
    tracks = tracker.tracks()
    return [FishRun(int(s), t, float(n) / len(t)) for s, t, n in zip(survived, tracks, numbers, strict=True)]
