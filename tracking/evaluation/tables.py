"""Scores as tables: on a terminal, as plain text, and as values for files."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rich.table import Table

    from tsuiseki.tracking.evaluation.actions import ActionScores
    from tsuiseki.tracking.evaluation.detection import DetectionEvaluation, DetectionScores
    from tsuiseki.tracking.evaluation.multi import PeopleEvaluation, PeopleScores

# Heading and field of every column, and whether it is a share or a count.
COLUMNS = (
    ("HOTA", "hota", True),
    ("DetA", "det_a", True),
    ("AssA", "ass_a", True),
    ("MOTA", "mota", True),
    ("MOTP", "motp", True),
    ("IDF1", "idf1", True),
    ("IDSW", "id_switches", False),
    ("FP", "false_positives", False),
    ("FN", "false_negatives", False),
    ("Rcll", "recall", True),
    ("Prcn", "precision", True),
)
POINT_COLUMNS = (
    ("OSPA p=1", "ospa1", ".2f"), ("OSPA p=2", "ospa2", ".2f"), ("OSPA(2)", "ospa_tracks", ".2f"),
    ("GOSPA", "gospa", ".2f"), ("missed", "missed", ".2f"), ("false", "false", ".2f"),
    ("|count error|", "cardinality_error", ".2f"), ("switches", "switches", ""),
)  # fmt: skip
FLOOR_COLUMNS = (
    ("IDF1", "idf1", ".3f"), ("MOTA", "mota", ".3f"), ("HOTA", "hota", ".3f"), ("switches", "switches", ""),
    ("MODA", "moda", ".3f"), ("MODP", "modp", ".3f"), ("Rcll", "recall", ".3f"), ("Prcn", "precision", ".3f"),
    ("GOSPA m", "gospa", ".2f"),
)  # fmt: skip
STATE_COLUMNS = (
    ("success", "success", ".3f"), ("followed", "followed_of", ""), ("px: mean", "position_mean", ".2f"),
    ("median", "position_median", ".2f"), ("95 %", "position_95", ".2f"), ("degrees: mean", "angle_mean", ".2f"),
    ("median", "angle_median", ".2f"), ("reversed", "reversed", ".3f"), ("IDF1", "idf1", ".3f"),
    ("switches", "switches", ""), ("false", "false", ""),
)  # fmt: skip
COMBINED = "combined"
Row = Sequence[str]


def score_table(names: Sequence[str], scores: Sequence[str], groups: Iterable[Iterable[Row]]) -> Table:
    """A table for `rich`, which is loaded here: pages take only the columns.

    Args:
        names: headings of the columns of names, set on the left.
        scores: headings of the columns of numbers, set on the right.
        groups: of rows, a line between two of them.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for number, heading in enumerate([*names, *scores]):
        table.add_column(Text(heading), justify="left" if number < len(names) else "right", no_wrap=True)
    for group in groups:
        for row in group:
            table.add_row(*map(Text, row))
        table.add_section()
    return table


def show(table: Table) -> None:
    """Print ``table`` in full, however narrow the terminal, with colours only on one."""
    from rich.console import Console

    console = Console()
    # A table squeezed into too few columns loses digits; a line that wraps does not.
    wanted = console.measure(table, options=console.options.update(width=1000)).maximum
    Console(width=max(console.width, wanted)).print(table)


def by_sequence(sequences: Iterable[str], results: Mapping[str, Mapping[str, Row]]) -> Iterable[Iterable[Row]]:
    """A group of rows a sequence: its name once, the name of each result, and its cells there."""
    for sequence in sequences:
        cells = [(name, found[sequence]) for name, found in results.items()]
        yield [("" if number else sequence, name, *row) for number, (name, row) in enumerate(cells)]


def people_table(results: Mapping[str, PeopleEvaluation]) -> Table:
    """The scores of several results by sequence and combined.

    Args:
        results: an evaluation by name of the result.
    """
    found = {name: _with_combined(one) for name, one in results.items()}
    rows = {name: {sequence: cells(scores) for sequence, scores in one.items()} for name, one in found.items()}
    return score_table(("Sequence", "Result"), [h for h, _, _ in COLUMNS], by_sequence(next(iter(rows.values())), rows))


