"""Who was in a zone from when to when, how many were there at a time, and who waited."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.answers.crossings import Crossings
from tsuiseki.tracking.answers.paths import Paths
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Stays:
    """Stays in one zone, in the order of rows.

    Attributes:
        first: ``(S,)`` row of `Paths` at which each begins.
        last: ``(S,)`` last row.
        entered: ``(S,)`` False where the person was there when their path began.
        left: ``(S,)`` False where they were there when it ended.
    """

    first: IntArray
    last: IntArray
    entered: BoolArray
    left: BoolArray


def stays_of(paths: Paths, within: BoolArray, crossed: Crossings) -> Stays:
    """The stays in a zone.

    Args:
        paths: of everybody.
        within: ``(N,)`` rows in the zone.
        crossed: of its border; who goes to and fro on it stays.
    """
    pieces = np.searchsorted(paths.starts, crossed.rows, "right") - 1
    # Before the first crossing of a piece its person was on the other side; without a crossing, where most rows are.
    own = np.add.reduceat(within.astype(np.int64), paths.starts) if len(paths.starts) else np.empty(0, np.int64)
    at_start = own > 0.5 * (paths.ends - paths.starts + 1)
    at_end = at_start.copy()
    seen, first = np.unique(pieces, return_index=True)
    last = np.searchsorted(pieces, seen, "right") - 1
    at_start[seen], at_end[seen] = crossed.sides[first] < 0, crossed.sides[last] > 0
    begin, end = crossed.rows[crossed.sides > 0], crossed.rows[crossed.sides < 0] - 1
    begins = np.concatenate([begin, paths.starts[at_start]])
    ends = np.concatenate([end, paths.ends[at_end]])
    entered = np.repeat([True, False], [len(begin), int(at_start.sum())])
    left = np.repeat([True, False], [len(end), int(at_end.sum())])
    order, other = np.argsort(begins, kind="stable"), np.argsort(ends, kind="stable")
    return Stays(begins[order], ends[other], entered[order], left[other])


def speeds(paths: Paths, points: FloatArray, frame_rate: float) -> FloatArray:
    """``(N,)`` speed of each row, in units of ``points`` ``(N, 2)`` a second, over about a second."""
    half = max(1, round(0.5 * frame_rate))
    rows = np.arange(len(paths))
    low = np.maximum(rows - half, paths.first_rows)
    lengths = np.diff(np.append(paths.starts, len(paths)))
    high = np.minimum(rows + half, np.repeat(paths.ends, lengths))
    way = np.hypot(*(points[high] - points[low]).T)
    return np.asarray(way / np.maximum(high - low, 1) * frame_rate)


def people_in(paths: Paths, which: BoolArray, length: int) -> IntArray:
    """``(length,)`` number of rows at a mask in each frame."""
    return np.bincount(paths.frames[which], minlength=length)[:length]
