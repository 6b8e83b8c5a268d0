"""Positions in space over time as CSV: ``track3d.csv``, and the truth in the same columns as far as it has them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import finite_number, read_named_rows
from tsuiseki.tracking.geometry import xywh_from_corners
from tsuiseki.tracking.types import FloatArray, IntArray, Position
from tsuiseki.tracking.types.tracks import FloorTrack, Path3D

COVARIANCE = ("xx", "xy", "xz", "yy", "yz", "zz")
HEADER = ("time", "x", "y", "z", *COVARIANCE, "score", "status")


def write_track3d(path: Path, positions: Sequence[Position]) -> None:
    """Write one row a position: seconds, metres, square metres, score and status."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for p in positions:
            numbers = [p.time, *p.point, *p.covariance[np.triu_indices(3)], p.score]
            writer.writerow([f"{value:.9g}" for value in numbers] + [p.status])


def write_path3d(path: Path, truth: Path3D) -> None:
    """Write times and points without the rest."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER[:4])
        writer.writerows([f"{value:.9g}" for value in (t, *p)] for t, p in zip(truth.times, truth.points, strict=True))


def read_path3d(path: Path) -> Path3D:
    """Times and points of a file with at least the columns time, x, y, z.

    Raises:
        RequestError: the file is missing, lacks a column, has no row, or a value is no number.
    """
    table = read_named_rows(path, "a CSV file with columns time, x, y, z", HEADER[:4])
    if not table.rows:
        raise RequestError(f"{path}: expected a header and rows of positions, found none")
    values = np.array([[finite_number(path, line, name, row[name]) for name in HEADER[:4]] for line, row in table.rows])
    return Path3D(values[:, 0], values[:, 1:])


FLOOR_HEADER = "id,time,x,y,left,top,width,height,rx,ry,rw,rh,degrees"


def write_world(path: Path, tracks: Sequence[FloorTrack], seconds: Callable[[IntArray], FloatArray]) -> None:
    """Write ``tracks`` by time, then by id; ``seconds`` gives the times of 0-based frames."""
    rows = []
    for each in tracks:
        boxes = xywh_from_corners(each.track.boxes) + np.array([1, 1, 0, 0])
        degrees = (np.degrees(each.rotated[:, 4:]) + 180) % 360 - 180
        values = np.concatenate([each.places, boxes, each.rotated[:, :4], degrees], axis=1)
        times = seconds(each.track.frames).tolist()
        for frame, time, line in zip(each.track.frames.tolist(), times, values.tolist(), strict=True):
            x, y, *rest = line
            text = ",".join([f"{x:.4f}", f"{y:.4f}", *(f"{v:.2f}" for v in rest)])
            rows.append((frame, each.track.id, f"{each.track.id},{time:.4f},{text}\n"))
    path.write_text(FLOOR_HEADER + "\n" + "".join(line for *_, line in sorted(rows)), encoding="utf-8")
