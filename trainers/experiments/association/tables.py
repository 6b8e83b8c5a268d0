"""The association's tables and the file of all scores."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from tsuiseki.tracking.evaluation.resampling import COUNTS, SCORES, Interval, paired_bootstrap, scores_of
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.association.oracle import LinkCounts
from tsuiseki.trainers.experiments.association.runs import Result
from tsuiseki.trainers.experiments.experiment import Table

HEADINGS = ("HOTA", "DetA", "AssA", "MOTA", "IDF1", "IDSW", "FP", "FN")
SAMPLES = 2000
# A name; right detections, labels and detections; recall and precision as known.
FoundRow: TypeAlias = tuple[str, tuple[int, int, int], tuple[float, float] | None]


def intervals(ours: Result, other: Result) -> dict[str, Interval]:
    """How far ours is above another, over samples of sequences."""
    return paired_bootstrap(ours.sums, other.sums, SAMPLES, np.random.default_rng(0))


def combined_table(title: str, results: Sequence[Result], ours: str) -> Table:
    """All sequences of a data set together, and how far ours is above each row.

    Args:
        title: of the data set.
        results: the rows.
        ours: name of the row that the others are compared with.
    """
    base = next(result for result in results if result.name == ours)
    rows = []
    for result in results:
        apart = ["", ""]
        if result.name != ours:
            found = intervals(base, result)
            apart = [_interval(found["hota"], len(base.sums)), _interval(found["idf1"], len(base.sums))]
        rows.append([result.name, *_cells(result.sums.sum(axis=0)), *apart, result.settings])
    columns = (title, *HEADINGS, "ours − row: HOTA", "ours − row: IDF1", "settings from")
    return Table("", columns, rows)


def sequence_table(title: str, names: Sequence[str], results: Sequence[Result]) -> Table:
    """HOTA / MOTA / IDF1 of each sequence."""
    rows = []
    for number, name in enumerate(names):
        scores = [scores_of(result.sums[number]) for result in results]
        rows.append([name, *(" / ".join(_share(s[k]) for k in ("hota", "mota", "idf1")) for s in scores)])
    return Table("", (f"{title}: HOTA / MOTA / IDF1", *(result.name for result in results)), rows)


def loss_table(title: str, results: Sequence[Result]) -> Table:
    """What our result would score with one kind of error mended, and what its detections allow."""
    base = scores_of(results[0].sums.sum(axis=0))
    rows = []
    for result in results:
        found = scores_of(result.sums.sum(axis=0))
        gained = [f"{found[k] - base[k]:+.3f}" if result is not results[0] else "" for k in ("hota", "idf1")]
        rows.append([result.name, *_cells(result.sums.sum(axis=0)), *gained])
    return Table("", (title, *HEADINGS, "gain in HOTA", "gain in IDF1"), rows)


def link_table(title: str, counts: Sequence[LinkCounts]) -> Table:
    """Links by the length of the gap, over all sequences."""
    bins = counts[0].bins
    right, made, wrong = (np.sum([getattr(c, k) for c in counts], axis=0) for k in ("right", "made", "wrong"))
    rows = [[name, str(right[k]), str(made[k]), str(right[k] - made[k]), str(wrong[k])] for k, name in enumerate(bins)]
    return Table("", (f"{title}: gap", "right links", "made", "missed", "wrong links made"), rows)


def found_table(rows: Sequence[FoundRow]) -> Table:
    """Recall and precision of the given detections, here and as known from the data's own description."""
    cells = []
    for name, (right, labels, boxes), known in rows:
        there = ["", ""] if known is None else [f"{known[0]:.3f}", f"{known[1]:.3f}"]
        cells.append([name, str(labels), f"{right / labels:.3f}", there[0], f"{right / boxes:.3f}", there[1]])
    columns = ("given detections, IoU 0.5", "labels", "recall", "known", "precision", "known")
    return Table("", columns, cells)


def scores_csv(sets: Mapping[str, tuple[Sequence[str], Sequence[Result]]]) -> str:
    """All scores of all rows, by sequence and combined."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["set", "sequence", "row", *SCORES, *COUNTS])
    for key, (names, results) in sets.items():
        for result in results:
            for name, sums in [*zip(names, result.sums, strict=True), ("combined", result.sums.sum(axis=0))]:
                found = scores_of(sums)
                shares = [f"{float(found[k]):.4f}" for k in SCORES]
                writer.writerow([key, name, result.name, *shares, *(int(found[k]) for k in COUNTS)])
    return text.getvalue()


def values_of(result: Result) -> dict[str, float]:
    """The combined scores of a row, for results.json."""
    return {name: float(value) for name, value in scores_of(result.sums.sum(axis=0)).items()}


def _cells(sums: FloatArray) -> list[str]:
    found = scores_of(sums)
    return [_share(found[k]) for k in SCORES] + [str(int(found[k])) for k in COUNTS[:3]]


def _share(value: FloatArray) -> str:
    return f"{float(value):.3f}"


def _interval(found: Interval, sequences: int) -> str:
    if sequences == 1:
        return f"{found.difference:+.3f}, one sequence"
    return f"{found.difference:+.3f} [{found.low:+.3f}, {found.high:+.3f}]"
