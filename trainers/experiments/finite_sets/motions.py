"""Targets that are calm and agile by turns, followed by one motion or by two (`reproduce phd-motions`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace

import numpy as np

from tsuiseki.tracking.types.measurements import MotionSettings, SensingModel
from tsuiseki.trainers.experiments.finite_sets.unseen import run_ours
from tsuiseki.trainers.experiments.finite_sets.unseen_scenarios import STANDARD_PLACES, UnseenSettings
from tsuiseki.trainers.experiments.finite_sets.unseen_scores import UnseenRun
from tsuiseki.trainers.experiments.intervals import interval
from tsuiseki.trainers.experiments.study import Bench, Outcome, Table, at_least_one

CALM, AGILE = 1.0, 20.0
"""Standard deviations of the acceleration, units a second squared."""
SCENARIO = UnseenSettings(first=0, births=0.12, places=STANDARD_PLACES, bends=CALM, agile=AGILE, leave="gone")
MOTIONS: Mapping[str, tuple[float, ...]] = {
    "calm": (CALM,),
    "between: the root of the mean square": (float(np.sqrt((CALM**2 + AGILE**2) / 2)),),
    "agile": (AGILE,),
    "calm and agile take turns": (CALM, AGILE),
}
TURNS = list(MOTIONS)[-1]
FIRST_SEED = 800


def reproduce(bench: Bench, seeds: int = 20, particles: int = 1000, seed: int = FIRST_SEED) -> Outcome:
    """Labelled tracks of targets that are calm and agile by turns: one motion, or two that take turns.

    The scenarios are those of phd-unseen with known places of birth. DIR gets results.json and tables.md.

    Args:
        bench: where it works.
        seeds: scenarios.
        particles: of each target.
        seed: of the first scenario.

    Raises:
        RequestError: a number is below 1.
    """
    at_least_one(seeds=seeds, particles=particles)
    runs: dict[str, list[UnseenRun]] = {name: [] for name in MOTIONS}
    for number in bench.watch.over(range(seed, seed + seeds), "scenarios", seeds):
        for name in MOTIONS:
            run = bench.store.recall(run_ours, SCENARIO, number, "labelled", particles, 0, model_of(name))
            runs[name].append(run)
    lines = []
    for name, own in runs.items():
        gaps = np.array([a.scores.ospa1 - b.scores.ospa1 for a, b in zip(runs[TURNS], own, strict=True)])
        mean, low, high = interval(gaps)
        scores = [run.scores for run in own]
        means = [np.mean([getattr(one, field) for one in scores]) for field in FIELDS]
        gap = "" if name == TURNS else f"{mean:+.2f} [{low:+.2f}, {high:+.2f}]"
        milliseconds = np.median([run.milliseconds for run in own])
        lines.append([name, *(f"{value:.2f}" for value in means), f"{milliseconds:.2f}", gap])
    columns = ("motion", "OSPA p=1", "OSPA(2)", "missed a scan", "false a scan", "switches", "ms a step")
    note = (
        f"{seeds} scenarios from seed {seed}; accelerations {CALM:g} and {AGILE:g}, {SCENARIO.switching:g} changes a "
        "second; 95 % by Student's t, paired by scenario."
    )
    values = {name: [asdict(run) for run in own] for name, own in runs.items()}
    return Outcome(values, [Table("", (*columns, "turns − this, OSPA p=1"), lines)], notes=[note])


FIELDS = ("ospa1", "ospa_tracks", "missed", "false", "switches")


def model_of(name: str) -> SensingModel:
    """The model of the scenario with the motions of a row."""
    motions = tuple(MotionSettings("constant-velocity", acceleration) for acceleration in MOTIONS[name])
    return replace(SCENARIO.model, motions=motions, switching=SCENARIO.switching)
