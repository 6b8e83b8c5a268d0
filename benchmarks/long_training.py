"""Trainings of many hours in steps that each end in better files or in nothing.

A step learns from the best files so far and is scored on fixed sets. Its files become the best where one number rises
and no number that is watched falls by more than `LOSS`. The best files and the record lie in the repository, so that a
fresh machine goes on from there. The record has a line of JSON a step; `draw_curve` plots it.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime, timedelta
from datetime import time as time_of_day
from pathlib import Path
from typing import TypeAlias

import numpy as np

from benchmarks.papers.plots import Curve, curves
from tsuiseki.tracking.errors import RunError

# Most that a watched number may fall.
LOSS = 0.01

Scores: TypeAlias = Mapping[str, float]
# From the best files, a folder of the step to work in, which has what an interrupted one left, and the number of the
# step to the exported files of the step.
Fit: TypeAlias = Callable[[Sequence[Path], Path, int], Sequence[Path]]


@dataclass(frozen=True)
class Step:
    """A line of the record.

    Attributes:
        number: from 0, which is what the training started from.
        kept: whether its files became the best.
        why: they did not, or how they were made where no step made them; else empty.
        cpu_hours: that it learnt for.
        date: when it ended, ISO 8601.
        scores: on the fixed sets.
    """

    number: int
    kept: bool
    why: str
    cpu_hours: float
    date: str
    scores: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LongTraining:
    """What a training does in a step, and where it keeps what it has.

    Attributes:
        best: files that the next step starts from; written anew by a step that is better.
        record: the lines of all steps.
        headline: the number that is to rise.
        watched: the numbers that may not get worse by more than `LOSS`.
        falling: those of them that are better when they are smaller.
        fit: learns, and exports files in the order of ``best``.
        score: numbers of such files on the fixed sets, by name.
    """

    best: Sequence[Path]
    record: Path
    headline: str
    watched: Sequence[str]
    falling: Sequence[str]
    fit: Fit
    score: Callable[[Sequence[Path]], Scores]

    def run(self, work: Path, until: datetime) -> None:
        """Steps in ``work``, none of which begins after ``until``; what is there is scored first where it never was."""
        if not read_record(self.record):
            self._add(Step(0, True, "", 0.0, _now(), dict(self.score(self.best))))
        while datetime.now(UTC) < until:
            steps = read_record(self.record)
            number, begun = steps[-1].number + 1, time.process_time()
            folder = work / f"step-{number}"
            folder.mkdir(parents=True, exist_ok=True)
            files = self.fit(self.best, folder, number)
            hours = (time.process_time() - begun) / 3600
            scores = dict(self.score(files))
            before = next(step.scores for step in reversed(steps) if step.kept)
            why = self.reason_against(before, scores)
            if not why:
                for file, best in zip(files, self.best, strict=True):
                    shutil.copyfile(file, best)
            self._add(Step(number, not why, why, round(hours, 3), _now(), scores))

    def reason_against(self, before: Scores, after: Scores) -> str:
        """Why ``after`` is not better than ``before``; empty where it is."""
        if not after[self.headline] > before[self.headline]:
            return f"{self.headline} {before[self.headline]:.4f} to {after[self.headline]:.4f}"
        worse = {name: -1 if name in self.falling else 1 for name in self.watched}
        lost = [name for name, sign in worse.items() if sign * (before[name] - after[name]) > LOSS]
        return ", ".join(f"{name} {before[name]:.3f} to {after[name]:.3f}" for name in lost)

    def _add(self, step: Step) -> None:
        rounded = {name: round(value, 4) for name, value in step.scores.items()}
        with self.record.open("a") as file:
            file.write(json.dumps(asdict(step) | {"scores": rounded}) + "\n")
        print(f"step {step.number}: {self.headline} {step.scores[self.headline]:.4f}; {step.why or 'kept'}", flush=True)


def next_time(text: str) -> datetime:
    """The next time ``text``, such as 16:50, UTC: of today or tomorrow; raises ValueError."""
    now = datetime.now(UTC)
    then = datetime.combine(now.date(), time_of_day.fromisoformat(text), UTC)
    return then if then > now else then + timedelta(days=1)


def command(words: Sequence[str]) -> None:
    """Run ``tsuiseki`` with these words in this process.

    Raises:
        RunError: it failed.
    """
    from tsuiseki.tracking.cli import main

    if main(list(words)) != 0:
        raise RunError(f"`tsuiseki {' '.join(words[:2])}` failed; its message stands above")


def read_record(path: Path) -> list[Step]:
    """The steps so far; none where there is no record."""
    if not path.is_file():
        return []
    return [Step(**json.loads(line)) for line in path.read_text().splitlines()]


def draw_curve(record: Path, names: Sequence[str], out: Path) -> None:
    """Plot the numbers called ``names`` of the steps that were kept over the CPU hours of all steps into ``out``."""
    steps = read_record(record)
    hours = np.cumsum([step.cpu_hours for step in steps])
    kept = np.array([step.kept for step in steps])
    lines = [Curve(name, hours[kept], [step.scores[name] for step in steps if step.kept]) for name in names]
    curves({out.stem: lines}, ["hours of one core"], "", (6.5, 4.0)).savefig(out)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
