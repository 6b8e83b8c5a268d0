"""Scores of bodies as a table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from tsuiseki.tracking.evaluation.states import StateScores

COLUMNS = (
    "success", "followed", "px: mean", "median", "95 %", "degrees: mean", "median", "reversed", "IDF1", "switches",
    "false",
)  # fmt: skip


def state_table(results: Mapping[str, StateScores]) -> Table:
    """A row a result; success, reversed and IDF1 are shares, false are estimates on no body."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("Result", no_wrap=True)
    for heading in COLUMNS:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, s in results.items():
        positions = (s.position_mean, s.position_median, s.position_95, s.angle_mean, s.angle_median)
        table.add_row(
            Text(name),
            f"{s.success:.3f}",
            f"{s.followed} of {s.bodies}",
            *(_number(value, 2) for value in positions),
            _number(s.reversed, 3),
            f"{s.idf1:.3f}",
            str(s.switches),
            str(s.false),
        )
    return table


def _number(value: float, digits: int) -> str:
    return "–" if np.isnan(value) else f"{value:.{digits}f}"
