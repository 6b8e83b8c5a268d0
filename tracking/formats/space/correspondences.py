"""Known points of the world and where cameras see them: a CSV file with a header.

Columns: ``x, y, z`` (metres, z up), ``u, v`` (pixels, the first pixel's centre at 0.5), and optionally ``camera`` (a
name; rows without it belong to one camera).
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.columns import finite_number
from tsuiseki.tracking.types import FloatArray

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
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise RequestError(f"{path}: expected a CSV file with columns {', '.join(columns)}, cannot read it") from error
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
    names = [name.strip() for name in rows.fieldnames or []]
    rows.fieldnames = names
    missing = [name for name in columns if name not in names]
    if missing:
        raise RequestError(f"{path}: expected a header with columns {', '.join(columns)}, found no {missing[0]}")
    found: dict[str, list[tuple[int, list[float]]]] = {}
    for row in rows:
        values = [finite_number(path, rows.line_num, n, row[n]) if n in columns else 0.0 for n in COLUMNS]
        found.setdefault((row.get("camera") or "camera1").strip(), []).append((rows.line_num, values))
    if not found:
        raise RequestError(f"{path}: expected rows of points, found none")
    return [_group(name, lines) for name, lines in found.items()]


def _group(name: str, rows: list[tuple[int, list[float]]]) -> Correspondences:
    values = np.array([v for _, v in rows])
    return Correspondences(name, values[:, :3], values[:, 3:], [line for line, _ in rows])
