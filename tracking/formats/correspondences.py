"""Known points of the world and where cameras see them: a CSV file with a header.

Columns: ``x, y, z`` (metres, z up), ``u, v`` (pixels, the first pixel's centre at 0.5), and optionally ``camera`` (a
name; rows without it belong to one camera).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import finite_number, read_named_rows, whole_number
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.frame_range import LAST_FRAME

COLUMNS = ("x", "y", "z", "u", "v")


@dataclass(frozen=True)
class Correspondences:
    """Points of one camera.

    Attributes:
        camera: its name.
        points: ``(N, 3)`` metres.
        pixels: ``(N, 2)``.
        lines: ``(N,)`` line of each point in the file, from 1.
    """

    camera: str
    points: FloatArray
    pixels: FloatArray
    lines: list[int]


def read_correspondences(path: Path) -> list[Correspondences]:
    """The points of each camera, cameras in the order of their first rows.

    Raises:
        RequestError: the file is missing or lacks a column, or a value is no finite number; the message says where.
    """
    return _read(path, COLUMNS)


def read_floor_points(path: Path) -> Correspondences:
    """The points of one camera on the floor: as `read_correspondences`, without the column ``z``, which is 0.

    Raises:
        RequestError: as `read_correspondences`, or there are several cameras.
    """
    groups = _read(path, [name for name in COLUMNS if name != "z"])
    if len(groups) > 1:
        raise RequestError(f"{path}: expected the points of one camera, got {len(groups)}; give a file for each")
    return groups[0]


def _read(path: Path, columns: Sequence[str]) -> list[Correspondences]:
    table = read_named_rows(path, f"a CSV file with columns {', '.join(columns)}", columns)
    found: dict[str, list[tuple[int, list[float]]]] = {}
    for line, row in table.rows:
        values = [finite_number(path, line, n, row[n]) if n in columns else 0.0 for n in COLUMNS]
        found.setdefault(row.get("camera") or "camera1", []).append((line, values))
    if not found:
        raise RequestError(f"{path}: expected rows of points, found none")
    return [_group(name, lines) for name, lines in found.items()]


def _group(name: str, rows: list[tuple[int, list[float]]]) -> Correspondences:
    values = np.array([v for _, v in rows])
    return Correspondences(name, values[:, :3], values[:, 3:], [line for line, _ in rows])


VISIBLE = ("visibility", "visible", "vis")
HALF_PIXEL = 0.5


def read_ball_points(path: Path) -> FloatArray:
    """``(T, 2)`` pixels of frames 0 to T - 1, NaN where the ball was not seen.

    Raises:
        RequestError: the file or a column is missing, a value is no number, or a frame stands twice.
    """
    table = read_named_rows(path, "a CSV with a ball's pixels", ("frame", "x", "y"))
    visible = next((name for name in table.names if name.lower() in VISIBLE), None)
    first, shift = (1, 0.0) if visible is None else (0, HALF_PIXEL)
    found: dict[int, tuple[float, float]] = {}
    for line, row in table.rows:
        frame = whole_number(path, line, "frame", row["frame"], first, LAST_FRAME + first) - first
        if frame in found:
            raise RequestError(f"{path}:{line}: expected each frame once, got {row['frame']} again")
        hidden = not (row["x"] or row["y"])
        if visible is not None and not hidden:
            hidden = finite_number(path, line, visible, row[visible]) == 0
        place = (np.nan, np.nan) if hidden else tuple(finite_number(path, line, name, row[name]) for name in ("x", "y"))
        found[frame] = (place[0] + shift, place[1] + shift)
    if not any(np.isfinite(place[0]) for place in found.values()):
        raise RequestError(f"{path}: expected at least one frame that shows the ball, got none")
    pixels = np.full((max(found) + 1, 2), np.nan)
    pixels[list(found)] = list(found.values())
    return pixels
