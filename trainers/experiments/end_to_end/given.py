"""Rows on given detections: costs by default, learnt on pairs, learnt through the flow, and searched for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.association.flow_loss import FlowLoss
from tsuiseki.trainers.experiments.association.runs import Result, clip_sums, right_sums
from tsuiseki.trainers.experiments.association.sequences import Clip, DataSet
from tsuiseki.trainers.experiments.end_to_end.choosing import (
    LOOKS,
    SHARES,
    best_share,
    hota,
    pattern_search,
    scalar_sums,
    share_sums,
)
from tsuiseki.trainers.experiments.end_to_end.folds import OF_OTHERS, Learner, folds_of, groups_of, learnt_rows
from tsuiseki.trainers.experiments.end_to_end.pairwise import mixed_tables, pairwise_tables
from tsuiseki.trainers.experiments.end_to_end.runs import default_table, learnt_tables, shared_tables
from tsuiseki.trainers.experiments.experiment import Bench

GAP = 2.0
DEFAULT, LOGISTIC, TREES, ORACLE = "default", "pairs, logistic", "pairs, boosted trees", "right links"
MIXED = "detections by trees of pairs"
SEARCHED, SHARED, SURE, POOLED = "direct search", "shares by HOTA", "shares that surely gain", "other sets too"
BOTH = "both losses"
LEARNT = {"Fenchel-Young": Fit(FlowLoss("fenchel_young")), "hinge": Fit(FlowLoss("hinge")), BOTH: Fit()}
FIT_OF_POOL = Fit(steps=300)
OTHERS = {
    "all of the change of detections": Fit(trust=1.0),
    "windows of 6 s": Fit(seconds=6.0),
    "joins as they are": Fit(joins=0.0),
    "400 windows": Fit(steps=400),
}
# What may help where few sequences teach.
FOR_FEW = {
    "another seed": Fit(seed=1),
}
# All rows of other ways; those of OTHERS are of the first set alone, as is POOLED.
ALTERNATIVES = (*OTHERS, *FOR_FEW, MIXED, POOLED, SHARED, SURE, SEARCHED)


def given(bench: Bench, one: DataSet, clips: list[Clip], processes: int = 0) -> list[Result]:
    """The rows of a data set.

    Args:
        bench: where it works.
        one: the data set.
        clips: its sequences.
        processes: folds at the same time; 0 takes all cores.
    """
    learners = [
        *through_the_flow(LEARNT),
        Learner(LOGISTIC, pairwise_tables, "logistic"),
        Learner(TREES, pairwise_tables, "trees"),
    ]
    oracle = np.stack([bench.store.recall(right_sums, clip, GAP, True) for clip in clips])
    learnt = learnt_rows(bench, one, clips, learners, processes)
    return [default(bench, clips), *learnt, Result(ORACLE, oracle, "labels")]


def alternatives(
    bench: Bench,
    one: DataSet,
    clips: list[Clip],
    others: Sequence[Clip] = (),
    processes: int = 0,
    rows: Sequence[str] = ALTERNATIVES,
) -> list[Result]:
    """Other ways to learn through the flow, and without it; and both losses, as they are learnt by default.

    Args:
        bench: where it works.
        one: the data set.
        clips: its sequences.
        others: sequences of other sets, for the row that learns from them, too; by default there is no such row.
        processes: folds at the same time; 0 takes all cores.
        rows: of `ALTERNATIVES`.
    """
    fits = {name: fit for name, fit in {**OTHERS, **FOR_FEW}.items() if name in rows}
    learners = through_the_flow({BOTH: LEARNT[BOTH], **fits})
    if MIXED in rows:
        learners.append(Learner(MIXED, mixed_tables, LEARNT[BOTH]))
    if others and POOLED in rows:
        learners.append(Learner(POOLED, learnt_tables, FIT_OF_POOL, tuple(others)))
    learnt = learnt_rows(bench, one, clips, learners, processes)
    own = default(bench, clips)
    found = [own, *learnt]
    if {SHARED, SURE} & set(rows):
        found += [row for row in _shared(bench, one, clips, own) if row.name in rows]
    return [*found, _searched(bench, one, clips)] if SEARCHED in rows else found


def default(bench: Bench, clips: Sequence[Clip]) -> Result:
    """The tracker's own costs."""
    recall = bench.store.recall
    sums = [recall(clip_sums, clip, recall(default_table, clip)) for clip in bench.watch.over(clips, DEFAULT)]
    return Result(DEFAULT, np.stack(sums), "the tracker's own")


def through_the_flow(fits: dict[str, Fit]) -> list[Learner]:
    """Rows of networks learnt through the flow."""
    return [Learner(name, learnt_tables, fit) for name, fit in fits.items()]


def _shared(bench: Bench, one: DataSet, clips: list[Clip], own: Result) -> list[Result]:
    """Learnt through the flow, of which as much is taken as HOTA inside the training groups asks for; and surely."""
    groups, fit, recall = groups_of(one, clips), LEARNT[BOTH], bench.store.recall
    inner = dict[tuple[int, int], dict[int, FloatArray]]()
    pairs = list(combinations(range(len(groups)), 2)) if len(groups) > 2 else []
    for a, b in bench.watch.over(pairs, f"{one.key}: shares"):
        tested = sorted(groups[a] + groups[b])
        train = tuple(clip for k, clip in enumerate(clips) if k not in tested)
        found = recall(share_sums, train, tuple(clips[k] for k in tested), fit)
        inner[a, b] = dict(zip(tested, found, strict=True))
    rows = []
    for name, sure in ((SHARED, False), (SURE, True)):
        sums, taken = own.sums.copy(), 0
        for left, fold in enumerate(bench.watch.over(folds_of(one, clips), f"{one.key}: {name}")):
            share = best_share(others_of(inner, groups, left), sure)
            if share == SHARES[0]:
                continue
            taken += 1
            (tables,) = recall(shared_tables, fold.train, fold.tests, fit, (share,))
            for k, clip, table in zip(groups[left], fold.tests, tables, strict=True):
                sums[k] = recall(clip_sums, clip, table)
        rows.append(Result(name, sums, f"{OF_OTHERS}, {taken} of {len(groups)} times"))
    return rows


def others_of(
    inner: dict[tuple[int, int], dict[int, FloatArray]], groups: list[list[int]], left: int
) -> list[FloatArray]:
    """Sums of the sequences but ``left``'s, each by what neither it nor ``left`` had a part in."""
    return [found[k] for (a, b), found in inner.items() if left in (a, b) for k in groups[b if left == a else a]]


def _searched(bench: Bench, one: DataSet, clips: list[Clip]) -> Result:
    """Six scalars by direct search on HOTA of the other groups."""
    recall, sums = bench.store.recall, dict[Clip, FloatArray]()
    for fold in bench.watch.over(folds_of(one, clips), f"{one.key}: {SEARCHED}"):
        best = pattern_search(lambda s, fold=fold: hota([recall(scalar_sums, clip, s) for clip in fold.train]), LOOKS)  # type: ignore[misc]
        sums |= {clip: recall(scalar_sums, clip, best) for clip in fold.tests}
    return Result(SEARCHED, np.stack([sums[clip] for clip in clips]), f"{OF_OTHERS}, {LOOKS} looks")
