"""All boxes of a result as rows of one table, as the page reads them, and what differs between two of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import Track

CHUNK = 500
"""Frames whose rows the page gets at once."""
ROW = np.dtype([("frame", "<i4"), ("id", "<i4"), ("box", "<f4", 4), ("filled", "<i4")])
Rows = NDArray[Any]


def rows_of(tracks: Iterable[Track]) -> Rows:
    """The rows (`ROW`) of tracks, by frame, then by id."""
    parts = [np.empty(0, ROW)]
    for track in tracks:
        parts.append(np.empty(len(track), ROW))
        for name, column in zip(ROW.names or (), (track.frames, track.id, track.boxes, ~track.observed), strict=True):
            parts[-1][name] = column
    rows = np.concatenate(parts)
    return rows[np.lexsort((rows["id"], rows["frame"]))]


def chunk(rows: Rows, number: int) -> bytes:
    """The rows of `CHUNK` frames."""
    begin, end = np.searchsorted(rows["frame"], [number * CHUNK, (number + 1) * CHUNK])
    return rows[begin:end].tobytes()


def spans_of(track: Track) -> list[list[int]]:
    """The stretches of frames, first and last, in which a track is there."""
    breaks = np.flatnonzero(np.diff(track.frames) != 1)
    return np.column_stack([track.frames[np.r_[0, breaks + 1]], track.frames[np.r_[breaks, -1]]]).tolist()  # type: ignore[no-any-return]


def changes(before: Mapping[int, Track], after: Mapping[int, Track]) -> list[tuple[int, int, int]]:
    """Id, first and last frame of what differs between two results, tracks by id."""
    found = []
    for number in sorted(before.keys() | after.keys()):
        pair = [tracks.get(number) for tracks in (before, after)]
        if pair[0] != pair[1]:
            one, other = (rows_of([track] if track else []).view(f"V{ROW.itemsize}") for track in pair)
            frames = np.setxor1d(one, other).view(ROW)["frame"]
            if len(frames):
                found.append((number, int(frames.min()), int(frames.max())))
    return found
