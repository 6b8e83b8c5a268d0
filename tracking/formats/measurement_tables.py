"""A sensor's measurements, points in frames and tracks of either, as CSV with a header.

Of a sensor's measurements the first column is ``time`` (seconds) or ``frame`` (whole numbers). The measured columns are
the sensor's, such as ``x,y`` or ``bearing,range``. A row whose measured cells are empty means that at this time the
sensor ran and measured nothing. Where measurements have errors of their own, columns ``sd_x,sd_y`` give standard
deviations, or ``cov_x_x``, ``cov_x_y``, ``cov_y_y`` covariances.

Of points, measurements are ``frame,x,y`` and tracks ``frame,id,x,y``, frames counted from 1; a column ``frame_idx``
instead counts them from 0. Other columns are passed over. Positions are in the unit of
the file, 0-based and continuous.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations_with_replacement, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from tsuiseki.tracking.bounds import refusal
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import (
    FIRST_FRAME,
    NamedRows,
    column_names,
    finite_number,
    read_named_rows,
    repeated,
    write_columns,
)
from tsuiseki.tracking.formats.track_tables import sensed_table, table_of
from tsuiseki.tracking.formats.tracked_video import NONE, boxes_of_tracks
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.openers.yaml_files import read_yaml
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.measurements import Scan, SensedTrack
from tsuiseki.tracking.types.sensing_model import SensingModel


def read_scans(path: Path, names: Sequence[str], period: float = 1.0) -> list[Scan]:
    """The scans of a CSV of measurements, in order of time.

    Args:
        path: of the file.
        names: of the measured columns, in the sensor's order.
        period: seconds from one frame to the next, where the file has frames; frames without a row, also those before
            the first row, are empty scans.

    Raises:
        RequestError: a column is missing, a value is no number, a covariance is not positive definite, or a row is
            earlier than the one before it.
    """
    table = read_named_rows(path, "a CSV of measurements")
    clock = next((name for name in ("time", *FIRST_FRAME) if name in table.names), "frame")
    table.need([clock, *names])
    errors = _error_columns(table, names)
    if not table.rows:
        raise RequestError(f"{path}: expected at least one row of measurements, got none")
    times = table.numbers([clock])[:, 0]
    if clock != "time":
        if (times != np.floor(times)).any():
            raise RequestError(f"{path}: expected whole numbers in column {clock}; name it time where it holds seconds")
        times = (table.frames() + 1).astype(np.float64)
    if len(early := np.flatnonzero(np.diff(times) < 0)):
        earlier, later = times[early[0] : early[0] + 2]
        line = table.rows[early[0] + 1][0]
        got = f"{later:g} after {earlier:g}"
        raise RequestError(f"{path}:{line}: expected rows in order of {clock}, got {got}; sort it")
    filled = replace(table, rows=[entry for entry in table.rows if any(entry[1][name] for name in names)])
    measured = [any(row[name] for name in names) for _, row in table.rows]
    values, spreads = filled.numbers(names), [_covariance(path, *row, names, errors) for row in filled.rows]
    covariances = np.array(spreads).reshape(-1, len(names), len(names))
    # Rows of one time are one scan; of them those count that have a measurement.
    starts, counts = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0), np.cumsum([0, *measured])
    scans = []
    for first, last in pairwise([*starts.tolist(), len(times)]):
        rows = slice(counts[first], counts[last])
        scans.append(Scan(float(times[first]), values[rows], covariances[rows] if errors else None))
    if clock == "time":
        return scans
    return _filled(path, scans, period, len(names))


def _filled(path: Path, scans: list[Scan], period: float, width: int) -> list[Scan]:
    """Scans of all frames, with their times."""
    by_frame = {scan.time: scan for scan in scans}
    last = int(max(by_frame))
    if last >= 100 * len(scans) + 1000:
        raise RequestError(f"{path}: expected frames that follow each other from 1 on, got {len(scans)} up to {last}")
    nothing = np.empty((0, width))
    filled = []
    for frame in range(1, last + 1):
        scan = by_frame.get(float(frame), Scan(frame, nothing))
        filled.append(Scan(frame * period, scan.measurements, scan.covariances))
    return filled


def _error_columns(table: NamedRows, names: Sequence[str]) -> list[str]:
    """The columns of the errors: none, ``sd_`` or ``cov_``."""
    deviations = [f"sd_{name}" for name in names]
    covariances = [f"cov_{a}_{b}" for a, b in combinations_with_replacement(names, 2)]
    for columns in (covariances, deviations):
        if any(column in table.names for column in columns):
            table.need(columns)
            return columns
    return []


def _covariance(path: Path, line: int, row: dict[str, str], names: Sequence[str], errors: Sequence[str]) -> FloatArray:
    values = [finite_number(path, line, column, row.get(column)) for column in errors]
    if not values:
        return np.eye(len(names))
    if len(values) == len(names) and errors[0].startswith("sd_"):
        if min(values) <= 0:
            raise RequestError(f"{path}:{line}: expected standard deviations above 0, got {min(values):g}")
        return np.diag(np.square(values))
    covariance = np.zeros((len(names), len(names)))
    upper = list(combinations_with_replacement(range(len(names)), 2))
    for (a, b), value in zip(upper, values, strict=True):
        covariance[a, b] = covariance[b, a] = value
    if not np.linalg.eigvalsh(covariance)[0] > 0:
        raise RequestError(f"{path}:{line}: expected a positive definite covariance, got {covariance.tolist()}")
    return covariance


def write_sensed_tracks(path: Path, tracks: Sequence[SensedTrack], dimensions: int) -> None:
    """Tracks as ``frame,time,id,x,y[,z],vx,vy[,vz]``, the covariance's upper triangle, existence and modes, by time.

    ``frame`` counts the scans from 1.
    """
    none, square = np.empty((0, dimensions)), np.empty((0, 2 * dimensions, 2 * dimensions))
    nothing = SensedTrack(1, NONE, none[:, 0], none, none, square, none[:, 0], none[:, :0])
    table = table_of(tracks) if tracks else sensed_table(nothing)
    write_columns(path, table | {"frame": table["frame"] + 1}, ".7g", time=".9g")


def read_sensing_model(path: Path) -> SensingModel:
    """The model in a YAML file; raises RequestError where it is no YAML, or a key or value is not as expected."""
    content = read_yaml(path, "a YAML file with the model of the sensor")
    try:
        return sensing_model(content or {})
    except RequestError as error:
        raise RequestError(f"{path}: {error}") from error


def sensing_model(content: Mapping[str, Any]) -> SensingModel:
    """The model of such a mapping, whose ``motion`` is one or a list; raises RequestError where it is none."""
    if not isinstance(content, Mapping) or not all(isinstance(key, str) for key in content):
        raise RequestError(f"expected keys with values, got {content!r}")
    motions = content.get("motion", {})
    values = {key: value for key, value in content.items() if key != "motion"}
    try:
        return SensingModel(motions=motions if isinstance(motions, list) else [motions], **values)  # type: ignore[arg-type]
    except ValidationError as error:
        raise RequestError(refusal(error)) from error


def is_point_file(path: Path) -> bool:
    """Whether the first line names the columns of a file of points."""
    return not FIRST_FRAME.keys().isdisjoint(column_names(path, "detections or points"))


def read_points(path: Path, length: int | None = None) -> list[FloatArray]:
    """Measured points ``(M, 2)`` of ``length`` frames, by default up to the last that has a point, from ``frame,x,y``.

    Raises:
        RequestError: a column is missing, a value is not a finite number, or a frame lies beyond the length.
    """
    table = read_named_rows(path, "a CSV of points", ("x", "y"))
    places, frames = table.numbers("xy"), table.frames()
    last = int(frames.max(initial=-1)) + 1
    if length is not None and last > length:
        raise RequestError(f"{path}: expected frames up to {length}, got {last}; are these points of another video?")
    return [places[frames == frame] for frame in range(last if length is None else length)]


def write_points(path: Path, detections: Iterable[Detections]) -> None:
    """Centres of the boxes of each frame, as `read_points` reads them."""
    listed = [*detections]
    frames = np.repeat(np.arange(1, len(listed) + 1), [len(frame) for frame in listed])
    x, y = np.concatenate([np.empty((0, 2)), *(centres(frame.boxes) for frame in listed)]).T
    scores = np.nan_to_num(np.concatenate([np.empty(0), *(frame.scores for frame in listed)]))
    write_columns(path, {"frame": frames, "x": x, "y": y, "score": scores}, ".3f", score=".4f")


def read_point_tracks(path: Path) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """0-based frames ``(N,)``, ids ``(N,)`` and positions ``(N, 2)`` of tracked points.

    Raises:
        RequestError: as :func:`read_points`, or an id stands twice in a frame.
    """
    table = read_named_rows(path, "a CSV of points", ("id", "x", "y"))
    places, frames, ids = table.numbers("xy"), table.frames(), table.whole_numbers("id", 1)
    if (row := repeated(frames, ids)) is not None:
        twice = f"id {ids[row]} twice in frame {frames[row] + 1}"
        raise RequestError(f"{path}: expected an id once in a frame, got {twice}")
    return frames, ids, places


def write_point_tracks(path: Path, tracks: Iterable[Track]) -> None:
    """Centres of the boxes of tracks, as ``frame,id,x,y,score`` by frame."""
    rows = boxes_of_tracks(tracks)
    x, y = centres(rows.boxes).T
    columns = {"frame": rows.frames + 1, "id": rows.ids, "x": x, "y": y, "score": rows.scores}
    write_columns(path, columns, ".3f", score=".4f")
