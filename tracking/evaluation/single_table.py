"""Scores of trackers of one target side by side: as a table and as values for files."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.result_files import tracked_frames
from tsuiseki.tracking.evaluation.single import PRECISION_AT, Curves, SequenceScores, SingleEvaluation, evaluate_single
from tsuiseki.tracking.evaluation.tables import score_table
from tsuiseki.tracking.formats.single import PublishedScores, SingleSequence, read_published, read_result, same_name

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True)
class MeanCurves(Curves):
    """The mean of the curves of some sequences.

    Attributes:
        sequences: how many.
    """

    sequences: int


@dataclass(frozen=True)
class Compared:
    """One result: its curves by group (``ALL`` and attributes), and where boxes are known its scores by sequence."""

    groups: Mapping[str, MeanCurves]
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
    files = find_results(sequences, result)
    boxes = {name: read_result(path) for name, path in files.items()}
    wanted = [_scored(s, files[s.name], len(boxes[s.name])) if s.name in files else s for s in sequences]
    evaluation = evaluate_single(wanted, boxes, published_precision)
    groups = {"ALL": _curves(evaluation, None)} | {
        attribute: _curves(evaluation, names) for attribute, names in evaluation.attributes.items()
    }
    return Compared(groups, evaluation.sequences, evaluation.missing)


def _scored(sequence: SingleSequence, result: Path, count: int) -> SingleSequence:
    """The frames of a sequence that a result of ``count`` boxes is scored in.

    Those are all; but a stretch that was tracked alone begins with its first frame, and tracker_benchmark scores the
    frames that both have.
    """
    tracked = tracked_frames(result)
    first = 0 if tracked is None or tracked.first >= len(sequence.boxes) else tracked.first
    last = first + count if result.suffix.lower() == ".json" else len(sequence.boxes)
    if first or last < len(sequence.boxes):
        scored = f"{first + 1}-{min(last, len(sequence.boxes))}"
        warnings.warn(f"{sequence.name}: frames {scored} are scored, which {result} is of", InputWarning, stacklevel=2)
    return replace(sequence, boxes=sequence.boxes[first:last], images=sequence.images[first:last])


def find_results(sequences: list[SingleSequence], result: Path) -> dict[str, Path]:
    """The file of each sequence by name: ``NAME.txt``, ``NAME.json`` or ``NAME/boxes.txt`` in a folder, or one file.

    Raises:
        RequestError: nothing there, or one file for several sequences.
    """
    if result.is_file():
        if len(sequences) != 1:
            raise RequestError(
                f"{result}: expected a folder with a result for each of {len(sequences)} sequences, got a file"
            )
        return {sequences[0].name: result}
    if not result.is_dir():
        raise RequestError(f"expected a result file or a folder of results at {result}, found none")
    if len(sequences) == 1 and (result / "boxes.txt").is_file():
        return {sequences[0].name: result / "boxes.txt"}
    found: dict[str, Path] = {}
    for path in sorted(result.iterdir()):
        if path.is_dir() and (path / "boxes.txt").is_file():
            found[same_name(path.name)] = path / "boxes.txt"
        elif path.suffix.lower() in (".txt", ".json"):
            found.setdefault(same_name(path.stem), path)
    return {s.name: found[same_name(s.name)] for s in sequences if same_name(s.name) in found}


def _curves(evaluation: SingleEvaluation, names: tuple[str, ...] | None) -> MeanCurves:
    mean = evaluation.mean(names)
    return MeanCurves(mean.success, mean.precision, len(names) if names else len(evaluation.sequences))


def _published_curves(scores: PublishedScores) -> MeanCurves:
    return MeanCurves(np.array(scores.success), np.array(scores.precision), len(scores.sequences))


def single_table(results: Mapping[str, Compared], by: str) -> Table:
    """A row for each sequence or attribute with the area under the curve of every result, and the mean.

    Args:
        results: by name.
        by: ``sequence`` or ``attribute``.
    """
    if by == "sequence":
        found = {name: {key: one.auc for key, one in r.sequences.items()} for name, r in results.items()}
    else:
        found = {name: {key: one.auc for key, one in r.groups.items()} for name, r in results.items()}
    keys = list(dict.fromkeys(key for r in found.values() for key in r if key != "ALL"))
    whole = [r.groups["ALL"] for r in results.values()]
    means = [
        ["AUC, 21 thresholds", *(_percent(c.auc) for c in whole)],
        ["AUC, 11 thresholds", *(_percent(c.thesis_auc) for c in whole)],
        ["precision at 20 px", *(_percent(float(c.precision[PRECISION_AT])) for c in whole)],
        ["sequences", *(str(c.sequences) for c in whole)],
    ]
    rows = [[key, *(_percent(one.get(key)) for one in found.values())] for key in keys]
    return score_table((by.capitalize(),), list(results), [rows, means])


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
