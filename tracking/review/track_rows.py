"""All boxes of tracks as rows, and what differs between two reports."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.types import Track

ROW = np.dtype([("frame", "<i4"), ("id", "<i4"), ("box", "<f4", 4), ("filled", "<i4")])


Rows = NDArray[Any]


def rows_of(tracks: Iterable[Track]) -> Rows:
    """All boxes of tracks as rows (`ROW`), by frame, then by id."""
    every = boxes_of_tracks(tracks)
    rows = np.empty(len(every.ids), ROW)
    for name, column in zip(ROW.names or (), (every.frames, every.ids, every.boxes, ~every.observed), strict=True):
        rows[name] = column
    return rows


def changes(before: Iterable[Track], after: Iterable[Track]) -> list[tuple[int, int, int]]:
    """Id, first and last frame of what differs between two reports."""
    found, by_id = [], [{track.id: track for track in tracks} for tracks in (before, after)]
    for number in sorted(by_id[0].keys() | by_id[1].keys()):
        one, other = (tracks.get(number) for tracks in by_id)
        if one is not other:
            sides = [rows_of([track] if track else []).view(f"V{ROW.itemsize}") for track in (one, other)]
            frames = np.setxor1d(sides[0], sides[1]).view(ROW)["frame"]
            if len(frames):
                found.append((number, int(frames.min()), int(frames.max())))
    return found
