"""Scores of a tracker of one target: success and precision curves of the OTB benchmark, one-pass evaluation.

Wu, Lim and Yang, "Object tracking benchmark", PAMI 2015. The rules are those of its published scores:

* A frame is a success at a threshold when the overlap is strictly greater than the threshold.
* A frame is precise at a distance when the centres are at most that far apart. A centre is ``x + (w - 1) / 2``.
* The first box is the given one.
* The area under a curve is the mean over its thresholds.
* Scores of several sequences are means over the sequences, each with the same weight.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.result_files import tracked_frames
from tsuiseki.tracking.evaluation.tables import score_table
from tsuiseki.tracking.formats.single import (
    ATTRIBUTES,
    SingleSequence,
    read_published,
    read_result,
    same_name,
)
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from rich.table import Table

# Thresholds of the success curve, intersection over union.
OVERLAPS = np.linspace(0, 1, 21)
# Thresholds of the precision curve, pixels.
DISTANCES = np.arange(51)
# Distance at which trackers are ranked, pixels.
PRECISION_AT = 20


@dataclass(frozen=True)
class Curves:
    """How often a result is good enough.

    Attributes:
        success: ``(21,)`` share of frames at each threshold of `OVERLAPS`.
        precision: ``(51,)`` share of frames at each distance of `DISTANCES`.
    """

    success: FloatArray
    precision: FloatArray

    @property
    def auc(self) -> float:
        """Area under the success curve with 21 thresholds, in [0, 1]."""
        return float(self.success.mean())

    @property
    def thesis_auc(self) -> float:
        """The same with the 11 thresholds of the thesis."""
        return float(self.success[::2].mean())

    @property
    def precision_20(self) -> float:
        """Share of frames whose centre is at most 20 pixels off."""
        return float(self.precision[PRECISION_AT])


@dataclass(frozen=True)
class SequenceScores(Curves):
    """One result on one sequence.

    Attributes:
        overlaps: ``(T,)`` of each scored frame.
        frames: how many frames were scored.
        note: one line where result and truth differ in length or frames have no box, otherwise empty.
    """

    overlaps: FloatArray
    frames: int
    note: str = ""


@dataclass(frozen=True)
class MeanCurves(Curves):
    """The mean of the curves of so many sequences, each with the same weight."""

    sequences: int


@dataclass(frozen=True)
class Compared:
    """One tracker on several sequences.

    Attributes:
        groups: curves of all sequences (``ALL``) and of those that show an attribute, by its short name.
        sequences: scores by name; none where boxes are not known.
        missing: sequences for which there is no result.
    """

    groups: Mapping[str, MeanCurves]
    sequences: Mapping[str, SequenceScores]
    missing: tuple[str, ...]


def evaluate_boxes(truth: FloatArray, result: FloatArray, first_labelled_as_hit: bool = False) -> SequenceScores:
    """Score the boxes of one sequence.

    Args:
        truth: ``(T, 4)`` pixels, NaN where there is no box.
        result: ``(R, 4)`` pixels. A box that is NaN or without area is taken as the one before.
        first_labelled_as_hit: count a box that starts left of or above the image as precise, as the published
            precision curves of tracker_benchmark do by a slip; for comparing with them only.

    A frame without a result is a miss. Frames without a true box are not scored.

    Raises:
        RequestError: no frame can be scored.
    """
    count, notes = min(len(truth), len(result)), []
    if count < len(truth):
        notes.append(f"{count} results for {len(truth)} boxes: the frames without one are misses")
    elif count < len(result):
        notes.append(f"{len(result)} results for {count} boxes: those without one are left out")
    missing = np.full((len(truth) - count, 4), np.nan)
    result = np.concatenate([_filled(result[:count], truth[0]), missing]) if count else missing
    labelled: BoolArray = np.asarray(np.isfinite(truth).all(axis=1) & ((truth[:, 2:] - truth[:, :2]) > 0).all(axis=1))
    if not labelled[:count].any():
        raise RequestError("expected at least one frame with both a true box and a result, got none")
    if not labelled.all():
        notes.append(f"{int((~labelled).sum())} frames without a true box are not scored")
    truth, result = truth[labelled], result[labelled]
    # Of a frame without a result both are NaN: nothing overlaps, and it is infinitely far off.
    overlaps = np.nan_to_num(iou_pairs(truth, result), nan=0.0)
    distances = np.nan_to_num(np.linalg.norm(_centres(truth) - _centres(result), axis=1), nan=np.inf)
    if first_labelled_as_hit:
        slipped = (truth[:, :2] + 1 <= 0).any(axis=1)
        distances, overlaps = np.where(slipped, -1, distances), np.where(slipped, -1, overlaps)
    success = (overlaps[None] > OVERLAPS[:, None]).mean(axis=1)
    precision = (distances[None] <= DISTANCES[:, None]).mean(axis=1)
    return SequenceScores(success, precision, overlaps, len(truth), "; ".join(notes))


def _filled(result: FloatArray, first: FloatArray) -> FloatArray:
    """The result with the given first box, and each unusable box replaced by the one before."""
    result = result.copy()
    result[0] = first
    positive = np.tile(result[:, 2:] > result[:, :2], 2)
    usable: BoolArray = np.asarray((np.isfinite(result) & positive).all(axis=1))
    source = np.maximum.accumulate(np.where(usable, np.arange(len(result)), 0))
    return result[source]


def _centres(boxes: FloatArray) -> FloatArray:
    return np.asarray(boxes[:, :2] + (boxes[:, 2:] - boxes[:, :2] - 1) / 2)


def evaluate_single(
    sequences: list[SingleSequence], results: Mapping[str, FloatArray], first_labelled_as_hit: bool = False
) -> Compared:
    """Score the results of one tracker, by name of the sequence.

    Raises:
        RequestError: there is a result for none of the sequences, or see `evaluate_boxes`.
    """
    scores = {}
    for sequence in sequences:
        if sequence.name in results:
            try:
                scores[sequence.name] = evaluate_boxes(sequence.boxes, results[sequence.name], first_labelled_as_hit)
            except RequestError as error:
                raise RequestError(f"{sequence.name}: {error}") from error
    if not scores:
        raise RequestError("expected a result for at least one of the sequences, found none; are these their names?")
    groups = {"ALL": [*scores.values()]} | {
        attribute: [scores[s.name] for s in sequences if attribute in s.attributes and s.name in scores]
        for attribute in ATTRIBUTES
    }
    curves = {
        name: MeanCurves(
            np.mean([s.success for s in group], axis=0), np.mean([s.precision for s in group], axis=0), len(group)
        )
        for name, group in groups.items()
        if group
    }
    return Compared(curves, scores, tuple(s.name for s in sequences if s.name not in scores))


def compare(sequences: list[SingleSequence], result: Path, published_precision: bool = False) -> Compared:
    """The scores of the result at ``result``: boxes of each sequence, or tracker_benchmark's score files.

    Raises:
        RequestError: nothing there, or see `evaluate_single`.
    """
    if (result / "ALL.json").is_file():
        published = read_published(result)
        curves = {
            name: MeanCurves(np.array(group.success), np.array(group.precision), len(group.sequences))
            for name, group in published.items()
        }
        return Compared(curves, {}, ())
    files = _result_files(sequences, result)
    boxes = {name: read_result(path) for name, path in files.items()}
    scored = [_scored(s, files[s.name], len(boxes[s.name])) if s.name in files else s for s in sequences]
    return evaluate_single(scored, boxes, published_precision)


def _scored(sequence: SingleSequence, result: Path, count: int) -> SingleSequence:
    """The frames of a sequence that a result of ``count`` boxes is scored in.

    Those are all; but a segment that was tracked alone begins with its first frame, and tracker_benchmark scores the
    frames that both have.
    """
    tracked = tracked_frames(result)
    first = 0 if tracked is None or tracked.first >= len(sequence.boxes) else tracked.first
    last = first + count if result.suffix.lower() == ".json" else len(sequence.boxes)
    if first or last < len(sequence.boxes):
        scored = f"{first + 1}-{min(last, len(sequence.boxes))}"
        warnings.warn(f"{sequence.name}: frames {scored} are scored, which {result} is of", InputWarning, stacklevel=2)
    return replace(sequence, boxes=sequence.boxes[first:last], images=sequence.images[first:last])


def _result_files(sequences: list[SingleSequence], result: Path) -> dict[str, Path]:
    """The file of each sequence by name: ``NAME.txt``, ``NAME.json`` or ``NAME/boxes.txt`` in a folder, or one file."""
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
    files: dict[str, Path] = {}
    for path in sorted(result.iterdir()):
        if path.is_dir() and (path / "boxes.txt").is_file():
            files[same_name(path.name)] = path / "boxes.txt"
        elif path.suffix.lower() in (".txt", ".json"):
            files.setdefault(same_name(path.stem), path)
    return {s.name: files[same_name(s.name)] for s in sequences if same_name(s.name) in files}


def single_table(results: Mapping[str, Compared], by: str) -> Table:
    """A row for each sequence or attribute with the area under the curve of every result by name, and the mean."""
    curves = {name: r.sequences if by == "sequence" else r.groups for name, r in results.items()}
    areas = {name: {key: curve.auc for key, curve in rows_of.items()} for name, rows_of in curves.items()}
    keys = list(dict.fromkeys(key for r in areas.values() for key in r if key != "ALL"))
    totals = [r.groups["ALL"] for r in results.values()]
    means = [
        ["AUC, 21 thresholds", *(_percent(c.auc) for c in totals)],
        ["AUC, 11 thresholds", *(_percent(c.thesis_auc) for c in totals)],
        ["precision at 20 px", *(_percent(c.precision_20) for c in totals)],
        ["sequences", *(str(c.sequences) for c in totals)],
    ]
    rows = [[key, *(_percent(curve.get(key)) for curve in areas.values())] for key in keys]
    return score_table((by.capitalize(),), list(results), [rows, means])


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f}"


def single_values(results: Mapping[str, Compared]) -> dict[str, Any]:
    """Everything as plain values for JSON."""

    def areas(curves: Curves) -> dict[str, Any]:
        return {"auc": curves.auc, "auc_11_thresholds": curves.thesis_auc, "precision_20": curves.precision_20}

    return {
        name: {
            "groups": {
                group: {
                    **areas(c),
                    "sequences": c.sequences,
                    "success": c.success.tolist(),
                    "precision": c.precision.tolist(),
                }
                for group, c in r.groups.items()
            },
            "sequences": {
                sequence: {**areas(s), "frames": s.frames, "note": s.note} for sequence, s in r.sequences.items()
            },
            "missing": list(r.missing),
        }
        for name, r in results.items()
    }
