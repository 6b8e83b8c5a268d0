"""Points as CSV with a header: measurements ``frame,x,y`` and tracks ``frame,id,x,y``, frames counted from 1.

Further columns are allowed and passed over. Positions are in the unit of the file, 0-based and continuous.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME


def is_point_file(path: Path) -> bool:
    """Whether the first line names the columns of a file of points."""
    if not path.is_file():
        raise RequestError(f"expected a file at {path}, found none")
    with path.open(encoding="utf-8", errors="replace") as file:
        names = {name.strip() for name in file.readline().split(",")}
    return "frame" in names


def read_points(path: Path, length: int | None = None) -> list[FloatArray]:
    """Measured points ``(M, 2)`` of each frame.

    Args:
        path: CSV with the columns ``frame,x,y``.
        length: number of frames; by default up to the last frame that has a point.

    Raises:
        RequestError: a column is missing, a value is not a finite number, or a frame lies beyond the length.
    """
    rows = _columns(path, ("frame", "x", "y"))
    frames = rows[:, 0].astype(np.int64) - 1
    last = int(frames.max(initial=-1)) + 1
    if length is not None and last > length:
        raise RequestError(f"{path}: expected frames up to {length}, got {last}; are these points of another video?")
    return [rows[frames == frame, 1:] for frame in range(last if length is None else length)]


def read_point_tracks(path: Path) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """0-based frames ``(N,)``, ids ``(N,)`` and positions ``(N, 2)`` of tracked points.

    Raises:
        RequestError: as :func:`read_points`, or an id stands twice in a frame.
    """
    rows = _columns(path, ("frame", "id", "x", "y"))
    frames, ids = rows[:, 0].astype(np.int64) - 1, rows[:, 1].astype(np.int64)
    pairs, counts = np.unique(np.stack([frames, ids], axis=1), axis=0, return_counts=True)
    if np.any(counts > 1):
        frame, identity = pairs[np.argmax(counts)]
        raise RequestError(f"{path}: expected an id once in a frame, got id {identity} twice in frame {frame + 1}")
    return frames, ids, rows[:, 2:]


def write_point_tracks(path: Path, tracks: Iterable[Track]) -> None:
    """Centres of the boxes of tracks, as ``frame,id,x,y,score`` by frame."""
    rows = [
        (int(frame) + 1, track.id, *((box[:2] + box[2:]) / 2), float(score))
        for track in tracks
        for frame, box, score in zip(track.frames, track.boxes, track.scores, strict=True)
    ]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "id", "x", "y", "score"])
        writer.writerows([frame, i, f"{x:.3f}", f"{y:.3f}", f"{score:.4f}"] for frame, i, x, y, score in sorted(rows))


def _columns(path: Path, names: tuple[str, ...]) -> FloatArray:
    if not path.is_file():
        raise RequestError(f"expected a CSV of points at {path}, found no file")
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        missing = [name for name in names if name not in (reader.fieldnames or [])]
        if missing:
            raise RequestError(
                f"{path}: expected the columns {','.join(names)} in its first line, found no {missing[0]}"
            )
        rows = [[_number(path, line, name, row[name]) for name in names] for line, row in enumerate(reader, start=2)]
    return np.array(rows, dtype=np.float64).reshape(-1, len(names))


def _number(path: Path, line: int, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    whole = name in ("frame", "id")
    if not np.isfinite(value) or (whole and (value != int(value) or not 1 <= value <= LAST_FRAME)):
        kind = f"a whole number from 1 to {LAST_FRAME}" if whole else "a finite number"
        raise RequestError(f"{path}:{line}: expected {kind} in column {name}, got {text!r}")
    return value
