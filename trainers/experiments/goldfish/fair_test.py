"""Whether the correlation of (15) helps a filter (`reproduce goldfish-correlation`).

Motion is learnt from exact states, so that no measurement noise hides the correlation; particles are few, so that
there is something to gain; each arm is widened as suits it on development clips; and beside survival stand the
evidence, the effective sample size and the error of the position.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.fish.goldfish import GoldfishSettings, write_goldfish
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.bodies.silhouettes import centre_inside
from tsuiseki.tracking.formats.bodies.states import read_states
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.bodies.motion import Steps, learn_motion, pooled_steps
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, at_least_one
from tsuiseki.trainers.experiments.goldfish.arms import Learnt
from tsuiseki.trainers.experiments.goldfish.fair_arms import ARMS
from tsuiseki.trainers.experiments.goldfish.fair_tables import Results, Row, fair_outcome
from tsuiseki.trainers.experiments.goldfish.runs import Clip, prepare_clip
from tsuiseki.trainers.experiments.goldfish.step_density import learnt_densities
from tsuiseki.trainers.experiments.goldfish.trials import BODY, EXTRACTION, TRACKER, write_learning_tracks
from tsuiseki.trainers.experiments.store import Store

PARTICLES = (25, 50, 100)
WIDTHS = (0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6)
SPREAD = 10.0
"""``sigma_d`` of (7), pixels squared: a contour that is 5 pixels off is then clearly worse than one that fits."""
FLOOR = -20.0
"""Least log-evidence that a frame counts: a fish that is lost would otherwise be all that is seen."""
FARTHEST = 28.0
"""Largest error of the position that a frame counts, half a fish, pixels; tuned by the mean of this."""
# Fish of the clips, and seeds of their scenes: apart from each other and from those of section 5.
LEARNING, DEVELOPMENT, TEST = (2, 3, 2), (2, 2, 3) * 2, (2, 3, 2) * 8
SEEDS = {"learning": 4_000_000, "development": 5_000_000, "test": 7_000_000}
LEARNING_PARTICLES = 3000
DEVELOPMENT_SEED = 100
UNFINISHED = Outcome(notes=["not all runs are done; run the same command again to go on"], finished=False)
STEPS = {"own": tuple(ARMS), "equal": tuple(ARMS), "as B": ("B", "C", "conditional")}
"""How wide arms are: as suits each, as suits all in the mean, as suits B; and which are run so."""


def reproduce(
    bench: Bench,
    particles: tuple[int, ...] = PARTICLES,
    seeds: int = 2,
    clips: int = 6,
    development: int = 3,
    minutes: float = 1000.0,
) -> Outcome:
    """Whether few particles gain by drawing changes of shape and motion together, as the goldfish paper does.

    Generates 3 clips to learn from, 3 to choose each arm's widening on and 6 to test on. DIR gets results.json and
    tables.md: nats of a step, then survival, position error, log-evidence and effective sample size of the arms, each
    as wide as suits it, all equally wide, and as wide as suits independent noise.

    Args:
        bench: where it works.
        particles: numbers of them.
        seeds: of the particles.
        clips: test clips, from 2 to 24.
        development: clips to choose the widening on, from 1 to 6.
        minutes: begin no new run after so many; run it again to go on.

    Raises:
        RequestError: no seed, too few clips, or no time.
    """
    started = time.monotonic()
    at_least_one(seeds=seeds, particles=min(particles, default=0))
    if not 2 <= clips <= len(TEST):
        raise RequestError(f"`clips`: expected 2 to {len(TEST)}, got {clips}")
    if not 1 <= development <= len(DEVELOPMENT):
        raise RequestError(f"`development`: expected 1 to {len(DEVELOPMENT)}, got {development}")
    if not minutes > 0:
        raise RequestError(f"`minutes`: expected a number above 0, got {minutes:g}")
    counts = {"learning": len(LEARNING), "development": development, "test": clips}
    folders = {part: _clips(bench.store, part, counts[part]) for part in SEEDS}
    test = folders["test"]
    steps, learnt = learn_exactly(folders["learning"])
    wide = _wide_steps(bench.store, folders["learning"])
    nats = learnt_densities(steps, wide, [learn_exactly([folder])[0] for folder in test])
    until = started + 60 * minutes
    arms = [(name, number) for name in ARMS for number in particles]
    asked = [_Asked(*arm, width, DEVELOPMENT_SEED) for arm in arms for width in WIDTHS]
    rows = _run_all(bench, learnt, folders["development"], asked, "development clips", until)
    if rows is None:
        return UNFINISHED
    tuned = {
        arm: np.array([np.mean([r.error for r in rows[_Asked(*arm, w, DEVELOPMENT_SEED)]]) for w in WIDTHS])
        for arm in arms
    }
    widths = {
        step: {(name, number): _width(step, name, number, tuned) for name in names for number in particles}
        for step, names in STEPS.items()
    }
    asked = [_Asked(*arm, width, seed) for of in widths.values() for arm, width in of.items() for seed in range(seeds)]
    rows = _run_all(bench, learnt, test, list(dict.fromkeys(asked)), "test clips", until)
    if rows is None:
        return UNFINISHED
    found: dict[str, Results] = {
        step: {
            arm: (width, [_mean(of) for of in zip(*(rows[_Asked(*arm, width, s)] for s in range(seeds)), strict=True)])
            for arm, width in of_step.items()
        }
        for step, of_step in widths.items()
    }
    note = f"{clips} test clips, {seeds} seeds; 95 % by Student's t over clips; sigma_d {SPREAD:g}"
    return fair_outcome(nats, tuned, WIDTHS, found, note)


@dataclass(frozen=True)
class _Asked:
    """A run on every clip: see `run_arm`."""

    arm: str
    particles: int
    width: float
    seed: int


def _run_all(
    bench: Bench, learnt: Learnt, folders: Sequence[Path], asked: Sequence[_Asked], what: str, until: float
) -> dict[_Asked, list[Row]] | None:
    """The rows of each clip for all that is asked; None where the time was over first.

    All runs on a clip come before those on the next, since a prepared clip takes some 300 MB.
    """
    rows: dict[_Asked, list[Row]] = {one: [] for one in asked}
    for folder in bench.watch.over(folders, what, len(folders)):
        for one in asked:
            if time.monotonic() > until:
                return None
            row = bench.store.recall(run_arm, folder, one.arm, learnt, one.particles, one.width, one.seed)
            rows[one].append(row)
    return rows


def _width(step: str, name: str, number: int, tuned: Mapping[tuple[str, int], FloatArray]) -> float:
    """The width of the least error on the development clips: the arm's own, that of all arms in the mean, or B's."""
    if step == "equal":
        errors = np.mean([tuned[arm, number] for arm in ARMS], axis=0)
    else:
        errors = tuned[name if step == "own" else "B", number]
    return WIDTHS[int(np.argmin(errors))]


def learn_exactly(folders: Sequence[Path]) -> tuple[Steps, Learnt]:
    """Steps of the exact states of clips, and the motion learnt from them."""
    states = [fish.states for folder in folders for fish in read_states(folder / "states.csv", BODY.fields)]
    motion = learn_motion(states, BODY.name, BODY.fields, BODY.angles, read_sequence(folders[0]).frame_rate)
    steps = pooled_steps(states, BODY.angles)
    return steps, Learnt(motion, steps)


def run_arm(folder: Path, arm: str, learnt: Learnt, particles: int, width: float, seed: int) -> Row:
    """All fish of a clip from their exact first states.

    Args:
        folder: of the clip.
        arm: key of `ARMS`.
        learnt: what it draws from.
        particles: of each fish.
        width: times the learnt deviations.
        seed: of the particles.
    """
    clip = _prepared(folder)
    moves = ARMS[arm][1](learnt)
    moves = replace(moves, noise=moves.noise.widened(width))
    settings = replace(TRACKER, particles=particles, spread=SPREAD)
    starts = np.array([fish.states[0] for fish in clip.fish])
    tracker = DeformableTracker(BODY, moves, None, settings, starts, seed)
    frames, fish = len(clip.edges), len(clip.fish)
    inside = np.ones((frames, fish), dtype=np.bool_)
    away, evidence, effective = np.zeros((3, frames, fish))
    for index, edges in enumerate(clip.edges):
        tracker.update_edges(index, edges)
        for row, target in enumerate(tracker.targets):
            place = target.estimate[:2]
            inside[index, row] = centre_inside(clip.silhouettes[index : index + 1], target.id, place[None])[0]
            away[index, row] = np.linalg.norm(place - clip.fish[row].states[index, :2])
            evidence[index, row] = target.log_evidence
            effective[index, row] = target.effective_sample_size / particles
    survived = np.logical_and.accumulate(inside, axis=0)
    return Row(
        float(survived.mean()),
        float(np.minimum(away, FARTHEST)[1:].mean()),
        float(np.maximum(evidence, FLOOR)[1:].mean()),
        float(effective[1:].mean()),
    )


@lru_cache(maxsize=1)
def _prepared(folder: Path) -> Clip:
    """The clip, once for all runs on it that follow each other."""
    return prepare_clip(folder, BODY, EXTRACTION)


def _clips(store: Store, part: str, number: int) -> list[Path]:
    counts = {"learning": LEARNING, "development": DEVELOPMENT, "test": TEST}[part][:number]
    return [
        store.made(f"{part}-{n + 1:02d}", write_goldfish, GoldfishSettings(fish=count), SEEDS[part] + n)
        for n, count in enumerate(counts)
    ]


def _wide_steps(store: Store, folders: Sequence[Path]) -> Steps:
    """What the paper's learning run with wide noise sees of the same clips."""
    files = [store.made(f"{f.name}.csv", write_learning_tracks, f, LEARNING_PARTICLES) for f in folders]
    tracks = [track for file in files for track in read_states(file, BODY.fields)]
    return pooled_steps([part for track in tracks for part in track.stretches()], BODY.angles)


def _mean(rows: Sequence[Row]) -> Row:
    return Row(*(float(np.mean([getattr(row, name) for row in rows])) for name in Row.__dataclass_fields__))