def _with_combined(evaluation: PeopleEvaluation | DetectionEvaluation) -> dict[str, Any]:
    several = {COMBINED: evaluation.combined} if len(evaluation.sequences) > 1 else {}
    return {**evaluation.sequences, **several}


def cells(scores: PeopleScores) -> list[str]:
    """One text for each of `COLUMNS`: shares with three decimals, counts as they are."""
    values = dataclasses.asdict(scores)
    return [f"{values[name]:.3f}" if share else str(values[name]) for _, name, share in COLUMNS]


def detection_table(results: Mapping[str, DetectionEvaluation], iou: float) -> Table:
    """The average precision of several results by sequence and combined."""
    headings = (f"AP{100 * iou:.0f}", "Recall", "Best F1", "at score", "Boxes")
    found = {name: {**_with_combined(one), **one.visible} for name, one in results.items()}
    rows = {name: {sequence: _detection_cells(s) for sequence, s in one.items()} for name, one in found.items()}
    return score_table(("Sequence", "Result"), headings, by_sequence(next(iter(rows.values())), rows))


def _detection_cells(scores: DetectionScores) -> list[str]:
    recall = float(scores.recall[-1]) if len(scores.recall) else 0.0
    values = scores.average_precision, recall, scores.best_f1, scores.best_threshold
    return [*(f"{value:.3f}" for value in values), str(scores.boxes)]


def evaluation_values(results: Mapping[str, PeopleEvaluation | DetectionEvaluation]) -> dict[str, Any]:
    """The scores as nested mappings for a JSON file: result, then sequence or ``combined``, then score."""
    return {
        name: {
            "sequences": {sequence: _plain(scores) for sequence, scores in evaluation.sequences.items()},
            COMBINED: _plain(evaluation.combined),
            **{share: _plain(scores) for share, scores in getattr(evaluation, "visible", {}).items()},
        }
        for name, evaluation in results.items()
    }


def _plain(scores: PeopleScores | DetectionScores) -> dict[str, Any]:
    values = dataclasses.asdict(scores)
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def value_table(results: Mapping[str, Any], columns: Sequence[tuple[str, str, str]]) -> Table:
    """The scores of several results, a row each.

    Args:
        results: scores by name of the result.
        columns: the heading of each, the field or property of the scores, and its format.
    """
    rows = [[name, *(_number(getattr(s, field), form) for _, field, form in columns)] for name, s in results.items()]
    return score_table(("Result",), [heading for heading, _, _ in columns], [rows])


def _number(value: Any, form: str) -> str:
    return "–" if isinstance(value, float) and np.isnan(value) else f"{value:{form}}"


def action_table(results: Mapping[str, ActionScores]) -> Table:
    """F1 and average precision of every action, in percent, a column a result."""
    first = next(iter(results.values()))
    headings = ["rows", *(heading for name in results for heading in (f"{name}\nF1", "\nAP"))]
    rows = [
        [
            action,
            str(first.positives[a]),
            *(_percent(v[a]) for s in results.values() for v in (s.f1, s.average_precision)),
        ]
        for a, action in enumerate(first.names)
    ]
    means = [_percent(value) for s in results.values() for value in (s.mean_f1, s.mean_average_precision)]
    return score_table(("Action",), headings, [rows, [["mean", str(first.rows), *means]]])


def action_values(results: Mapping[str, ActionScores]) -> dict[str, Any]:
    """The same for a JSON file, with precision and recall; null where an action does not occur."""
    kinds = ("f1", "precision", "recall", "average_precision")
    return {
        name: {
            "mean_f1": scores.mean_f1,
            "mean_average_precision": scores.mean_average_precision,
            "rows": scores.rows,
            "actions": {
                action: {kind: None if np.isnan(value := getattr(scores, kind)[a]) else float(value) for kind in kinds}
                | {"rows": int(scores.positives[a])}
                for a, action in enumerate(scores.names)
            },
        }
        for name, scores in results.items()
    }


def _percent(value: float) -> str:
    return _number(100 * value, ".2f")
