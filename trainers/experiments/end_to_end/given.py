"""Rows on given detections: costs by default, learnt on pairs, learnt through the flow, and searched for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.experiments.association.runs import Result, clip_sums, right_sums
from tsuiseki.trainers.experiments.association.sequences import Clip, DataSet
from tsuiseki.trainers.experiments.end_to_end.choosing import (
    LOOKS,
    SHARES,
    hota,
    pattern_search,
    scalar_sums,
    share_sums,
)
from tsuiseki.trainers.experiments.end_to_end.pairwise import pairwise_tables
from tsuiseki.trainers.experiments.end_to_end.runs import (
    default_table,
    learnt_tables,
    shared_tables,
)
from tsuiseki.trainers.experiments.experiment import Bench

# How many groups the sequences of a set are cut into; each is tracked by what was learnt on the others.
FOLDS = {"mot15": 6, "mot17": 4, "kitti-pedestrians": 5, "kitti-cars": 4, "streets": 4}
GAP = 2.0
DEFAULT, LOGISTIC, TREES, ORACLE = "default", "pairs, logistic", "pairs, boosted trees", "right links"
SEARCHED, SHARED = "direct search", "both losses, shares by HOTA"
POOLED = "both losses, other sets too"
BOTH = "both losses"
LEARNT = {"Fenchel-Young": Fit(loss="fenchel_young"), "hinge": Fit(loss="hinge"), BOTH: Fit()}
FIT_OF_POOL = Fit(steps=300)
OTHERS = {
    "all of the change of detections": Fit(trust=1.0),
    "windows of 6 s": Fit(seconds=6.0),
    "Δ by length of the identity": Fit(length=0.5),
    "ε from 3 to 0.5": Fit(epsilon=3.0, epsilon_last=0.5),
    "joins as they are": Fit(joins=0.0),
    "two hidden layers of 12": Fit(hidden=12),
    "400 windows": Fit(steps=400),
    "cross-entropy of links beside": Fit(pairwise=0.3),
}
OF_OTHERS, OF_POOL = "the other groups", "the other groups and sets"


def given(bench: Bench, one: DataSet, clips: list[Clip], others: Sequence[Clip] = ()) -> list[Result]:
    """All rows of a data set.

    Args:
        bench: where it works.
        one: the data set.
        clips: its sequences.
        others: sequences of other sets, for the row that learns from them, too; by default there is no such row.
    """
    recall = bench.store.recall
    rows = [
        default(bench, clips),
        *(_learnt(bench, one, clips, name, fit) for name, fit in LEARNT.items()),
        _folded(bench, one, clips, LOGISTIC, lambda a, b: recall(pairwise_tables, a, b, "logistic")),
        _folded(bench, one, clips, TREES, lambda a, b: recall(pairwise_tables, a, b, "trees")),
        *([_pooled(bench, one, clips, others)] if others else []),
        _shared(bench, one, clips),
        _searched(bench, one, clips),
    ]
    oracle = np.stack([recall(right_sums, clip, GAP, True) for clip in clips])
    return [*rows, Result(ORACLE, oracle, "labels")]


def alternatives(bench: Bench, one: DataSet, clips: list[Clip]) -> list[Result]:
    """Other ways to learn through the flow."""
    every = {**LEARNT, **OTHERS}
    return [default(bench, clips), *(_learnt(bench, one, clips, name, fit) for name, fit in every.items())]


def default(bench: Bench, clips: list[Clip]) -> Result:
    """The tracker's own costs."""
    recall = bench.store.recall
    sums = [recall(clip_sums, clip, recall(default_table, clip)) for clip in bench.watch.over(clips, DEFAULT)]
    return Result(DEFAULT, np.stack(sums), "the tracker's own")


def groups_of(one: DataSet, clips: list[Clip]) -> list[list[int]]:
    """Which sequences lie in each group."""
    count = min(FOLDS[one.key], len(clips))
    return [[k for k in range(len(clips)) if k % count == group] for group in range(count)]


