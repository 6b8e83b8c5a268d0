"""Scores of points as a table."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table
from rich.text import Text

from tsuiseki.tracking.evaluation.points import PointScores

COLUMNS = ("OSPA p=1", "OSPA p=2", "OSPA(2)", "GOSPA", "missed", "false", "|count error|", "switches")


def point_table(results: Mapping[str, PointScores]) -> Table:
    """The scores of several results, a row each, for `rich`."""
    table = Table()
    table.add_column("result", no_wrap=True)
    for heading in COLUMNS:
        table.add_column(heading, justify="right")
    for name, s in results.items():
        numbers = (s.ospa1, s.ospa2, s.ospa_tracks, s.gospa, s.missed, s.false, s.cardinality_error)
        table.add_row(Text(name), *(f"{value:.2f}" for value in numbers), str(s.switches))
    return table
