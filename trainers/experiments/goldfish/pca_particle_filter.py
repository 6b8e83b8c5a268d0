"""Section 5 of the goldfish paper: how many particles are needed, with and without what was learnt of shape and motion.

Stages, each kept on disk and passed over when it is there: the clips, the learning run, and for every test clip and
seed one piece with all arms and particle numbers. A run that is stopped goes on with the next piece, and an arm that is
new is run alone.
"""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.fish.sets import GoldfishSets, write_goldfish_sets
from tsuiseki.tracking.bodies.goldfish import Goldfish
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.body_motion import RandomWalk
from tsuiseki.tracking.filters.learnt_motion import write_motion
from tsuiseki.tracking.formats.states import BodyTrack, read_states, write_states
from tsuiseki.tracking.likelihoods.colour_region import ColourRange
from tsuiseki.tracking.likelihoods.contour import Extraction
from tsuiseki.tracking.trackers.body_starts import wide_noise
from tsuiseki.tracking.trackers.deformable import DeformableSettings
from tsuiseki.tracking.types import Status
from tsuiseki.trainers.experiments.goldfish.arms import ARMS, BEYOND, Arm, Learnt
from tsuiseki.trainers.experiments.goldfish.runs import NEVER, Clip, follow_fish, prepare_clip
from tsuiseki.trainers.motion import learn_motion, pooled_steps

BODY = Goldfish()
# Brighter than the mirror images in the glass; set on development clips.
EXTRACTION = Extraction(ColourRange((10.0, 42.0), (0.42, 1.0), (0.6, 1.0)))
TRACKER = DeformableSettings(patience=NEVER)
LEARNING_PARTICLES = 3000
PARTICLES = (100, 200, 500, 1000, 2000, 3000)
BEYOND_PARTICLES = (100, 200, 500)


@dataclass(frozen=True)
class Experiment:
    """What to run.

    Attributes:
        clips: seed of the clips, 0 to 9,999; all development was done on others than the default.
        seeds: of the particles; more give narrower intervals.
        particles: numbers to compare.
        beyond: numbers for the additions to the third arm.
    """

    clips: int = 0
    seeds: int = 6
    particles: tuple[int, ...] = PARTICLES
    beyond: tuple[int, ...] = BEYOND_PARTICLES


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
class Piece:
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


def run_pieces(work: Path, experiment: Experiment, minutes: float) -> Iterator[Piece | None]:
    """All pieces of the experiment, old and new; None for each that is still to be run when the minutes are over.

    Args:
        work: folder that keeps clips, tracks and pieces.
        experiment: what to run.
        minutes: after which no new piece is begun.

    Raises:
        RequestError: ``work`` holds another experiment.
    """
    started = time.monotonic()
    _same_experiment(work, experiment)
    sets = write_goldfish_sets(work / "clips", experiment.clips)
    learnt = learn(work, sets)
    for folder in sets.test:
        prepared: Clip | None = None
        for seed in range(experiment.seeds):
            path = work / "pieces" / f"{folder.name}-seed{seed}.json"
            known = _read_piece(path).runs if path.is_file() else ()
            if {_key(run) for run in known} < _keys(experiment):
                if time.monotonic() - started > 60 * minutes:
                    yield None
                    continue
                prepared = prepared or prepare_clip(folder, BODY, EXTRACTION)
                _write(path, asdict(run_piece(prepared, learnt, experiment, seed, known)))
            yield _read_piece(path)


def learn(work: Path, sets: GoldfishSets) -> Learnt:
    """The learning run of section 4.1, and what it teaches.

    A fish counts up to the frame before its centre left the silhouette.
    """
    stretches = []
    for folder in sets.learning:
        path = work / "learning" / f"{folder.name}.csv"
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            clip = prepare_clip(folder, BODY, EXTRACTION)
            settings = replace(TRACKER, particles=LEARNING_PARTICLES)
            runs = follow_fish(clip, BODY, RandomWalk(wide_noise(BODY)), settings, seed=0)
            write_states(path, [_believed(run.track, run.survived) for run in runs], BODY.fields)
        stretches += [part for track in read_states(path, BODY.fields) for part in track.stretches()]
    frame_rate = _frame_rate(sets.learning[0])
    motion = learn_motion(stretches, BODY.name, BODY.fields, BODY.angles, frame_rate)
    write_motion(work / "motion.json", motion)
    return Learnt(motion, pooled_steps(stretches, BODY.angles))


