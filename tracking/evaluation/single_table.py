"""Scores of trackers of one target side by side: as a table and as values for files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.single import PRECISION_AT, SequenceScores, SingleEvaluation, evaluate_single
from tsuiseki.tracking.formats.boxes import read_result
from tsuiseki.tracking.formats.single import PublishedScores, SingleSequence, read_published, same_name
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class Curves:
    """Mean curves over some sequences.

    Attributes:
        success: ``(21,)`` shares.
        precision: ``(51,)`` shares.
        sequences: how many.
    """

    success: FloatArray
    precision: FloatArray
    sequences: int

    @property
    def auc(self) -> float:
        """Area under the success curve with 21 thresholds."""
        return float(self.success.mean())

    @property
    def thesis_auc(self) -> float:
        """The same with 11 thresholds."""
        return float(self.success[::2].mean())


@dataclass(frozen=True)
class Compared:
    """One result: its curves by group (``ALL`` and attributes), and where boxes are known its scores by sequence."""

    groups: Mapping[str, Curves]
    sequences: Mapping[str, SequenceScores]
    missing: tuple[str, ...]


def compare(sequences: list[SingleSequence], result: Path, published_precision: bool = False) -> Compared:
    """The scores of the result at ``result``: boxes of each sequence, or tracker_benchmark's score files.

    Raises:
        RequestError: nothing there, or see `evaluate_single`.
    """
    if (result / "ALL.json").is_file():
        published = read_published(result)
        return Compared({name: _published_curves(scores) for name, scores in published.items()}, {}, ())
    evaluation = evaluate_single(sequences, find_results(sequences, result), published_precision)
    groups = {"ALL": _curves(evaluation, None)} | {
        attribute: _curves(evaluation, names) for attribute, names in evaluation.attributes.items()
    }
    return Compared(groups, evaluation.sequences, evaluation.missing)


def find_results(sequences: list[SingleSequence], result: Path) -> dict[str, FloatArray]:
    """Boxes by name of the sequence: ``NAME.txt``, ``NAME.json`` or ``NAME/boxes.txt`` in a folder, or one file.

    Raises:
        RequestError: nothing there, one file for several sequences, or a broken file.
    """
    if result.is_file():
        if len(sequences) != 1:
            raise RequestError(
                f"{result}: expected a folder with a result for each of {len(sequences)} sequences, got a file"
            )
        return {sequences[0].name: read_result(result)}
    if not result.is_dir():
        raise RequestError(f"expected a result file or a folder of results at {result}, found none")
    if len(sequences) == 1 and (result / "boxes.txt").is_file():
        return {sequences[0].name: read_result(result / "boxes.txt")}
    found: dict[str, Path] = {}
    for path in sorted(result.iterdir()):
        if path.is_dir() and (path / "boxes.txt").is_file():
            found[same_name(path.name)] = path / "boxes.txt"
        elif path.suffix.lower() in (".txt", ".json"):
            found.setdefault(same_name(path.stem), path)
    return {s.name: read_result(found[same_name(s.name)]) for s in sequences if same_name(s.name) in found}


def _curves(evaluation: SingleEvaluation, names: tuple[str, ...] | None) -> Curves:
    mean = evaluation.mean(names)
    return Curves(mean.success, mean.precision, len(names) if names else len(evaluation.sequences))


def _published_curves(scores: PublishedScores) -> Curves:
    return Curves(np.array(scores.success), np.array(scores.precision), len(scores.sequences))


def single_table(results: Mapping[str, Compared], by: str) -> Table:
    """A row for each sequence or attribute with the area under the curve of every result, and the mean.

    Args:
        results: by name.
        by: ``sequence`` or ``attribute``.
    """
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column(by.capitalize(), no_wrap=True)
    for name in results:
        table.add_column(Text(name), justify="right", no_wrap=True)
    if by == "sequence":
        names = list(dict.fromkeys(n for r in results.values() for n in r.sequences))
        for name in names:
            table.add_row(
                Text(name),
                *(_percent(r.sequences[name].auc if name in r.sequences else None) for r in results.values()),
            )
        table.add_section()
    else:
        groups = [g for g in next(iter(results.values())).groups if g != "ALL"]
        for group in groups:
            table.add_row(
                group, *(_percent(r.groups[group].auc if group in r.groups else None) for r in results.values())
            )
        table.add_section()
    whole = [r.groups["ALL"] for r in results.values()]
    table.add_row("AUC, 21 thresholds", *(_percent(c.auc) for c in whole))
    table.add_row("AUC, 11 thresholds", *(_percent(c.thesis_auc) for c in whole))
    table.add_row("precision at 20 px", *(_percent(float(c.precision[PRECISION_AT])) for c in whole))
    table.add_row("sequences", *(str(c.sequences) for c in whole))
    return table


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f}"


def single_values(results: Mapping[str, Compared]) -> dict[str, Any]:
    """Everything as plain values for JSON."""
    return {
        name: {
            "groups": {
                group: {
                    "auc": c.auc,
                    "auc_11_thresholds": c.thesis_auc,
                    "precision_20": float(c.precision[PRECISION_AT]),
                    "sequences": c.sequences,
                    "success": c.success.tolist(),
                    "precision": c.precision.tolist(),
                }
                for group, c in r.groups.items()
            },
            "sequences": {
                sequence: {
                    "auc": s.auc,
                    "auc_11_thresholds": s.thesis_auc,
                    "precision_20": s.precision_20,
                    "frames": s.frames,
                    "note": s.note,
                }
                for sequence, s in r.sequences.items()
            },
            "missing": list(r.missing),
        }
        for name, r in results.items()
    }
