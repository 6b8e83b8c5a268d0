"""Places in the world as CSV: known points, positions that a sensor measured, and those of tracks.

Metres and seconds, z up; pixels with the first one's centre at 0.5. Columns:

* known points: ``x, y, z``, ``u, v`` (pixels), and optionally ``camera`` (rows without it belong to one camera);
* another sensor's positions on a floor: ``time, x, y``, and optionally ``sd``, the standard deviation along each axis,
  and ``id``, which is certain: it names the person;
* ``track3d.csv``: positions in space over time, and the truth in the same columns as far as it has them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import finite_number, read_named_rows, repeated, whole_number, write_columns
from tsuiseki.tracking.formats.track_tables import COVARIANCE, positions_table
from tsuiseki.tracking.geometry import xywh_from_corners
from tsuiseki.tracking.types import FloatArray, IntArray, Position
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.tracks import FloorTrack, Path3D

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


def read_floor_points(path: Path) -> Correspondences:
    """The points of one camera on the floor: as `read_correspondences`, without the column ``z``, which is 0.

    Raises:
        RequestError: as `read_correspondences`, or there are several cameras.
    """
    groups = read_correspondences(path, [name for name in COLUMNS if name != "z"])
    if len(groups) > 1:
        raise RequestError(f"{path}: expected the points of one camera, got {len(groups)}; give a file for each")
    return groups[0]


def read_correspondences(path: Path, columns: Sequence[str] = COLUMNS) -> list[Correspondences]:
    """The points of each camera, cameras in the order of their first rows; a column that is left out is 0.

    Raises:
        RequestError: the file is missing or lacks a column, or a value is no finite number; the message says where.
    """
    table = read_named_rows(path, f"a CSV file with columns {', '.join(columns)}", columns)
    if not table.rows:
        raise RequestError(f"{path}: expected rows of points, found none")
    by_name = dict(zip(columns, table.numbers(columns).T, strict=True))
    values = np.column_stack([by_name.get(name, np.zeros(len(table.rows))) for name in COLUMNS])
    cameras = [row.get("camera") or "camera1" for _, row in table.rows]
    groups = []
    for camera in dict.fromkeys(cameras):
        rows = [k for k, name in enumerate(cameras) if name == camera]
        lines = [table.rows[k][0] for k in rows]
        groups.append(Correspondences(camera, values[rows, :3], values[rows, 3:], lines))
    return groups


VISIBLE = ("visibility", "visible", "vis")
# Files with a column of visibility count frames from 0 and pixels from the first one's centre.
HALF_PIXEL = 0.5


def read_ball_points(path: Path) -> FloatArray:
    """``(T, 2)`` pixels of frames 0 to T - 1, NaN where the ball was missed.

    Raises:
        RequestError: the file or a column is missing, a value is no number, or a frame stands twice.
    """
    table = read_named_rows(path, "a CSV with a ball's pixels", ("x", "y"))
    visible = next((name for name in table.names if name.lower() in VISIBLE), None)
    shift = 0.0 if visible is None else HALF_PIXEL
    frames = table.frames() if visible is None else table.whole_numbers("frame", 0, LAST_FRAME)
    if (again := repeated(frames)) is not None:
        line, row = table.rows[again]
        raise RequestError(f"{path}:{line}: expected each frame once, got {row.get('frame', frames[again])} again")
    hidden = np.array([
        not (row["x"] or row["y"]) or (visible is not None and finite_number(path, line, visible, row[visible]) == 0)
        for line, row in table.rows
    ], dtype=np.bool_)  # fmt: skip
    if hidden.all():
        raise RequestError(f"{path}: expected at least one frame that shows the ball, got none")
    pixels = np.full((int(frames.max()) + 1, 2), np.nan)
    visible_rows = replace(table, rows=[row for row, none in zip(table.rows, hidden, strict=True) if not none])
    pixels[frames[~hidden]] = visible_rows.numbers(("x", "y")) + shift
    return pixels


# Standard deviation of a position along each axis where a file does not say, metres.
DEVIATION = 0.2
# Deviations that two places of one person may lie apart, and a metre.
SAME = 5.0


@dataclass(frozen=True)
class FloorPositions:
    """What a sensor measured, by time.

    Attributes:
        path: of the file.
        times: ``(N,)`` seconds.
        places: ``(N, 2)`` metres.
        deviations: ``(N,)`` metres.
        names: ``(N,)`` ids, -1 for none.
    """

    path: Path
    times: FloatArray
    places: FloatArray
    deviations: FloatArray
    names: IntArray

    def between(self, first: float, last: float) -> FloorPositions:
        """Those of the time from ``first`` to ``last``, seconds, both included."""
        rows = (self.times >= first) & (self.times <= last)
        return FloorPositions(self.path, self.times[rows], self.places[rows], self.deviations[rows], self.names[rows])


def read_floor_positions(path: Path) -> FloorPositions:
    """The positions in a file.

    Raises:
        RequestError: a column is missing, a value is no number, a deviation is not above 0, or an id is twice at once.
    """
    table = read_named_rows(path, "a CSV of positions", ("time", "x", "y"))
    if not table.rows:
        raise RequestError(f"{path}: expected rows of positions, found none")
    deviations = [
        finite_number(path, line, "sd", row["sd"]) if row.get("sd") else DEVIATION for line, row in table.rows
    ]
    for (line, _), deviation in zip(table.rows, deviations, strict=True):
        if not deviation > 0:
            raise RequestError(f"{path}:{line}: expected an sd above 0 metres, got {deviation:g}")
    ids = [whole_number(path, line, "id", row["id"], 1) if row.get("id") else -1 for line, row in table.rows]
    values = np.column_stack([table.numbers(("time", "x", "y")), deviations])
    order = np.argsort(values[:, 0], kind="stable")
    values, names = values[order], np.array(ids, dtype=np.int64)[order]
    identified = names >= 0
    if repeated(values[identified, 0], names[identified]) is not None:
        raise RequestError(f"{path}: expected each id once at a time, got one twice")
    return FloorPositions(path, values[:, 0], values[:, 1:3], values[:, 3], names)


def check_names(sensors: list[FloorPositions], tolerance: float) -> None:
    """Refuse an id that two sensors give to different people at once.

    Raises:
        RequestError: two places of one id within the tolerance lie farther apart than their deviations allow.
    """
    for k, sensor in enumerate(sensors):
        for second in sensors[k + 1 :]:
            for row in np.flatnonzero(sensor.names >= 0):
                at = (second.names == sensor.names[row]) & (np.abs(second.times - sensor.times[row]) <= tolerance)
                for twin in np.flatnonzero(at):
                    apart = float(np.linalg.norm(sensor.places[row] - second.places[twin]))
                    if apart > SAME * np.hypot(sensor.deviations[row], second.deviations[twin]) + 1.0:
                        raise RequestError(
                            f"expected one place of id {sensor.names[row]} at {sensor.times[row]:g} s, got places "
                            f"{apart:.1f} m apart in {sensor.path} and {second.path}"
                        )


HEADER = ("time", "x", "y", "z", *COVARIANCE, "score", "status")


def write_track3d(path: Path, positions: Sequence[Position]) -> None:
    """Write one row a position: seconds, metres, square metres, score and status."""
    table = positions_table(positions)
    write_columns(path, {name: table[name] for name in HEADER})


def write_path3d(path: Path, truth: Path3D) -> None:
    """Write times and points without the rest."""
    write_columns(path, dict(zip(HEADER, (truth.times, *truth.points.T), strict=False)))


def read_path3d(path: Path) -> Path3D:
    """Times and points of a file with at least the columns time, x, y, z.

    Raises:
        RequestError: the file is missing, lacks a column, has no row, or a value is no number.
    """
    table = read_named_rows(path, "a CSV file with columns time, x, y, z", HEADER[:4])
    if not table.rows:
        raise RequestError(f"{path}: expected a header and rows of positions, found none")
    values = table.numbers(HEADER[:4])
    return Path3D(values[:, 0], values[:, 1:])


FLOOR_HEADER = "id,time,x,y,left,top,width,height,rx,ry,rw,rh,degrees"


def write_world(path: Path, tracks: Sequence[FloorTrack], seconds: Callable[[IntArray], FloatArray]) -> None:
    """Write ``tracks`` by time, then by id; ``seconds`` gives the times of 0-based frames."""
    rows = []
    for track in tracks:
        boxes = xywh_from_corners(track.track.boxes) + np.array([1, 1, 0, 0])
        degrees = (np.degrees(track.rotated[:, 4:]) + 180) % 360 - 180
        values = np.concatenate([track.places, boxes, track.rotated[:, :4], degrees], axis=1)
        times = seconds(track.track.frames).tolist()
        for frame, time, line in zip(track.track.frames.tolist(), times, values.tolist(), strict=True):
            x, y, *sizes = line
            text = ",".join([f"{x:.4f}", f"{y:.4f}", *(f"{v:.2f}" for v in sizes)])
            rows.append((frame, track.track.id, f"{track.track.id},{time:.4f},{text}\n"))
    path.write_text(FLOOR_HEADER + "\n" + "".join(line for *_, line in sorted(rows)), encoding="utf-8")
