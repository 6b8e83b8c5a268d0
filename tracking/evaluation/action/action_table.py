"""Scores of recognised actions as tables and as values for files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from tsuiseki.tracking.evaluation.action.action import ActionScores


def action_table(results: Mapping[str, ActionScores]) -> Table:
    """F1 and average precision of every action, in percent, a column a result.

    Args:
        results: scores by name of the result.
    """
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("Action", no_wrap=True)
    table.add_column("rows", justify="right")
    for name in results:
        table.add_column(Text(f"{name}\nF1"), justify="right", no_wrap=True)
        table.add_column("\nAP", justify="right", no_wrap=True)
    first = next(iter(results.values()))
    for a, action in enumerate(first.names):
        cells = [_percent(values[a]) for s in results.values() for values in (s.f1, s.average_precision)]
        table.add_row(Text(action), str(first.positives[a]), *cells)
    table.add_section()
    means = [_percent(value) for s in results.values() for value in (s.mean_f1, s.mean_average_precision)]
    table.add_row("mean", str(first.rows), *means)
    return table


def action_values(results: Mapping[str, ActionScores]) -> dict[str, Any]:
    """The same for a JSON file, with precision and recall; null where an action does not occur."""
    return {
        name: {
            "mean_f1": scores.mean_f1,
            "mean_average_precision": scores.mean_average_precision,
            "rows": scores.rows,
            "actions": {
                action: {
                    "f1": _or_none(scores.f1[a]),
                    "precision": _or_none(scores.precision[a]),
                    "recall": _or_none(scores.recall[a]),
                    "average_precision": _or_none(scores.average_precision[a]),
                    "rows": int(scores.positives[a]),
                }
                for a, action in enumerate(scores.names)
            },
        }
        for name, scores in results.items()
    }


def _percent(value: float) -> str:
    return "–" if np.isnan(value) else f"{100 * value:.2f}"


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
