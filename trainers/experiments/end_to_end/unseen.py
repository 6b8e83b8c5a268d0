"""Costs learnt on generated streets alone, on real sequences: those that could ship."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.experiments.association.runs import Result, clip_sums
from tsuiseki.trainers.experiments.association.sequences import DATA_SETS, Clip, find_clips
from tsuiseki.trainers.experiments.association.tables import values_of
from tsuiseki.trainers.experiments.end_to_end.given import DEFAULT, default
from tsuiseki.trainers.experiments.end_to_end.runs import learnt_tables, shared_tables, shipped_table
from tsuiseki.trainers.experiments.end_to_end.streets import STREETS
from tsuiseki.trainers.experiments.end_to_end.tables import gain_table
from tsuiseki.trainers.experiments.experiment import Bench, Table

KEYS = ("mot17", "mot15", "kitti-pedestrians", "pets", "tud")
FIT = Fit(steps=300)
SHIPPED, ALL, LINKS, HALF = "trees of pairs that ship", "both losses", "… links alone", "… half of all"
SHARES = {LINKS: (1.0, 0.0), HALF: (0.5, 0.5)}


def unseen_tables(bench: Bench, data: Path, streets: Path) -> tuple[list[Table], dict[str, Any]]:
    """A table a data set: the default, the costs of pairs that ship, and what generated streets teach.

    Raises:
        RequestError: no data set is there.
    """
    train = tuple(find_clips(streets.parent, STREETS))
    there = [(one, find_clips(data, one)) for one in DATA_SETS if one.key in KEYS]
    there = [(one, clips) for one, clips in there if clips]
    if not there:
        raise RequestError(f"data: expected mot/mot17-val-half or another of the data sets in {data}, found none")
    tables, values = list[Table](), dict[str, Any]()
    every = [clip for _, clips in there for clip in clips]
    learnt = _learnt(bench, train, tuple(every))
    for one, clips in there:
        rows = [
            default(bench, clips),
            _row(bench, SHIPPED, clips, lambda clip: bench.store.recall(shipped_table, clip)),
        ]
        for name, found in learnt.items():
            rows.append(_row(bench, name, clips, lambda clip, found=found: found[every.index(clip)]))  # type: ignore[misc]
        values[one.key] = {row.name: values_of(row) for row in rows}
        tables.append(gain_table(f"{one.title}, learnt on generated streets", rows, (DEFAULT,)))
    return tables, values


def _learnt(bench: Bench, train: tuple[Clip, ...], every: tuple[Clip, ...]) -> dict[str, list[FloatArray]]:
    shared = bench.store.recall(shared_tables, train, every, FIT, tuple(SHARES.values()))
    return {ALL: bench.store.recall(learnt_tables, train, every, FIT), **dict(zip(SHARES, shared, strict=True))}


def _row(bench: Bench, name: str, clips: list[Clip], table: Callable[[Clip], FloatArray]) -> Result:
    sums = [bench.store.recall(clip_sums, clip, table(clip)) for clip in bench.watch.over(clips, name)]
    return Result(name, np.stack(sums), "generated streets")
