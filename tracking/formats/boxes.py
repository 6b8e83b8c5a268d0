"""Text files of one box a frame: OTB and UAV123 rectangles, VOT polygons, and the JSON of tracker_benchmark.

Quirks that are met here and nowhere else:

* numbers are separated by commas, tabs, semicolons or spaces, sometimes by several;
* OTB and UAV123 write ``x, y, width, height`` with 1-based pixels; VOT writes polygons ``x1, y1, ..., x4, y4`` in
  continuous coordinates, or rectangles; a polygon becomes the smallest upright box around it;
* UAV123 writes ``NaN`` where the target is out of view: such a row has no box, and no frame is scored there.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.types import FloatArray

RECTANGLE, POLYGON = 4, 8


def read_boxes(path: str | Path) -> FloatArray:
    """``(T, 4)`` corners, 0-based; a frame in which the target is not to be seen is a row of NaN.

    Raises:
        RequestError: the file is missing or empty, a row is not four or eight numbers, a number is infinite or only
            some of a row are NaN, or the first frame has no box with an area.
    """
    path = Path(path)
    if not path.is_file():
        raise RequestError(f"expected a text file with one box a line at {path}, found none")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise RequestError(f"{path}: expected text, found bytes that are none") from error
    rows = [_numbers(line, path, number) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not rows:
        raise RequestError(f"{path}: expected one box a line, found an empty file")
    if len({len(row) for row in rows}) > 1:
        odd = next(n for n, row in enumerate(rows, 1) if len(row) != len(rows[0]))
        raise RequestError(
            f"{path}: expected {len(rows[0])} numbers in every line, found {len(rows[odd - 1])} in box {odd}"
        )
    values = np.array(rows)
    boxes = corners_from_xywh(values - [1, 1, 0, 0]) if values.shape[1] == RECTANGLE else polygon_hulls(values)
    _check_first(boxes, path)
    return boxes


def _numbers(line: str, path: Path, number: int) -> list[float]:
    words = [word for word in re.split(r"[\s,;]+", line.strip()) if word]
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) not in (RECTANGLE, POLYGON):
        raise RequestError(
            f"{path}, line {number}: expected x,y,width,height or four corners, got {line.strip()[:60]!r}"
        )
    missing = sum(map(math.isnan, values))
    if any(map(math.isinf, values)) or 0 < missing < len(values):
        raise RequestError(
            f"{path}, line {number}: expected finite numbers, or NaN in all of them for a hidden target, "
            f"got {line.strip()[:60]!r}"
        )
    return values


def _check_first(boxes: FloatArray, path: Path) -> None:
    first = boxes[0]
    if not (np.isfinite(first).all() and first[2] > first[0] and first[3] > first[1]):
        raise RequestError(
            f"{path}: expected a box with an area in the first frame, where tracking starts, "
            f"got {xywh_from_corners(first).tolist()}"
        )


def polygon_hulls(polygons: FloatArray) -> FloatArray:
    """Smallest upright boxes ``(N, 4)`` around polygons ``(N, 8)`` of four corners x, y.

    >>> polygon_hulls(np.array([[1, 0, 2, 1, 1, 2, 0, 1.0]])).tolist()
    [[0.0, 0.0, 2.0, 2.0]]
    """
    corners = np.asarray(polygons, dtype=np.float64).reshape(-1, 4, 2)
    return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)


def write_boxes(path: Path, boxes: FloatArray) -> None:
    """Write ``(T, 4)`` corners as OTB text, ``x,y,width,height`` with 1-based pixels."""
    rows = xywh_from_corners(boxes) + np.array([1, 1, 0, 0])
    path.write_text("".join(",".join(f"{v:.4f}" for v in row) + "\n" for row in rows), encoding="utf-8")


def read_result(path: str | Path) -> FloatArray:
    """A tracker's boxes ``(T, 4)`` from OTB text or from the JSON of tracker_benchmark; NaN where it gave none.

    Raises:
        RequestError: see `read_boxes`; in JSON, no boxes or boxes of a kind other than rectangles and corners.
    """
    path = Path(path)
    if path.suffix.lower() != ".json":
        return read_boxes(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise RequestError(f"{path}: expected a result of tracker_benchmark in JSON, cannot read it") from error
    return _json_boxes(content, path)


def _json_boxes(content: Any, path: Path) -> FloatArray:
    run = content[0] if isinstance(content, list) and content else content
    kind = run.get("resType", "rect") if isinstance(run, dict) else None
    if kind not in ("rect", "4corner") or not run.get("res"):
        raise RequestError(f"{path}: expected boxes under 'res' with 'resType' rect or 4corner, got {kind!r}")
    try:
        values = np.array(run["res"], dtype=np.float64).reshape(len(run["res"]), -1)
    except (TypeError, ValueError) as error:
        raise RequestError(f"{path}: expected a list of boxes under 'res', got something else") from error
    if values.shape[1] == POLYGON:
        return polygon_hulls(values - 1)
    if values.shape[1] != RECTANGLE:
        raise RequestError(f"{path}: expected four numbers a box, got {values.shape[1]}")
    return corners_from_xywh(values - [1, 1, 0, 0])
