"""The settings of the rows, chosen on the validation rooms; the result store keeps what every choice is worth there.

What the store is asked takes folders of `observe` instead of what is in them, so that an entry is known by the
observations. No entry depends on the rule: choosing by another one costs nothing where the lowest score is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.trainers.experiments.fisheye.observations import Observed, read_observed
from tsuiseki.trainers.experiments.fisheye.rows import ROWS, Choice, Row, pair_of, run_row, score
from tsuiseki.trainers.experiments.store import Store

Rule = Literal["mota", "mota-and-idf1"]
"""What settings are chosen by: MOTA, or the mean of MOTA and IDF1."""
RULES: tuple[Rule, ...] = ("mota", "mota-and-idf1")
LEAST_SCORES = (0.2, 0.3, 0.4, 0.5, 0.6)
Clips = Sequence[Sequence[Path]]


@dataclass(frozen=True)
class Graded:
    """Settings of a row, and its scores on the validation rooms with them.

    Attributes:
        choice: settings by name.
        mota: up to 1.
        idf1: in [0, 1].
    """

    choice: Choice
    mota: float
    idf1: float


def worth(graded: Graded, rule: Rule) -> float:
    """What settings are chosen by."""
    return graded.mota if rule == "mota" else (graded.mota + graded.idf1) / 2


def grade(row: Row, validation: Sequence[Observed], choice: Choice, least: float) -> Graded:
    """The scores of a choice over the validation sequences."""
    found = score([pair_of(str(k), o, run_row(row, o, choice, least)) for k, o in enumerate(validation)])
    return Graded(choice, found.mota, found.idf1)


def best_choice(row: Row, rule: Rule, graded: Callable[[list[Choice]], list[Graded]]) -> Graded:
    """The choice of the row's grid that is worth most, and the score to start a track before and after the rest."""

    def best(choices: list[Choice]) -> Graded:
        return max(graded(choices), key=lambda one: worth(one, rule))

    grid = list(row.choices())
    if not row.starts:
        return best(grid)
    start = best(_starts(row, _middle(row))).choice["start_score"]
    found = best([{**choice, "start_score": start} for choice in grid])
    return best(_starts(row, found.choice))


def _middle(row: Row) -> Choice:
    choices = list(row.choices())
    return choices[len(choices) // 2]


def _starts(row: Row, choice: Choice) -> list[Choice]:
    return [{**choice, "start_score": start} for start in row.starts]


def lowest_score(store: Store, names: Sequence[str], clips: Clips, rule: Rule) -> float:
    """The lowest score of a detection with which some rows are worth most in the mean.

    Each row has the middle of its grid, so that the score suits none better than the others, and the score to start a
    track that is best then: weak detections help a row only where they start nothing.

    Args:
        store: keeps the scores.
        names: of the rows.
        clips: folders of the parts of each validation sequence.
        rule: what counts.
    """

    def mean_worth(least: float) -> float:
        rows = [row_named(name) for name in names]
        found = [store.recall(grades, row.name, clips, _starts(row, _middle(row)), least) for row in rows]
        return float(np.mean([max(worth(one, rule) for one in each) for each in found]))

    return max(LEAST_SCORES, key=mean_worth)


def select(store: Store, row: Row, clips: Clips, least: float, rule: Rule) -> Graded:
    """The settings of a row that are worth most on the validation sequences."""
    return best_choice(row, rule, lambda choices: store.recall(grades, row.name, clips, choices, least))


def row_named(name: str) -> Row:
    """One of `ROWS`."""
    return next(row for row in ROWS if row.name == name)


def grades(name: str, clips: Clips, choices: Sequence[Choice], least: float) -> list[Graded]:
    """The scores of some settings of the row ``name`` on the validation sequences."""
    validation = [_read(tuple(parts)) for parts in clips]
    return [grade(row_named(name), validation, choice, least) for choice in choices]


def tracked(name: str, parts: Sequence[Path], choice: Choice, least: float) -> list[FloorTrack]:
    """The tracks of the row ``name`` in a sequence, in the seconds that have a truth."""
    return run_row(row_named(name), _read(tuple(parts)), choice, least)


@lru_cache(maxsize=16)
def _read(parts: tuple[Path, ...]) -> Observed:
    return read_observed(parts)
