"""Trials of the goldfish experiment: what is learnt from wide runs, and all arms on one clip with one seed."""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.fish.goldfish import write_goldfish
from tsuiseki.datamodules.scenes.fish.sets import GoldfishSets, planned_clips
from tsuiseki.tracking.bodies.body_starts import wide_noise
from tsuiseki.tracking.bodies.contour import Extraction
from tsuiseki.tracking.bodies.goldfish import Goldfish
from tsuiseki.tracking.bodies.tracker import DeformableSettings
from tsuiseki.tracking.features.colour_region import ColourRange
from tsuiseki.tracking.filters.motion.body_motion import RandomWalk
from tsuiseki.tracking.formats.bodies.states import read_states, write_states
from tsuiseki.tracking.types import Status
from tsuiseki.tracking.types.tracks import BodyTrack
from tsuiseki.trainers.bodies.motion import learn_motion, pooled_steps
from tsuiseki.trainers.experiments.goldfish.arms import ARMS, BEYOND, Arm, Learnt
from tsuiseki.trainers.experiments.goldfish.runs import NEVER, Clip, follow_fish, prepare_clip
from tsuiseki.trainers.experiments.store import Store

BODY = Goldfish()
# Brighter than the mirror images in the glass; set on development clips.
EXTRACTION = Extraction(ColourRange((10.0, 42.0), (0.42, 1.0), (0.6, 1.0)))
TRACKER = DeformableSettings(patience=NEVER)
LEARNING_PARTICLES = 3000


@dataclass(frozen=True)
class Run:
    """One arm on one clip with one seed.

    Attributes:
        part: ``arms`` or ``beyond``.
        arm: key of `ARMS` or `BEYOND`.
        particles: nominal number of each fish.
        survived: frames of each fish before its estimated centre left its silhouette.
        seconds: of CPU, for all fish, without the preparation of the images.
        fish_frames: how many fish in how many frames that took.
        used: mean number of particles.
    """

    part: str
    arm: str
    particles: int
    survived: tuple[int, ...]
    seconds: float
    fish_frames: int
    used: float


@dataclass(frozen=True)
class Trial:
    """All runs on one clip with one seed.

    Attributes:
        clip: its name.
        seed: of the particles.
        frames: length of the clip.
        turns: sudden turns of each fish.
        preparation: CPU seconds a frame to find edges and distances.
        runs: one for each arm and number.
    """

    clip: str
    seed: int
    frames: int
    turns: tuple[int, ...]
    preparation: float
    runs: tuple[Run, ...]


def goldfish_sets(store: Store, seed: int) -> GoldfishSets:
    """The paper's two sets of clips, each clip made once.

    Args:
        store: keeps them.
        seed: of the clips, 0 to 9,999; all development was done on others than 0.

    Raises:
        RequestError: another seed.
    """
    planned = planned_clips(seed)
    folders = [store.made(clip.name, write_goldfish, clip.settings, clip.seed) for clip in planned]
    learning = sum(clip.name.startswith("learning") for clip in planned)
    return GoldfishSets(tuple(folders[:learning]), tuple(folders[learning:]))


def write_learning_tracks(path: Path, clip: Path, particles: int) -> None:
    """The learning run of section 4.1 on a clip: a fish counts up to the frame before its centre left the silhouette.

    Args:
        path: CSV to write.
        clip: folder of the clip.
        particles: of each fish.
    """
    settings = replace(TRACKER, particles=particles)
    runs = follow_fish(prepare_clip(clip, BODY, EXTRACTION), BODY, RandomWalk(wide_noise(BODY)), settings, seed=0)
    write_states(path, [_believed(run.track, run.survived) for run in runs], BODY.fields)


def learning_tracks(store: Store, sets: GoldfishSets) -> dict[str, list[BodyTrack]]:
    """The tracks of the learning run by clip."""
    made = {
        clip.name: store.made(f"{clip.name}.csv", write_learning_tracks, clip, LEARNING_PARTICLES)
        for clip in sets.learning
    }
    return {name: list(read_states(path, BODY.fields)) for name, path in made.items()}


def learn(tracks: Mapping[str, Sequence[BodyTrack]], frame_rate: float) -> Learnt:
    """What the learning run teaches."""
    stretches = [part for found in tracks.values() for track in found for part in track.stretches()]
    motion = learn_motion(stretches, BODY.name, BODY.fields, BODY.angles, frame_rate)
    return Learnt(motion, pooled_steps(stretches, BODY.angles))


def followed_to_the_end(tracks: Mapping[str, Sequence[BodyTrack]], sets: GoldfishSets) -> tuple[int, int]:
    """How many fish the learning run followed to the end, and how many there were."""
    longest = max(len(list((folder / "img1").iterdir())) for folder in sets.learning)
    every = [track for found in tracks.values() for track in found]
    return sum(int(track.tracking.sum()) == longest for track in every), len(every)


def run_trial(folder: Path, learnt: Learnt, particles: Sequence[int], beyond: Sequence[int], seed: int) -> Trial:
    """Every arm with every number of particles on one clip.

    Args:
        folder: of the clip.
        learnt: what the arms draw from.
        particles: numbers of the arms.
        beyond: numbers of the additions to the third arm.
        seed: of the particles.
    """
    clip = _prepared(folder)
    planned = [
        *(("arms", name, arm, n) for (name, arm), n in itertools.product(ARMS.items(), particles)),
        *(("beyond", name, arm, n) for (name, arm), n in itertools.product(BEYOND.items(), beyond)),
    ]
    runs = tuple(_run(part, name, arm, number, clip, learnt, seed) for part, name, arm, number in planned)
    return Trial(clip.name, seed, len(clip.edges), clip.turns, clip.preparation, runs)


@lru_cache(maxsize=1)
def _prepared(folder: Path) -> Clip:
    """The clip, once for all its seeds."""
    return prepare_clip(folder, BODY, EXTRACTION)


def _run(part: str, name: str, arm: Arm, number: int, clip: Clip, learnt: Learnt, seed: int) -> Run:
    settings = replace(TRACKER, particles=max(1, number // arm.layers), layers=arm.layers)
    started = time.process_time()
    runs = follow_fish(clip, BODY, arm.motion(learnt), settings, seed, arm.number(number))
    seconds = time.process_time() - started
    survived = tuple(run.survived for run in runs)
    used = float(np.mean([run.particles for run in runs])) * arm.layers
    return Run(part, name, number, survived, seconds, sum(len(run.track) for run in runs), used)


def _believed(track: BodyTrack, survived: int) -> BodyTrack:
    """The track with the status ``tracking`` up to where it was right, and ``lost`` from there on."""
    statuses: list[Status] = ["tracking"] * survived
    statuses += ["lost"] * (len(track) - survived)
    return replace(track, statuses=tuple(statuses))
