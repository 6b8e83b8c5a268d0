"""All boxes of tracks as rows, and what differs between two reports."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.types import Track

# A box as the page reads it: frame from 0, id, corners in pixels, and whether it was filled in.
ROW = np.dtype([("frame", "<i4"), ("id", "<i4"), ("box", "<f4", 4), ("filled", "<i4")])
Rows = NDArray[Any]


def rows_of(tracks: Iterable[Track]) -> Rows:
    """All boxes of tracks as rows (`ROW`), by frame, then by id."""
    boxes = boxes_of_tracks(tracks)
    rows = np.empty(len(boxes.ids), ROW)
    for name, column in zip(ROW.names or (), (boxes.frames, boxes.ids, boxes.boxes, ~boxes.observed), strict=True):
        rows[name] = column
    return rows


def changes(old: Iterable[Track], new: Iterable[Track]) -> list[tuple[int, int, int]]:
    """Id, first and last frame of what differs between two reports."""
    spans, by_id = [], [{track.id: track for track in tracks} for tracks in (old, new)]
    for number in sorted(by_id[0].keys() | by_id[1].keys()):
        old_track, new_track = (tracks.get(number) for tracks in by_id)
        if old_track is not new_track:
            sides = [rows_of([track] if track else []).view(f"V{ROW.itemsize}") for track in (old_track, new_track)]
            frames = np.setxor1d(sides[0], sides[1]).view(ROW)["frame"]
            if len(frames):
                spans.append((number, int(frames.min()), int(frames.max())))
    return spans
