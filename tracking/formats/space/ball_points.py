"""Pixels of one ball in every frame of one camera, as CSV.

``frame,x,y`` counts frames from 1, with pixels whose first one's centre lies at 0.5; a frame without a row, or with
empty cells, did not show the ball. TrackNet's ``Frame,Visibility,X,Y`` counts frames from 0 and pixels from the first
one's centre, and has 0 for Visibility where the ball was not seen.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.columns import finite_number
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.frame_range import LAST_FRAME

VISIBLE = ("visibility", "visible", "vis")
HALF_PIXEL = 0.5


def read_ball_points(path: Path) -> FloatArray:
    """``(T, 2)`` pixels of frames 0 to T - 1, NaN where the ball was not seen.

    Raises:
        RequestError: the file or a column is missing, a value is no number, or a frame stands twice.
    """
    if not path.is_file():
        raise RequestError(f"expected a CSV with a ball's pixels at {path}, found no file")
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        header = [name.strip().lower() for name in reader.fieldnames or []]
        reader.fieldnames = header
        rows = list(reader)
    missing = [name for name in ("frame", "x", "y") if name not in header]
    if missing:
        raise RequestError(f"{path}: expected the columns frame,x,y in its first line, found no {missing[0]}")
    visible = next((name for name in VISIBLE if name in header), None)
    first, shift = (1, 0.0) if visible is None else (0, HALF_PIXEL)
    found: dict[int, tuple[float, float]] = {}
    for line, row in enumerate(rows, start=2):
        frame = finite_number(path, line, "frame", row["frame"]) - first
        if frame != int(frame) or not 0 <= frame <= LAST_FRAME:
            raise RequestError(
                f"{path}:{line}: expected a whole number from {first} in column frame, got {row['frame']}"
            )
        if int(frame) in found:
            raise RequestError(f"{path}:{line}: expected each frame once, got {row['frame']} again")
        empty = not (row["x"] or "").strip() and not (row["y"] or "").strip()
        hidden = empty or (visible is not None and finite_number(path, line, visible, row[visible]) == 0)
        place = (np.nan, np.nan) if hidden else tuple(finite_number(path, line, name, row[name]) for name in ("x", "y"))
        found[int(frame)] = (place[0] + shift, place[1] + shift)
    if not any(np.isfinite(place[0]) for place in found.values()):
        raise RequestError(f"{path}: expected at least one frame that shows the ball, got none")
    pixels = np.full((max(found) + 1, 2), np.nan)
    pixels[list(found)] = list(found.values())
    return pixels
