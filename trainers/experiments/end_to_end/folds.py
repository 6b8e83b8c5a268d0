"""Groups of sequences, each tracked by what the others taught: a process a fold does all rows of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from tsuiseki.tracking.processes import on_all_cores
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.experiments.association.runs import Result, clip_sums
from tsuiseki.trainers.experiments.association.sequences import Clip, DataSet
from tsuiseki.trainers.experiments.experiment import Bench
from tsuiseki.trainers.experiments.store import Store

# How many groups the sequences of a set are cut into.
FOLDS = {"mot15": 6, "mot17": 4, "kitti-pedestrians": 5, "kitti-cars": 4, "streets": 4}
OF_OTHERS, OF_POOL = "the other groups", "the other groups and sets"


@dataclass(frozen=True)
class Learner:
    """A row of a table.

    Attributes:
        name: of the row.
        tables: gives the tracks of the tested sequences by what the training sequences teach.
        how: its third argument.
        others: sequences of other sets that teach, too.
    """

    name: str
    tables: Callable[..., list[FloatArray]]
    how: Fit | str
    others: tuple[Clip, ...] = ()

    def sums(self, store: Store, fold: Fold) -> list[FloatArray]:
        """``(83,)`` of each tested sequence, see `score_sums`."""
        found = store.recall(self.tables, (*fold.train, *self.others), fold.tests, self.how)
        return [store.recall(clip_sums, clip, table) for clip, table in zip(fold.tests, found, strict=True)]


@dataclass(frozen=True)
class Fold:
    """What is learnt from, and what is tracked by it.

    Attributes:
        train: sequences.
        tests: likewise.
    """

    train: tuple[Clip, ...]
    tests: tuple[Clip, ...]


def groups_of(one: DataSet, clips: Sequence[Clip]) -> list[list[int]]:
    """Which sequences lie in each group."""
    count = min(FOLDS[one.key], len(clips))
    return [[k for k in range(len(clips)) if k % count == group] for group in range(count)]


def folds_of(one: DataSet, clips: Sequence[Clip]) -> list[Fold]:
    """Each group, and the others that teach it."""
    return [
        Fold(tuple(clip for k, clip in enumerate(clips) if k not in group), tuple(clips[k] for k in group))
        for group in groups_of(one, clips)
    ]


def learnt_rows(
    bench: Bench, one: DataSet, clips: Sequence[Clip], learners: Sequence[Learner], processes: int = 0
) -> list[Result]:
    """A row a learner, whose every sequence was tracked by what was learnt on the other groups.

    Args:
        bench: where it works.
        one: the data set.
        clips: its sequences.
        learners: the rows.
        processes: folds at the same time; 0 takes all cores.
    """
    folds = folds_of(one, clips)
    work = on_all_cores(partial(_sums, bench.store, tuple(learners)), folds, processes=processes)
    sums = list(bench.watch.over(work, f"{one.key}: groups with {len(learners)} rows", len(folds)))
    place = {clip: (fold, k) for fold, part in enumerate(folds) for k, clip in enumerate(part.tests)}
    return [
        Result(
            learner.name,
            np.stack([sums[fold][row][k] for fold, k in (place[clip] for clip in clips)]),
            OF_POOL if learner.others else OF_OTHERS,
        )
        for row, learner in enumerate(learners)
    ]


def _sums(store: Store, learners: tuple[Learner, ...], fold: Fold) -> list[list[FloatArray]]:
    return [learner.sums(store, fold) for learner in learners]
