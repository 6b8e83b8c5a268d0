"""Scores as tables: on a terminal, as plain text, and as values for files."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rich.table import Table

    from tsuiseki.tracking.evaluation.detection import DetectionEvaluation, DetectionScores
    from tsuiseki.tracking.evaluation.multi import PeopleEvaluation, PeopleScores
    from tsuiseki.tracking.evaluation.quality import Quality

# Heading, field and format of every column.
COLUMNS = (
    ("HOTA", "hota", ".3f"), ("DetA", "det_a", ".3f"), ("AssA", "ass_a", ".3f"), ("MOTA", "mota", ".3f"),
    ("MOTP", "motp", ".3f"), ("IDF1", "idf1", ".3f"), ("IDSW", "id_switches", ""), ("FP", "false_positives", ""),
    ("FN", "false_negatives", ""), ("Rcll", "recall", ".3f"), ("Prcn", "precision", ".3f"),
)  # fmt: skip
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
    """A table for `rich`, which is loaded here: pages take only the columns. Between groups of rows is a line."""
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
    width = console.measure(table, options=console.options.update(width=1000)).maximum
    Console(width=max(console.width, width)).print(table)


def sequence_table(headings: Sequence[str], results: Mapping[str, Mapping[str, Row]]) -> Table:
    """A group of rows a sequence: its name once, and by name of each result the cells there."""
    groups = [
        [("" if number else sequence, name, *rows[sequence]) for number, (name, rows) in enumerate(results.items())]
        for sequence in next(iter(results.values()))
    ]
    return score_table(("Sequence", "Result"), headings, groups)


def people_table(results: Mapping[str, PeopleEvaluation]) -> Table:
    """The scores of several results by sequence and combined; ``results`` are evaluations by name of the result."""
    evaluations = {name: _with_combined(scored) for name, scored in results.items()}
    rows = {
        name: {sequence: cells(scores) for sequence, scores in scored.items()} for name, scored in evaluations.items()
    }
    return sequence_table([heading for heading, _, _ in COLUMNS], rows)


def _with_combined(evaluation: PeopleEvaluation | DetectionEvaluation) -> dict[str, Any]:
    several = {COMBINED: evaluation.combined} if len(evaluation.sequences) > 1 else {}
    return {**evaluation.sequences, **several}


def cells(scores: Any, columns: Sequence[tuple[str, str, str]] = COLUMNS) -> list[str]:
    """One text for each of ``columns``: heading, field or property of the scores, and format."""
    values = [(getattr(scores, field), form) for _, field, form in columns]
    return ["–" if isinstance(value, float) and np.isnan(value) else f"{value:{form}}" for value, form in values]


def detection_table(results: Mapping[str, DetectionEvaluation], iou: float) -> Table:
    """The average precision of several results by sequence and combined."""
    headings = (f"AP{100 * iou:.0f}", "Recall", "Best F1", "at score", "Boxes")
    evaluations = {name: {**_with_combined(scored), **scored.visible} for name, scored in results.items()}
    rows = {
        name: {sequence: _detection_cells(s) for sequence, s in scored.items()} for name, scored in evaluations.items()
    }
    return sequence_table(headings, rows)


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
    """The scores of several results by their names, a row each; ``columns`` as for `cells`."""
    rows = [[name, *cells(scores, columns)] for name, scores in results.items()]
    return score_table(("Result",), [heading for heading, _, _ in columns], [rows])


def quality_table(results: Mapping[str, Quality]) -> Table:
    """Estimated scores of several results by their names, a row each: the estimate, and the ends of its interval."""
    rows = [[name, *quality_cells(quality).values()] for name, quality in results.items()]
    return score_table(("Result",), [*quality_cells(next(iter(results.values())))], [rows])


def quality_cells(quality: Quality) -> dict[str, str]:
    """The texts of estimated scores, by their headings; two digits, for intervals are wider."""
    intervals = {heading: (getattr(quality, field), ".2f" if form else ".0f") for heading, field, form in COLUMNS
                 if hasattr(quality, field)}  # fmt: skip
    return {
        heading: f"{score.value:{form}} ({score.low:{form}} to {score.high:{form}})"
        for heading, (score, form) in intervals.items()
    }


def quality_values(quality: Quality) -> dict[str, Any]:
    """Estimated scores as nested mappings for a JSON file; frames count from 1."""
    scores = {field: getattr(quality, field)._asdict() for _, field, _ in COLUMNS if hasattr(quality, field)}
    places = [{**place._asdict(), "frame": place.frame + 1} for place in quality.doubtful]
    return {**scores, "doubtful": places, "unseen": [*quality.unseen]}