def _learnt(bench: Bench, one: DataSet, clips: list[Clip], name: str, fit: Fit) -> Result:
    return _folded(bench, one, clips, name, lambda a, b: bench.store.recall(learnt_tables, a, b, fit))


def _pooled(bench: Bench, one: DataSet, clips: list[Clip], others: Sequence[Clip]) -> Result:
    def tables(train: tuple[Clip, ...], tests: tuple[Clip, ...]) -> list[FloatArray]:
        return bench.store.recall(learnt_tables, (*train, *others), tests, FIT_OF_POOL)

    return replace(_folded(bench, one, clips, POOLED, tables), settings=OF_POOL)


def _folded(
    bench: Bench,
    one: DataSet,
    clips: list[Clip],
    name: str,
    tables: Callable[[tuple[Clip, ...], tuple[Clip, ...]], list[FloatArray]],
) -> Result:
    """A row whose every sequence was tracked by what was learnt on the other groups."""
    sums = [np.empty(0)] * len(clips)
    for tested in bench.watch.over(groups_of(one, clips), f"{one.key}: {name}"):
        train = tuple(clip for k, clip in enumerate(clips) if k not in tested)
        for k, table in zip(tested, tables(train, tuple(clips[k] for k in tested)), strict=True):
            sums[k] = bench.store.recall(clip_sums, clips[k], table)
    return Result(name, np.stack(sums), OF_OTHERS)


def _shared(bench: Bench, one: DataSet, clips: list[Clip]) -> Result:
    """Learnt through the flow, of which as much is taken as HOTA inside the training groups asks for."""
    groups, fit = groups_of(one, clips), LEARNT[BOTH]
    inner = dict[tuple[int, int], dict[int, FloatArray]]()
    pairs = list(combinations(range(len(groups)), 2)) if len(groups) > 2 else []
    for a, b in bench.watch.over(pairs, f"{one.key}: shares"):
        tested = sorted(groups[a] + groups[b])
        train = tuple(clip for k, clip in enumerate(clips) if k not in tested)
        found = bench.store.recall(share_sums, train, tuple(clips[k] for k in tested), fit)
        inner[a, b] = dict(zip(tested, found, strict=True))

    def tables(train: tuple[Clip, ...], tests: tuple[Clip, ...]) -> list[FloatArray]:
        left = next(number for number, group in enumerate(groups) if clips[group[0]] == tests[0])
        (found,) = bench.store.recall(shared_tables, train, tests, fit, (_best_share(inner, groups, left),))
        return found

    return _folded(bench, one, clips, SHARED, tables)


def _best_share(
    inner: dict[tuple[int, int], dict[int, FloatArray]], groups: list[list[int]], left: int
) -> tuple[float, float]:
    """The share that is best on the groups but ``left``, each by what neither it nor ``left`` had a part in."""

    def others() -> Iterator[FloatArray]:
        for (a, b), found in inner.items():
            if left in (a, b):
                yield from (found[k] for k in groups[b if left == a else a])

    sums = list(others())
    if not sums:
        return SHARES[0]
    return SHARES[int(np.argmax([hota([one[k] for one in sums]) for k in range(len(SHARES))]))]


def _searched(bench: Bench, one: DataSet, clips: list[Clip]) -> Result:
    """Six scalars by direct search on HOTA of the other groups."""
    recall, sums = bench.store.recall, [np.empty(0)] * len(clips)
    for tested in bench.watch.over(groups_of(one, clips), f"{one.key}: {SEARCHED}"):
        train = [clip for k, clip in enumerate(clips) if k not in tested]
        best = pattern_search(lambda s, train=train: hota([recall(scalar_sums, clip, s) for clip in train]), LOOKS)  # type: ignore[misc]
        for k in tested:
            sums[k] = recall(scalar_sums, clips[k], best)
    return Result(SEARCHED, np.stack(sums), f"{OF_OTHERS}, {LOOKS} looks")
