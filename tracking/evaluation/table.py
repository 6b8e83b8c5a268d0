"""Scores as a table: on a terminal, as plain text, and as values for files."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.evaluation.detection import DetectionScores
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation, PeopleScores
from tsuiseki.tracking.evaluation.pairs import DetectionEvaluation

if TYPE_CHECKING:
    from rich.table import Table

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
COMBINED = "combined"


def people_table(results: Mapping[str, PeopleEvaluation]) -> Table:
    """The scores of several results by sequence and combined, as a table for `rich`.

    Args:
        results: an evaluation by name of the result.
    """
    sequences = list(next(iter(results.values())).sequences)
    from rich.text import Text

    table = _empty_table()
    table.add_column("Sequence", no_wrap=True)
    table.add_column("Result", no_wrap=True)
    for heading, _, _ in COLUMNS:
        table.add_column(heading, justify="right", no_wrap=True)
    for sequence in sequences:
        for number, (name, evaluation) in enumerate(results.items()):
            first = Text("" if number else sequence)
            table.add_row(first, Text(name), *cells(evaluation.sequences[sequence]))
        table.add_section()
    if len(sequences) > 1:
        for number, (name, evaluation) in enumerate(results.items()):
            table.add_row("" if number else COMBINED, Text(name), *cells(evaluation.combined))
    return table


def show(table: Table) -> None:
    """Print ``table`` in full, however narrow the terminal, with colours only on one."""
    from rich.console import Console

    console = Console()
    # A table squeezed into too few columns loses digits; a line that wraps does not.
    wanted = console.measure(table, options=console.options.update(width=1000)).maximum
    Console(width=max(console.width, wanted)).print(table)


def cells(scores: PeopleScores) -> list[str]:
    """One text for each of `COLUMNS`: shares with three decimals, counts as they are."""
    values = dataclasses.asdict(scores)
    return [f"{values[name]:.3f}" if share else str(values[name]) for _, name, share in COLUMNS]


def people_values(results: Mapping[str, PeopleEvaluation]) -> dict[str, Any]:
    """The scores as nested mappings for a JSON file: result, then sequence or ``combined``, then score."""
    return {
        name: {
            "sequences": {sequence: dataclasses.asdict(scores) for sequence, scores in evaluation.sequences.items()},
            COMBINED: dataclasses.asdict(evaluation.combined),
        }
        for name, evaluation in results.items()
    }


def detection_table(results: Mapping[str, DetectionEvaluation], iou: float) -> Table:
    """The average precision of several results by sequence and combined, as a table for `rich`."""
    sequences = list(next(iter(results.values())).sequences)
    headings = (f"AP{100 * iou:.0f}", "Best F1", "at score", "Boxes")
    from rich.text import Text

    table = _empty_table()
    table.add_column("Sequence", no_wrap=True)
    table.add_column("Result", no_wrap=True)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for sequence in [*sequences, *([COMBINED] if len(sequences) > 1 else [])]:
        for number, (name, evaluation) in enumerate(results.items()):
            scores = evaluation.combined if sequence == COMBINED else evaluation.sequences[sequence]
            values = (scores.average_precision, scores.best_f1, scores.best_threshold)
            first = Text("" if number else sequence)
            table.add_row(first, Text(name), *(f"{value:.3f}" for value in values), str(scores.boxes))
        table.add_section()
    return table


def detection_values(results: Mapping[str, DetectionEvaluation]) -> dict[str, Any]:
    """The scores as nested mappings for a JSON file: result, then sequence or ``combined``, then score."""
    return {
        name: {
            "sequences": {sequence: _plain(scores) for sequence, scores in evaluation.sequences.items()},
            COMBINED: _plain(evaluation.combined),
        }
        for name, evaluation in results.items()
    }


def _plain(scores: DetectionScores) -> dict[str, Any]:
    values = dataclasses.asdict(scores)
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def _empty_table() -> Table:
    """Loaded with its library where a table is shown: pages take only its columns."""
    from rich import box
    from rich.table import Table

    return Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
