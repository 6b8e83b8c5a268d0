"""All boxes of a result as rows of one table, as the page reads them, and what differs between two of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import IntArray, Track

CHUNK = 500
"""Frames whose rows the page gets at once."""
ROW = np.dtype([("frame", "<i4"), ("id", "<i4"), ("box", "<f4", 4), ("filled", "<i4")])
Rows = NDArray[Any]


def rows_of(tracks: Iterable[Track]) -> Rows:
    """The rows (`ROW`) of tracks, by frame, then by id."""
    parts = []
    for track in tracks:
        part = np.empty(len(track), ROW)
        part["frame"], part["id"], part["box"], part["filled"] = track.frames, track.id, track.boxes, ~track.observed
        parts.append(part)
    rows = np.concatenate(parts) if parts else np.empty(0, ROW)
    return rows[np.lexsort((rows["id"], rows["frame"]))]


def chunk(rows: Rows, number: int) -> bytes:
    """The rows of `CHUNK` frames."""
    begin, end = np.searchsorted(rows["frame"], [number * CHUNK, (number + 1) * CHUNK])
    return rows[begin:end].tobytes()


def spans_of(rows: Rows) -> dict[int, list[list[int]]]:
    """By id the stretches of frames, first and last, in which it is there."""
    order = np.lexsort((rows["frame"], rows["id"]))
    ids, frames = rows["id"][order], rows["frame"][order]
    breaks = np.flatnonzero((np.diff(ids) != 0) | (np.diff(frames) != 1)) + 1
    begins, ends = np.r_[0, breaks][: len(ids)], np.r_[breaks, len(ids)] - 1
    found: dict[int, list[list[int]]] = {}
    for number, *span in zip(ids[begins].tolist(), frames[begins].tolist(), frames[ends].tolist(), strict=True):
        found.setdefault(number, []).append(span)
    return found


def changes(before: Rows, after: Rows) -> list[list[int]]:
    """Id, first and last frame of what differs between two tables."""
    marks = _marks(before), _marks(after)
    differ = np.concatenate([before[~np.isin(marks[0], marks[1])], after[~np.isin(marks[1], marks[0])]])
    ids, where = np.unique(differ["id"], return_inverse=True)
    first, last = np.full(len(ids), np.iinfo(np.int64).max), np.full(len(ids), -1)
    np.minimum.at(first, where, differ["frame"])
    np.maximum.at(last, where, differ["frame"])
    return np.column_stack([ids, first, last]).tolist()  # type: ignore[no-any-return]


def _marks(rows: Rows) -> IntArray:
    """A number for each row; of different rows they differ, save for chance of 1 in 2**64."""
    words = np.ascontiguousarray(rows).view(np.uint32).reshape(len(rows), -1).astype(np.uint64)
    factors = np.random.default_rng(0).integers(1, 2**63, words.shape[1], dtype=np.uint64) * 2 + 1
    mixed = words * factors
    return (mixed ^ (mixed >> np.uint64(29))).sum(axis=1).view(np.int64)  # type: ignore[no-any-return]
