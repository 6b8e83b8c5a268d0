"""What limits learnt costs: links that the graph lacks, errors by what they cost, and what the features tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tsuiseki.tracking.evaluation.resampling import scores_of
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.association.runs import Result
from tsuiseki.trainers.experiments.association.sequences import Clip, DataSet
from tsuiseki.trainers.experiments.association.tables import values_of
from tsuiseki.trainers.experiments.end_to_end.folds import folds_of
from tsuiseki.trainers.experiments.end_to_end.given import BOTH, GAP, LEARNT
from tsuiseki.trainers.experiments.end_to_end.mending import mended
from tsuiseki.trainers.experiments.end_to_end.runs import lost_links
from tsuiseki.trainers.experiments.end_to_end.tables import limit_table
from tsuiseki.trainers.experiments.end_to_end.telling import BINS, SAYS, Told, told
from tsuiseki.trainers.experiments.experiment import Bench, Table


def limits(bench: Bench, one: DataSet, clips: list[Clip]) -> tuple[list[Table], dict[str, Any]]:
    """The three tables of a data set, and their numbers.

    Args:
        bench: where it works.
        one: the data set.
        clips: its sequences.
    """
    lost = [bench.store.recall(lost_links, clip) for clip in clips]
    rows = mended(bench, clips, GAP)
    every = list[Told]()
    for fold in bench.watch.over(folds_of(one, clips), f"{one.key}: what features tell"):
        every += bench.store.recall(told, fold.train, fold.tests, LEARNT[BOTH])
    tables = [limit_table(one.title, [clip.name for clip in clips], lost), _scores(one, rows), told_table(one, every)]
    links, areas = together(every)
    values = {
        "links of the labels": np.sum(lost, axis=0).tolist(),
        "mended": {row.name: values_of(row) for row in rows},
        "contested, told": dict(zip(SAYS, links.tolist(), strict=True)),
        "detections": dict(zip(SAYS, areas.tolist(), strict=True)),
    }
    return tables, values


def told_table(one: DataSet, every: Sequence[Told]) -> Table:
    """A row a bin of gaps, one for all, and one for the detections; a column for who says."""
    links, areas = together(every)
    rows = []
    for name, counts in [*zip(BINS, links.swapaxes(0, 1), strict=True), ("all", links.sum(axis=1))]:
        rows.append([f"links, {name}", str(int(counts[0, 0])), *(_share(*pair) for pair in counts)])
    rows.append(["detections, area under ROC", str(sum(one.count for one in every)), *(f"{a:.3f}" for a in areas)])
    return Table("", (f"{one.title}: told by", "contested", *SAYS), rows)


def together(every: Sequence[Told]) -> tuple[FloatArray, FloatArray]:
    """``(len(SAYS), len(BINS), 2)`` counts of all sequences, and ``(len(SAYS),)`` mean areas, by detections."""
    areas, counts = np.array([one.detections for one in every]), np.array([one.count for one in every], dtype=float)
    # Sequences of which one has no area are left out for all.
    known = ~np.isnan(areas).any(axis=1)
    mean = np.average(areas[known], axis=0, weights=counts[known]) if known.any() else np.full(len(SAYS), np.nan)
    return np.sum([one.links for one in every], axis=0), mean


def _share(contested: float, told_ones: float) -> str:
    return f"{told_ones / contested:.3f}" if contested else "–"


def _scores(one: DataSet, rows: Sequence[Result]) -> Table:
    cells = []
    for row in rows:
        found = scores_of(row.sums.sum(axis=0))
        scores = [f"{float(found[name]):.3f}" for name in ("hota", "det_a", "ass_a", "mota", "idf1")]
        cells.append([row.name, *scores, str(int(found["id_switches"]))])
    return Table("", (one.title, "HOTA", "DetA", "AssA", "MOTA", "IDF1", "switches"), cells)
