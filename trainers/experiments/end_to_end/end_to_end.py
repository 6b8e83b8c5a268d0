"""Costs learnt through the flow, on given detections (`reproduce end-to-end`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.experiments.association.runs import Result, clip_sums, right_sums
from tsuiseki.trainers.experiments.association.sequences import DATA_SETS, Clip, DataSet, find_clips
from tsuiseki.trainers.experiments.association.tables import values_of
from tsuiseki.trainers.experiments.end_to_end.gradient import draw_gradient
from tsuiseki.trainers.experiments.end_to_end.runs import default_table, learnt_tables, lost_links, pairwise_tables
from tsuiseki.trainers.experiments.end_to_end.tables import gain_table, limit_table
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table

SETS = ("mot15", "mot17", "kitti-pedestrians", "kitti-cars")
PARTS = ("given", "alternatives", "gradient")
# How many groups the sequences of a set are cut into; each is tracked by what was learnt on the others.
FOLDS = {"mot15": 6, "mot17": 4, "kitti-pedestrians": 5, "kitti-cars": 4}
GAP = 2.0
DEFAULT, LOGISTIC, TREES, ORACLE = "default", "pairs, logistic", "pairs, boosted trees", "right links"
LEARNT = {"Fenchel-Young": Fit(), "hinge": Fit(loss="hinge")}
OTHERS = {
    "all of the change of detections": Fit(trust=1.0),
    "windows of 6 s": Fit(seconds=6.0),
    "hinge, Δ by length of the identity": Fit(loss="hinge", length=0.5),
    "ε from 3 to 0.5": Fit(epsilon=3.0, epsilon_last=0.5),
    "joins as they are": Fit(joins=0.0),
    "two hidden layers of 12": Fit(hidden=12),
    "400 windows": Fit(steps=400),
    "cross-entropy of links beside": Fit(pairwise=0.3),
}


def reproduce(
    bench: Bench,
    data: Path = Path("../shared/data"),
    sets: list[str] = list(SETS),  # noqa: B006, the parser shows it and nobody changes it
    parts: list[str] = list(PARTS),  # noqa: B006
) -> Outcome:
    """Costs learnt through the flow against costs learnt on pairs and those by default: HOTA, MOTA, IDF1, switches.

    The sequences of a set are cut into groups; each is tracked by what was learnt on the others.

    Args:
        bench: where it works.
        data: folder that holds mot/mot17-val-half, mot/mot15, mot/kitti; a set that is not there is passed over.
        sets: of mot15, mot17, kitti-pedestrians and kitti-cars, separated by commas.
        parts: given (all rows), alternatives (other ways to learn through the flow, on mot15 alone), gradient (the
            picture), separated by commas.

    Raises:
        RequestError: an unknown set or part, or no data.
    """
    _check(sets, parts)
    there = [(one, find_clips(data, one)) for one in DATA_SETS if one.key in sets]
    there = [(one, clips) for one, clips in there if clips]
    if not there:
        raise RequestError(f"data: expected mot/mot17-val-half or another of the data sets in {data}, found none")
    tables, values = list[Table](), {}
    for one, clips in sorted(there, key=lambda pair: SETS.index(pair[0].key)):
        if "given" in parts:
            results = _given(bench, one, clips)
            values[one.key] = {result.name: values_of(result) for result in results}
            tables.append(gain_table(one.title, results, (DEFAULT, LOGISTIC)))
            tables.append(limit_table(one.title, [c.name for c in clips], _limits(bench, clips)))
        if "alternatives" in parts and one.key == "mot15":
            tables.append(gain_table(f"{one.title}, alternatives", _alternatives(bench, one, clips), (DEFAULT,)))
    plots = {"gradient": draw_gradient()} if "gradient" in parts else {}
    return Outcome(values, tables, plots, notes=_notes())


def _check(sets: Sequence[str], parts: Sequence[str]) -> None:
    for name, given, known in (("sets", sets, SETS), ("parts", parts, PARTS)):
        wrong = [one for one in given if one not in known]
        if wrong or not given:
            raise RequestError(f"{name}: expected some of {', '.join(known)}, got {', '.join(wrong) or 'none'}")


def _given(bench: Bench, one: DataSet, clips: list[Clip]) -> list[Result]:
    """All rows of a data set."""
    rows = [
        _default(bench, clips),
        *(_learnt(bench, one, clips, name, fit) for name, fit in LEARNT.items()),
        _folded(bench, one, clips, LOGISTIC, lambda a, b: bench.store.recall(pairwise_tables, a, b, "logistic")),
        _folded(bench, one, clips, TREES, lambda a, b: bench.store.recall(pairwise_tables, a, b, "trees")),
    ]
    oracle = np.stack([bench.store.recall(right_sums, clip, GAP, True) for clip in clips])
    return [*rows, Result(ORACLE, oracle, "labels")]


def _alternatives(bench: Bench, one: DataSet, clips: list[Clip]) -> list[Result]:
    every = {**LEARNT, **OTHERS}
    return [_default(bench, clips), *(_learnt(bench, one, clips, name, fit) for name, fit in every.items())]


def _default(bench: Bench, clips: list[Clip]) -> Result:
    recall = bench.store.recall
    sums = [recall(clip_sums, clip, recall(default_table, clip)) for clip in bench.watch.over(clips, DEFAULT)]
    return Result(DEFAULT, np.stack(sums), "the tracker's own")


def _learnt(bench: Bench, one: DataSet, clips: list[Clip], name: str, fit: Fit) -> Result:
    return _folded(bench, one, clips, name, lambda a, b: bench.store.recall(learnt_tables, a, b, replace(fit)))


def _folded(
    bench: Bench,
    one: DataSet,
    clips: list[Clip],
    name: str,
    tables: Callable[[tuple[Clip, ...], tuple[Clip, ...]], list[FloatArray]],
) -> Result:
    """A row whose every sequence was tracked by what was learnt on the other groups."""
    groups = min(FOLDS[one.key], len(clips))
    sums = [np.empty(0)] * len(clips)
    for group in bench.watch.over(range(groups), f"{one.key}: {name}"):
        train = tuple(clip for k, clip in enumerate(clips) if k % groups != group)
        tested = [k for k in range(len(clips)) if k % groups == group]
        for k, table in zip(tested, tables(train, tuple(clips[k] for k in tested)), strict=True):
            sums[k] = bench.store.recall(clip_sums, clips[k], table)
    return Result(name, np.stack(sums), "the other groups")


def _limits(bench: Bench, clips: list[Clip]) -> list[list[int]]:
    return [bench.store.recall(lost_links, clip) for clip in clips]


def _notes() -> list[str]:
    return [
        "Intervals: paired bootstrap over sequences, 2,000 samples, 95 %. Settings of the fits were chosen on MOT15; "
        "the other sets had no part in that. The default's were chosen on these four sequences of MOT17."
    ]
