"""HOTA, CLEAR MOT and identity scores, from the overlaps of true and reported boxes in every frame.

Each metric is a few sums over a sequence. The sums of several sequences add up to those of all of them together.

* `hota`: Luiten et al., "HOTA: a higher order metric for evaluating multi-object tracking", IJCV 2021. True and
  reported tracks that overlap much over the whole sequence are matched first (the alignment below). For every threshold
  α the detections count by TP, FN and FP, and each matched pair c by A(c) = TPA / (TPA + FNA + FPA).
* `clear`: Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics", 2008.
  A pair of the frame before is kept as long as it overlaps enough; the others are matched by overlap.
* `identity`: Ristani et al., "Performance measures and a data set for multi-target, multi-camera tracking", 2016. True
  and reported identities are matched one to one for the whole sequence.

The numbers are those of trackeval, the reference implementation of HOTA's authors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from tsuiseki.tracking.types import FloatArray, IntArray

# Overlaps that HOTA averages over.
ALPHAS = np.arange(0.05, 0.99, 0.05)
# Overlaps that reach a threshold but for rounding count.
ROUNDING = float(np.finfo(np.float64).eps)
# Above any sum of overlaps in a frame: a pair of the frame before is kept before others are made.
KEPT = 1000.0


@dataclass(frozen=True)
class LabelledSequence:
    """True and reported boxes of every frame.

    Attributes:
        true_ids: of each frame ``(n,)`` numbers from 0.
        reported_ids: likewise ``(m,)``.
        overlaps: of each frame ``(n, m)`` in [0, 1].
        true_count: how many true identities there are.
        reported_count: how many reported ones.
    """

    true_ids: Sequence[IntArray]
    reported_ids: Sequence[IntArray]
    overlaps: Sequence[FloatArray]
    true_count: int
    reported_count: int

    @classmethod
    def of(cls, true: Sequence[IntArray], reported: Sequence[IntArray], overlaps: Sequence[FloatArray]) -> Self:
        """The same with any ids ``(n,)`` and ``(m,)`` of each frame, which are numbered here."""
        true_ids, true_count = _numbered(true)
        reported_ids, reported_count = _numbered(reported)
        return cls(true_ids, reported_ids, overlaps, true_count, reported_count)

    def lengths(self) -> tuple[FloatArray, FloatArray]:
        """In how many frames each true and each reported identity is."""
        return (
            np.bincount(_joined(self.true_ids), minlength=self.true_count).astype(np.float64),
            np.bincount(_joined(self.reported_ids), minlength=self.reported_count).astype(np.float64),
        )


class Sums:
    """Sums over a sequence; those of several add up field by field."""

    def __add__(self, addend: Self) -> Self:
        return type(self)(
            *(mine + theirs for mine, theirs in zip(vars(self).values(), vars(addend).values(), strict=True))
        )


@dataclass(frozen=True)
class Hota(Sums):
    """Sums for each threshold of `ALPHAS`.

    Attributes:
        hits: ``(19,)`` TP.
        misses: ``(19,)`` FN.
        false: ``(19,)`` FP.
        associations: ``(19,)`` the sum of A(c) over all TP.
    """

    hits: FloatArray
    misses: FloatArray
    false: FloatArray
    associations: FloatArray

    @property
    def det_a(self) -> FloatArray:
        """``(19,)`` detection accuracy."""
        return self.hits / np.maximum(1, self.hits + self.misses + self.false)

    @property
    def ass_a(self) -> FloatArray:
        """``(19,)`` association accuracy."""
        return self.associations / np.maximum(1, self.hits)

    @property
    def hota(self) -> FloatArray:
        """``(19,)`` geometric mean of the two."""
        return np.asarray(np.sqrt(self.det_a * self.ass_a))


@dataclass(frozen=True)
class Clear(Sums):
    """Counts of CLEAR MOT, and the sum of the overlaps of all hits."""

    hits: int
    misses: int
    false: int
    switches: int
    overlap: float

    @property
    def mota(self) -> float:
        """1 minus misses, false boxes and switches per true box."""
        return (self.hits - self.false - self.switches) / max(1, self.hits + self.misses)

    @property
    def motp(self) -> float:
        """Mean overlap of the hits."""
        return self.overlap / max(1, self.hits)

    @property
    def recall(self) -> float:
        """Detected share of the true boxes."""
        return self.hits / max(1, self.hits + self.misses)

    @property
    def precision(self) -> float:
        """Right share of the reported boxes."""
        return self.hits / max(1, self.hits + self.false)


@dataclass(frozen=True)
class Identity(Sums):
    """Boxes with the right identity, without one, and with a wrong one."""

    hits: int
    misses: int
    false: int

    @property
    def idf1(self) -> float:
        """Harmonic mean of identity recall and identity precision."""
        return self.hits / max(1.0, self.hits + 0.5 * (self.misses + self.false))


def hota(sequence: LabelledSequence) -> Hota:
    """Matches at 19 overlaps from 0.05 to 0.95, from which HOTA and its parts follow."""
    true_lengths, reported_lengths = sequence.lengths()
    alignment = _alignment(sequence, true_lengths, reported_lengths)
    pairs, overlaps = [], []
    for true, reported, shared in zip(sequence.true_ids, sequence.reported_ids, sequence.overlaps, strict=True):
        rows, columns = scipy.optimize.linear_sum_assignment(
            alignment[true[:, None], reported[None]] * shared, maximize=True
        )
        pairs.append(true[rows] * sequence.reported_count + reported[columns])
        overlaps.append(shared[rows, columns])
    cells, shares = _joined(pairs), np.concatenate([np.empty(0), *overlaps])
    both = (true_lengths[:, None] + reported_lengths[None]).ravel()
    hits, associations = np.zeros(len(ALPHAS)), np.zeros(len(ALPHAS))
    for n, alpha in enumerate(ALPHAS):
        common = np.bincount(cells[shares >= alpha - ROUNDING], minlength=len(both))
        hits[n] = common.sum()
        associations[n] = (common * (common / np.maximum(1, both - common))).sum()
    return Hota(hits, true_lengths.sum() - hits, reported_lengths.sum() - hits, associations)


def _alignment(sequence: LabelledSequence, true_lengths: FloatArray, reported_lengths: FloatArray) -> FloatArray:
    """``(true, reported)`` how much two identities overlap over the sequence: a soft Jaccard index of their boxes."""
    common = np.zeros((sequence.true_count, sequence.reported_count))
    for true, reported, shared in zip(sequence.true_ids, sequence.reported_ids, sequence.overlaps, strict=True):
        either = shared.sum(axis=0)[None] + shared.sum(axis=1)[:, None] - shared
        common[true[:, None], reported[None]] += np.divide(
            shared, either, out=np.zeros_like(shared), where=either > ROUNDING
        )
    return common / (true_lengths[:, None] + reported_lengths[None] - common)


def clear(sequence: LabelledSequence, least: float = 0.5) -> Clear:
    """The counts of CLEAR MOT, for boxes that match from an overlap of ``least`` on."""
    unmatched = -1
    last = np.full(sequence.true_count, unmatched)  # whom each was matched to when it was last matched
    previous = last.copy()  # whom it was matched to in the last frame that had boxes of both kinds
    hits = misses = false = switches = 0
    overlap = 0.0
    for true, reported, shared in zip(sequence.true_ids, sequence.reported_ids, sequence.overlaps, strict=True):
        if not shared.size:
            misses, false = misses + len(true), false + len(reported)
            continue
        gain = KEPT * (previous[true][:, None] == reported[None]) + shared
        gain[shared < least - ROUNDING] = 0
        rows, columns = scipy.optimize.linear_sum_assignment(gain, maximize=True)
        matched = gain[rows, columns] > ROUNDING
        who, whom = true[rows[matched]], reported[columns[matched]]
        switches += int(((last[who] != unmatched) & (last[who] != whom)).sum())
        last[who] = whom
        previous[:] = unmatched
        previous[who] = whom
        hits, misses, false = hits + len(who), misses + len(true) - len(who), false + len(reported) - len(who)
        overlap += float(shared[rows[matched], columns[matched]].sum())
    return Clear(hits, misses, false, switches, overlap)


def identity(sequence: LabelledSequence, least: float = 0.5) -> Identity:
    """The counts of the identity scores, for boxes that match from an overlap of ``least`` on."""
    common = np.zeros((sequence.true_count, sequence.reported_count))
    for true, reported, shared in zip(sequence.true_ids, sequence.reported_ids, sequence.overlaps, strict=True):
        common[true[:, None], reported[None]] += shared >= least
    rows, columns = scipy.optimize.linear_sum_assignment(common, maximize=True)
    hits = int(common[rows, columns].sum())
    return Identity(hits, sum(map(len, sequence.true_ids)) - hits, sum(map(len, sequence.reported_ids)) - hits)


def _numbered(parts: Sequence[IntArray]) -> tuple[list[IntArray], int]:
    """The ids of each frame as numbers from 0, and how many there are."""
    unique, numbers = np.unique(_joined(parts), return_inverse=True)
    cuts = np.cumsum([len(part) for part in parts[:-1]], dtype=np.int64)
    return np.split(numbers.astype(np.int64), cuts), len(unique)


def _joined(parts: Sequence[IntArray]) -> IntArray:
    return np.concatenate([np.empty(0, dtype=np.int64), *parts])
