"""What the trials of the goldfish experiment add up to: counts of fish, intervals over seeds, frames per second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.experiments.goldfish.arms import ARMS, BEYOND
from tsuiseki.trainers.experiments.goldfish.trials import Trial
from tsuiseki.trainers.experiments.intervals import interval, paired_interval

# What is compared with what: name, arm and number of particles, twice. The first is the paper's claim.
CLAIMS = (
    ("the paper: C with 500 against A with 3000", "C", 500, "A", 3000),
    ("C as printed with 500 against A with 3000", "P", 500, "A", 3000),
    ("correlation: C against B, 500", "C", 500, "B", 500),
    ("correlation: C against B, 100", "C", 100, "B", 100),
    ("body-fixed velocity: B against A, 500", "B", 500, "A", 500),
    ("body-fixed and not image velocity: B against D, 500", "B", 500, "D", 500),
    ("what is added and not what is printed: C against (14), 500", "C", 500, "P", 500),
)


@dataclass(frozen=True)
class Successes:
    """Which fish were followed to the end.

    Attributes:
        success: ``(S, F)`` by seed and fish.
        turning: ``(F,)`` fish with a sudden turn.
        seconds: of CPU for one fish in one frame.
        used: mean number of particles.
    """

    success: BoolArray
    turning: BoolArray
    seconds: float
    used: float

    def counts(self, turning_only: bool) -> FloatArray:
        """``(S,)`` fish followed to the end."""
        chosen = self.success[:, self.turning] if turning_only else self.success
        return np.asarray(chosen.sum(axis=1), dtype=np.float64)


def gather(trials: Sequence[Trial]) -> dict[tuple[str, str, int], Successes]:
    """Successes by part, arm and number of particles; only seeds that every clip has."""
    clips = sorted({trial.clip for trial in trials})
    by_place = {(trial.seed, trial.clip): trial for trial in trials}
    seeds = [seed for seed in sorted({p.seed for p in trials}) if all((seed, clip) in by_place for clip in clips)]
    rows = [[by_place[seed, clip] for clip in clips] for seed in seeds]
    found = {}
    for number, first in enumerate(rows[0][0].runs if rows else ()):
        success = [[s == p.frames for p in row for s in p.runs[number].survived] for row in rows]
        runs = [trial.runs[number] for row in rows for trial in row]
        frames = sum(run.fish_frames for run in runs)
        found[first.part, first.arm, first.particles] = Successes(
            np.array(success, dtype=np.bool_),
            np.array([turns > 0 for trial in rows[0] for turns in trial.turns]),
            sum(run.seconds for run in runs) / frames,
            float(np.average([run.used for run in runs], weights=[run.fish_frames for run in runs])),
        )
    return found


def summarise(trials: Sequence[Trial]) -> dict[str, Any]:
    """Tables for ``results.json``: counts with intervals, claims, frames per second."""
    found = gather(trials)
    any_run = next(iter(found.values()))
    preparation = float(np.mean([trial.preparation for trial in trials]))
    table = [
        {
            "part": part,
            "arm": arm,
            "title": (ARMS if part == "arms" else BEYOND)[arm].title,
            "particles": particles,
            "used": value.used,
            "all": interval(value.counts(turning_only=False)),
            "turning": interval(value.counts(turning_only=True)),
            "frames_per_second": 1.0 / (preparation + value.seconds),
            "milliseconds": 1000.0 * value.seconds,
        }
        for (part, arm, particles), value in found.items()
    ]
    claims = [
        {
            "claim": text,
            "all": _difference(found, first, second, turning_only=False),
            "turning": _difference(found, first, second, turning_only=True),
        }
        for text, *four in CLAIMS
        if (first := ("arms", four[0], four[1])) in found and (second := ("arms", four[2], four[3])) in found
    ]
    return {
        "fish": int(any_run.success.shape[1]),
        "turning": int(any_run.turning.sum()),
        "seeds": int(any_run.success.shape[0]),
        "preparation_milliseconds": 1000.0 * preparation,
        "table": table,
        "claims": claims,
    }


def _difference(
    found: dict[tuple[str, str, int], Successes],
    first: tuple[str, str, int],
    second: tuple[str, str, int],
    turning_only: bool,
) -> tuple[float, float, float]:
    return paired_interval(found[first].counts(turning_only), found[second].counts(turning_only))