def run_piece(clip: Clip, learnt: Learnt, experiment: Experiment, seed: int, known: Sequence[Run] = ()) -> Piece:
    """Every arm with every number of particles on one clip."""
    done = {_key(run): run for run in known}
    planned = [
        *(("arms", name, arm, n) for (name, arm), n in itertools.product(ARMS.items(), experiment.particles)),
        *(("beyond", name, arm, n) for (name, arm), n in itertools.product(BEYOND.items(), experiment.beyond)),
    ]
    runs = tuple(
        done.get((part, name, number)) or _run(part, name, arm, number, clip, learnt, seed)
        for part, name, arm, number in planned
    )
    return Piece(clip.name, seed, len(clip.edges), clip.turns, clip.preparation, runs)


def _keys(experiment: Experiment) -> set[tuple[str, str, int]]:
    """Part, arm and number of every run of a piece."""
    return {
        *(("arms", name, n) for name, n in itertools.product(ARMS, experiment.particles)),
        *(("beyond", name, n) for name, n in itertools.product(BEYOND, experiment.beyond)),
    }


def _key(run: Run) -> tuple[str, str, int]:
    return run.part, run.arm, run.particles


def _run(part: str, name: str, arm: Arm, number: int, clip: Clip, learnt: Learnt, seed: int) -> Run:
    settings = replace(TRACKER, particles=max(1, number // arm.layers), layers=arm.layers)
    started = time.process_time()
    runs = follow_fish(clip, BODY, arm.motion(learnt), settings, seed, arm.number(number))
    seconds = time.process_time() - started
    survived = tuple(run.survived for run in runs)
    used = float(np.mean([run.particles for run in runs])) * arm.layers
    return Run(part, name, number, survived, seconds, sum(len(run.track) for run in runs), used)


def learning_success(work: Path, sets: Sequence[Path]) -> tuple[int, int]:
    """How many fish the learning run followed to the end, and how many there were."""
    tracks = [t for folder in sets for t in read_states(work / "learning" / f"{folder.name}.csv", BODY.fields)]
    lengths = {folder.name: len(list((folder / "img1").iterdir())) for folder in sets}
    longest = max(lengths.values())
    return sum(int(track.tracking.sum()) == longest for track in tracks), len(tracks)


def _believed(track: BodyTrack, survived: int) -> BodyTrack:
    """The track with the status ``tracking`` up to where it was right, and ``lost`` from there on."""
    statuses: list[Status] = ["tracking"] * survived
    statuses += ["lost"] * (len(track) - survived)
    return replace(track, statuses=tuple(statuses))


def _frame_rate(folder: Path) -> float:
    from tsuiseki.tracking.formats.mot import read_sequence

    return read_sequence(folder).frame_rate


def _same_experiment(work: Path, experiment: Experiment) -> None:
    """Refuse a folder whose pieces were made with other settings; more seeds are welcome."""
    shown: Mapping[str, Any] = {
        **asdict(replace(experiment, seeds=0)),
        "tracker": asdict(TRACKER),
        "extraction": asdict(EXTRACTION),
    }
    text = json.loads(json.dumps(shown))
    path = work / "experiment.json"
    if path.is_file():
        if json.loads(path.read_text(encoding="utf-8")) != text:
            raise RequestError(f"{work} holds pieces of another experiment; give another folder with --work")
        return
    _write(path, text)


def _write(path: Path, values: Any) -> None:
    """Write beside and rename, so that a piece is whole or not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(".unfinished")
    beside.write_text(json.dumps(values) + "\n", encoding="utf-8")
    beside.replace(path)


def _read_piece(path: Path) -> Piece:
    values = json.loads(path.read_text(encoding="utf-8"))
    runs = tuple(Run(**{**run, "survived": tuple(run["survived"])}) for run in values.pop("runs"))
    return Piece(**{**values, "turns": tuple(values["turns"]), "runs": runs})
