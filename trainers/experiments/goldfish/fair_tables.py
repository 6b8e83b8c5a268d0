"""Tables of the goldfish's fair test: each arm with its own width, and all equally wide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.experiment import Outcome, Table
from tsuiseki.trainers.experiments.goldfish.fair_arms import ARMS
from tsuiseki.trainers.experiments.intervals import interval

NATS = (
    "learnt from",
    "correlation of sideways change and bend",
    "independent",
    "together (15) − independent",
    "bend and turn of the frame before − together",
)


COMPARED = (
    ("C", "B"),
    ("C lag", "B lag"),
    ("B lag", "B"),
    ("C lag", "C"),
    ("conditional", "C lag"),
    ("conditional", "B"),
)
TITLES = {
    "own": "each as wide as it was best on the development clips",
    "equal": "all equally wide, as all were best in the mean",
    "as B": "all as wide as B was best",
}
SHOWN = (("survival", 100, 1), ("error", 1, 2), ("evidence", 1, 2))
"""Of a row: the field, its factor and its digits."""


@dataclass(frozen=True)
class Row:
    """One arm on one clip.

    Attributes:
        survival: share of the frames of its fish before the estimated centre left the silhouette.
        error: mean distance of centres, at most `fair_test.FARTHEST` a frame, pixels.
        evidence: mean log-evidence of a frame, at least `fair_test.FLOOR` each.
        effective: mean effective sample size, as a share of the particles.
    """

    survival: float
    error: float
    evidence: float
    effective: float


Results: TypeAlias = dict[tuple[str, int], tuple[float, list[Row]]]
"""By arm and number of particles: the width, and a row for each test clip."""


def fair_outcome(
    nats: Sequence[Sequence[str]],
    tuned: Mapping[tuple[str, int], FloatArray],
    widths: Sequence[float],
    found: Mapping[str, Results],
    note: str,
) -> Outcome:
    """All values and tables.

    Args:
        nats: rows of the table of nats.
        tuned: ``(W,)`` error of the position on the development clips by arm and number of particles.
        widths: W of them.
        found: by key of `TITLES`.
        note: stands below.
    """
    values = {
        "nats": [list(row) for row in nats],
        "tuned": [
            {"arm": name, "particles": number, "widths": list(widths), "error": errors.tolist()}
            for (name, number), errors in tuned.items()
        ],
        **{step: _values(results) for step, results in found.items()},
    }
    tables = [Table("Nats of a step of the test clips", NATS, nats)]
    for step, results in found.items():
        tables += [
            _arms_table(f"Arms, {TITLES[step]}", results),
            _differences_table(f"Differences, {TITLES[step]}", results),
        ]
    return Outcome(values, tables, notes=[note])


def _values(results: Results) -> list[dict[str, object]]:
    return [
        {
            "arm": name,
            "particles": number,
            "widened": width,
            **{key: [getattr(row, key) for row in rows] for key in Row.__dataclass_fields__},
        }
        for (name, number), (width, rows) in results.items()
    ]


def _arms_table(title: str, results: Results) -> Table:
    columns = ["arm", "particles", "widened", "survival, %", "error, px", "log-evidence", "effective, %"]
    lines = []
    for (name, number), (width, rows) in results.items():
        parts = {key: np.array([getattr(row, key) for row in rows]) for key in Row.__dataclass_fields__}
        shown = [_shown(parts[key], factor, digits) for key, factor, digits in SHOWN]
        lines.append([ARMS[name][0], str(number), f"{width:g}", *shown, f"{100 * parts['effective'].mean():.0f}"])
    return Table(title, columns, lines)


def _differences_table(title: str, results: Results) -> Table:
    lines = []
    arms = {name for name, _ in results}
    for first, second in (pair for pair in COMPARED if arms.issuperset(pair)):
        for number in dict.fromkeys(number for _, number in results):
            one, two = results[first, number][1], results[second, number][1]
            cells = []
            for key, factor, digits in SHOWN:
                gap = np.array([getattr(a, key) - getattr(b, key) for a, b in zip(one, two, strict=True)])
                cells.append(_shown(gap, factor, digits, sign="+"))
            lines.append([f"{first} − {second}", str(number), *cells])
    return Table(title, ["arms", "particles", "survival, %", "error, px", "log-evidence"], lines)


def _shown(values: FloatArray, factor: float, digits: int, sign: str = "") -> str:
    mean, low, high = (f"{factor * one:{sign}.{digits}f}" for one in interval(values))
    return f"{mean} [{low}, {high}]"
