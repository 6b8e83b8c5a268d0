"""Points as CSV with a header: measurements ``frame,x,y`` and tracks ``frame,id,x,y``, frames counted from 1.

Further columns are allowed and passed over. Positions are in the unit of the file, 0-based and continuous.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import (
    LARGEST_ID,
    column_names,
    finite_number,
    read_named_rows,
    repeated,
    whole_number,
    write_csv,
)
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME


def is_point_file(path: Path) -> bool:
    """Whether the first line names the columns of a file of points."""
    return "frame" in column_names(path, "detections or points")


def read_points(path: Path, length: int | None = None) -> list[FloatArray]:
    """Measured points ``(M, 2)`` of each frame.

    Args:
        path: CSV with the columns ``frame,x,y``.
        length: number of frames; by default up to the last frame that has a point.

    Raises:
        RequestError: a column is missing, a value is not a finite number, or a frame lies beyond the length.
    """
    rows, whole = _columns(path, ("frame",))
    frames = whole[:, 0] - 1
    last = int(frames.max(initial=-1)) + 1
    if length is not None and last > length:
        raise RequestError(f"{path}: expected frames up to {length}, got {last}; are these points of another video?")
    return [rows[frames == frame] for frame in range(last if length is None else length)]


def write_points(path: Path, detections: Iterable[Detections]) -> None:
    """Centres of the boxes of each frame, as `read_points` reads them."""
    rows = (
        [frame, f"{x:.3f}", f"{y:.3f}", f"{score:.4f}"]
        for frame, found in enumerate(detections, start=1)
        for (x, y), score in zip(centres(found.boxes).tolist(), np.nan_to_num(found.scores).tolist(), strict=True)
    )
    write_csv(path, ["frame", "x", "y", "score"], rows)


def read_point_tracks(path: Path) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """0-based frames ``(N,)``, ids ``(N,)`` and positions ``(N, 2)`` of tracked points.

    Raises:
        RequestError: as :func:`read_points`, or an id stands twice in a frame.
    """
    places, whole = _columns(path, ("frame", "id"))
    frames, ids = whole[:, 0] - 1, whole[:, 1]
    if (row := repeated(frames, ids)) is not None:
        twice = f"id {ids[row]} twice in frame {frames[row] + 1}"
        raise RequestError(f"{path}: expected an id once in a frame, got {twice}")
    return frames, ids, places


def write_point_tracks(path: Path, tracks: Iterable[Track]) -> None:
    """Centres of the boxes of tracks, as ``frame,id,x,y,score`` by frame."""
    rows = [
        (frame + 1, track.id, *place, score)
        for track in tracks
        for frame, place, score in zip(
            track.frames.tolist(), centres(track.boxes).tolist(), track.scores.tolist(), strict=True
        )
    ]
    lines = ([frame, i, f"{x:.3f}", f"{y:.3f}", f"{score:.4f}"] for frame, i, x, y, score in sorted(rows))
    write_csv(path, ["frame", "id", "x", "y", "score"], lines)


def _columns(path: Path, names: tuple[str, ...]) -> tuple[FloatArray, IntArray]:
    """``(N, 2)`` the columns x and y, and ``(N, len(names))`` whole numbers from 1."""
    table = read_named_rows(path, "a CSV of points", (*names, "x", "y"))
    places = [[finite_number(path, line, name, row[name]) for name in "xy"] for line, row in table.rows]
    last = {"frame": LAST_FRAME, "id": LARGEST_ID}
    whole = [[whole_number(path, line, name, row[name], 1, last[name]) for name in names] for line, row in table.rows]
    return np.array(places).reshape(-1, 2), np.array(whole, dtype=np.int64).reshape(-1, len(names))
