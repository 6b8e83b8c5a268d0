"""Rows of MOTChallenge's text files, ``frame, id, x, y, width, height, …``, as checked numbers."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.tracking.types.frame_range import LAST_FRAME

SCORE = 6  # Column of the score, counted from 0.


def read_rows(path: Path, columns: set[int], what: str, detected: bool = False) -> tuple[FloatArray, IntArray]:
    """The numbers of a text file, ``(N, columns)``, checked row by row, and the line ``(N,)`` that each stands in.

    Detections may be without width or height, without a score, which is NaN then, and none at all.
    """
    if not path.is_file():
        raise RequestError(f"expected {what} at {path}, found no such file")
    try:
        # Some editors put a mark before the first character.
        text = path.read_text(encoding="utf-8-sig").rstrip().splitlines()
    except UnicodeDecodeError as error:
        raise RequestError(f"{path}: expected a text file of {what}, got something binary") from error
    first = 1
    if len(text) > 1 and _is_heading(text[0]):
        shown = text[0][:60]
        warnings.warn(f"{path}: the first line, {shown!r}, is a heading and left out", InputWarning, stacklevel=3)
        text, first = text[1:], 2
    if not text and detected:
        warnings.warn(f"{path} is empty: nothing was detected", InputWarning, stacklevel=3)
        return np.empty((0, SCORE + 1)), np.empty(0, dtype=np.int64)
    if not text:
        raise RequestError(f"{path} is empty: expected rows of {what}")
    lines = np.arange(first, first + len(text))
    cells = [line.rstrip(", ").split(",") for line in text]
    width = len(cells[0])
    allowed = f"{min(columns)} to {max(columns)}" if len(columns) > 2 else " or ".join(map(str, sorted(columns)))
    for number, row in zip(lines.tolist(), cells, strict=True):
        if detected and len(row) == SCORE and width == SCORE + 1:
            row.append("")
        if len(row) != width or len(row) not in columns:
            raise RequestError(f"{path}:{number}: expected {allowed} numbers separated by commas, got {len(row)}")
        if detected and width > SCORE and not row[SCORE].strip():
            row[SCORE] = "nan"
    try:
        rows = np.array(cells, dtype=np.float64)
    except ValueError:
        told = zip(lines.tolist(), cells, strict=True)
        line, bad = next((number, cell) for number, row in told for cell in row if not _is_number(cell))
        raise RequestError(f"{path}:{line}: expected numbers separated by commas, got {bad.strip()!r}") from None
    _refuse_impossible(path, rows, lines, detected)
    return rows, lines


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _is_heading(line: str) -> bool:
    """Whether a line begins with a name, and not with a number, of which NaN is one."""
    return bool(re.match(r"[\s\"]*(?!nan\b|inf\b)[A-Za-z_]", line, re.IGNORECASE))


def _refuse_impossible(path: Path, rows: FloatArray, lines: IntArray, detected: bool) -> None:
    finite = np.isfinite(rows)
    if detected and rows.shape[1] > SCORE:
        finite[:, SCORE] |= np.isnan(rows[:, SCORE])
    not_finite = ~finite.all(axis=1)
    no_area = (rows[:, 4:6] < 0).any(axis=1) | (not detected) & (rows[:, 4:6] == 0).any(axis=1)
    no_frame = (rows[:, 0] < 1) | (rows[:, 0] != np.floor(rows[:, 0])) | (rows[:, 0] > LAST_FRAME)
    for bad, expected in (
        (not_finite, "finite numbers"),
        (no_frame, f"a whole frame number from 1 to {LAST_FRAME}"),
        (no_area, "a box with a positive width and height"),
    ):
        if bad.any():
            number = int(np.argmax(bad))
            values = ",".join(f"{value:g}" for value in rows[number, :6])
            raise RequestError(f"{path}:{lines[number]}: expected {expected}, got {values}")


def boxes_of(rows: FloatArray) -> FloatArray:
    """``(N, 4)`` 0-based corners of the boxes in columns 3 to 6."""
    xywh = rows[:, 2:6].copy()
    xywh[:, :2] -= 1
    return corners_from_xywh(xywh)


def boxes_as_text(boxes: FloatArray) -> list[str]:
    """Columns 3 to 6 of ``(N, 4)`` corners, 1-based."""
    return [f"{x + 1:.3f},{y + 1:.3f},{w:.3f},{h:.3f}" for x, y, w, h in xywh_from_corners(boxes).tolist()]
