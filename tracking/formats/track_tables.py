"""Tracks of any kind as one table, and back: a row for each moment of a track, a column for each number.

The columns tell the kind: ``frame,id,x1,y1,x2,y2,score,observed`` of boxes, where they are known with ``detection``,
its row, ``class_id,class_name`` of the track and ``detection_class``, with ``single_…`` and ``multi_…`` what
people do, with ``x,y,rx,ry,rw,rh,angle`` where they are on a floor; ``frame,id,…,score,status`` of bodies;
``frame,time,id,x,y,…,existence`` of sensed targets; ``time,x,y,z,…,score,status`` of a ball in space. Frames count from
0 here and from 1 in files; boxes are in pixels from 0 in both, angles in radians.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import combinations_with_replacement
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import finite_number, read_named_rows, write_columns
from tsuiseki.tracking.formats.tracked_video import EMPTY_TRACK
from tsuiseki.tracking.openers.json_files import json_of, read_json
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.types import Position, Track
from tsuiseki.tracking.types.measurements import SensedTrack
from tsuiseki.tracking.types.tracks import ActingTrack, BodyTrack, FloorTrack

Columns: TypeAlias = dict[str, NDArray[Any]]
CORNERS = ("x1", "y1", "x2", "y2")
ROTATED = ("rx", "ry", "rw", "rh", "angle")
TEXTS = ("status", "class_name", "cameras")
WHOLE = ("frame", "id", "detection", "class_id", "detection_class")
COVARIANCE = ("xx", "xy", "xz", "yy", "yz", "zz")
# Rows and columns of the upper triangle of a covariance, in the order of `COVARIANCE`.
TRIANGLE = np.triu_indices(3)
# Under this key a file has what is known beside the tracks.
KNOWN = "tsuiseki"


def needed(module: str, what: str) -> ModuleType:
    """A module of a package that not everybody has; raises RequestError where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise RequestError(f"{what} needs {module}, which is not installed; give `pip install {module}`") from error


def table_of(tracks: Sequence[Any], names: Sequence[str] = ()) -> Columns:
    """The table of tracks of one kind, by frame, then by id.

    Args:
        tracks: of a kind in `tracking.types`, or positions of a ball.
        names: of the numbers of a body's state, or of the actions; by default they are counted from 1.
    """
    if tracks and isinstance(tracks[0], Position):
        return positions_table(tracks)
    parts = [_columns(track, names) for track in tracks] or [_boxes(EMPTY_TRACK)]
    table = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    defaults = {"detection": -1, "class_id": -1, "class_name": "", "detection_class": -1}
    table = {name: column for name, column in table.items() if name not in defaults or (column != defaults[name]).any()}
    order = np.lexsort([table["id"], table["frame"]])
    return {name: column[order] for name, column in table.items()}


def tracks_of(table: Columns) -> list[Any]:
    """The tracks of a table, by id; positions in the order of time.

    Raises:
        RequestError: its columns are of no kind, or what they say is no track.
    """
    try:
        if {"time", "x", "y", "z", "xx", "status"} <= table.keys():
            return _positions_of(table)
        if not {"frame", "id"} <= table.keys() or not {"x1", "status", "existence"} & table.keys():
            raise KeyError("frame, id, x1, y1, x2, y2")
        order = np.lexsort([table["frame"], table["id"]])
        ends = np.flatnonzero(np.diff(table["id"][order])) + 1
        make = _boxed if "x1" in table else _sensed if "existence" in table else _body
        return [make({name: table[name][rows] for name in table}) for rows in np.split(order, ends) if len(rows)]
    except KeyError as error:
        columns = ", ".join(table) or "none"
        raise RequestError(f"expected columns of tracks, such as {error.args[0]}, got {columns}") from error
    except ValueError as error:
        raise RequestError(f"expected rows of tracks: {error}") from error


def names_in(table: Columns) -> tuple[str, ...]:
    """The names that `table_of` was given."""
    if "status" in table and "id" in table:
        return tuple(name for name in table if name not in ("frame", "time", "id", "score", "status"))
    return tuple(name.removeprefix("single_") for name in table if name.startswith("single_"))


def _columns(track: Any, names: Sequence[str]) -> Columns:
    if isinstance(track, SensedTrack):
        return sensed_table(track)
    if isinstance(track, BodyTrack):
        named = _named(names, track.states.shape[1])
        state = dict(zip(named, track.states.T, strict=True))
        head = {"frame": track.frames, "id": np.full(len(track), track.id)}
        return {**head, **state, "score": track.scores, "status": np.array(track.statuses, dtype="U9")}
    table = _boxes(getattr(track, "track", track))
    if isinstance(track, FloorTrack):
        floor = np.column_stack([track.places, track.rotated])
        table |= dict(zip(("x", "y", *ROTATED), floor.T, strict=True))
    if isinstance(track, ActingTrack) and track.single is not None and track.multi is not None:
        for kind, values in (("single", track.single), ("multi", track.multi)):
            table |= {f"{kind}_{n}": row for n, row in zip(_named(names, values.shape[1]), values.T, strict=True)}
    return table


def _named(names: Sequence[str], count: int) -> list[str]:
    return list(names) if len(names) == count else [str(number + 1) for number in range(count)]


def _boxes(track: Track) -> Columns:
    corners = dict(zip(CORNERS, track.boxes.T, strict=True))
    head = {"frame": track.frames, "id": np.full(len(track), track.id)}
    kind = {"class_id": np.full(len(track), track.class_id), "class_name": np.full(len(track), track.class_name)}
    origin = {"detection": track.detection, **kind, "detection_class": track.classes}
    return {**head, **corners, "score": track.scores, "observed": track.observed, **origin}


def _boxed(part: Columns) -> Any:
    count = len(part["frame"])
    none = np.full(count, -1)
    # A track whose class alone is known has it throughout.
    origin = part.get("detection", none), part.get("detection_class", part.get("class_id", none))
    track = Track(
        int(part["id"][0]),
        part["frame"],
        np.column_stack([part[name] for name in CORNERS]),
        part.get("score", np.ones(count)),
        np.asarray(part.get("observed", np.ones(count)), dtype=np.bool_),
        np.column_stack(origin).astype(np.int64),
        {int(part["class_id"][0]): str(part["class_name"][0])} if "class_name" in part else {},
    )
    if "rx" in part:
        places, rotated = (np.column_stack([part[name] for name in columns]) for columns in (("x", "y"), ROTATED))
        return FloorTrack(track, rotated, places)
    actions = [[column for name, column in part.items() if name.startswith(kind)] for kind in ("single_", "multi_")]
    return ActingTrack(track, *map(np.column_stack, actions)) if all(actions) else track


def _body(part: Columns) -> BodyTrack:
    state = np.column_stack([part[name] for name in names_in(part)])
    statuses = tuple(part["status"].tolist())
    return BodyTrack(int(part["id"][0]), part["frame"], state, part["score"], statuses)


def _covariance_columns(axes: str) -> dict[str, tuple[int, int]]:
    """Row and column of each entry of the upper triangle of the covariance of x, vx, y, …, by its name."""
    state = [name for axis in axes for name in (axis, f"v{axis}")]
    triangle = combinations_with_replacement(range(len(state)), 2)
    return {f"cov_{state[row]}_{state[column]}": (row, column) for row, column in triangle}


def covariance_names(dimensions: int) -> list[str]:
    """Columns of the upper triangle of the covariance of x, vx, y, …"""
    return list(_covariance_columns("xyz"[:dimensions]))


def sensed_table(track: SensedTrack) -> Columns:
    """The table of one target that a sensor measured."""
    axes = "xyz"[: track.positions.shape[1]]
    modes = {f"mode{k + 1}": column for k, column in enumerate(track.modes.T)}
    return {
        **{"frame": track.scans, "time": track.times, "id": np.full(len(track), track.id)},
        **dict(zip(axes, track.positions.T, strict=True)),
        **dict(zip([f"v{axis}" for axis in axes], track.velocities.T, strict=True)),
        **{name: track.covariances[:, row, column] for name, (row, column) in _covariance_columns(axes).items()},
        **{"existence": track.existence, **modes},
    }


def _sensed(part: Columns) -> SensedTrack:
    axes = "xyz" if "z" in part else "xy"
    covariances = np.empty((len(part["id"]), 2 * len(axes), 2 * len(axes)))
    for name, (row, column) in _covariance_columns(axes).items():
        covariances[:, row, column] = covariances[:, column, row] = part[name]
    positions, velocities = (np.column_stack([part[prefix + axis] for axis in axes]) for prefix in ("", "v"))
    modes = np.array([column for name, column in part.items() if name.startswith("mode")]).reshape(-1, len(covariances))
    times, existence = part["time"], part["existence"]
    number = int(part["id"][0])
    return SensedTrack(number, part["frame"], times, positions, velocities, covariances, existence, modes.T)


def positions_table(path: Sequence[Position]) -> Columns:
    """The table of a ball's positions."""
    times, scores = (np.array([getattr(p, name) for p in path], dtype=np.float64) for name in ("time", "score"))
    points, velocities = (np.array([getattr(p, name) for p in path]).reshape(-1, 3) for name in ("point", "velocity"))
    covariances = np.array([p.covariance[TRIANGLE] for p in path]).reshape(-1, 6)
    return {
        "time": times,
        **dict(zip("xyz", points.T, strict=True)),
        **dict(zip(COVARIANCE, covariances.T, strict=True)),
        "score": scores,
        "status": np.array([p.status for p in path], dtype="U9"),
        **dict(zip(("vx", "vy", "vz"), velocities.T, strict=True)),
        **{f"open{k + 1}": column for k, column in enumerate(np.array([p.open for p in path]).T)},
    }


def _positions_of(table: Columns) -> list[Position]:
    count, axes = len(table["time"]), "xyz"
    covariances = np.zeros((count, 3, 3))
    for name, a, b in zip(COVARIANCE, *TRIANGLE, strict=True):
        covariances[:, a, b] = covariances[:, b, a] = table[name]
    points = np.column_stack([table[axis] for axis in axes])
    velocities = np.column_stack([table.get(f"v{axis}", np.zeros(count)) for axis in axes])
    open_ = np.array([column for name, column in table.items() if name.startswith("open")]).reshape(-1, count).T
    rows = zip(table["time"].tolist(), points, covariances, table["score"].tolist(), table["status"].tolist(),
               velocities, open_, strict=True)  # fmt: skip
    return [Position(*row) for row in rows]


def cut_to(track: Any, frame: int) -> Any | None:
    """The part of a track in one 0-based frame; None where it is not there."""
    frames = track.frames if hasattr(track, "frames") else track.scans
    row = np.flatnonzero(frames == frame)
    if not len(row):
        return None
    values = ((attribute.name, getattr(track, attribute.name)) for attribute in fields(track))
    cut = {name: np.asarray(value)[row] if np.ndim(value) else value for name, value in values}
    return type(track)(**cut | ({"statuses": tuple(cut["statuses"].tolist())} if "statuses" in cut else {}))


def write_table(path: Path, table: Columns, about: Mapping[str, Any]) -> None:
    """Write a table by the ending of the file: ``.csv``, ``.json`` or ``.parquet``; the last two keep ``about``, too.

    Raises:
        RequestError: Parquet needs pyarrow, which is not installed.
    """
    table = {name: column + 1 if name == "frame" else column for name, column in table.items()}
    ending = path.suffix.lower()
    if ending == ".csv":
        write_columns(path, table)
    elif ending == ".json":
        columns = ",\n".join(f"{json.dumps(name)}: {json.dumps(column.tolist())}" for name, column in table.items())
        head = json.dumps(about, default=str)
        path.write_text(f'{{"{KNOWN}": {head},\n"columns": {{\n{columns}\n}}}}\n', encoding="utf-8")
    else:
        needed("pyarrow", "Parquet")
        import pyarrow
        import pyarrow.parquet

        written = pyarrow.table(table).replace_schema_metadata({KNOWN: json.dumps(about, default=str)})
        pyarrow.parquet.write_table(written, path)


def read_table(path: Path) -> tuple[Columns, dict[str, Any]]:
    """What `write_table` wrote: the table, and what stands beside it.

    Raises:
        RequestError: there is no such file, it has something else, or Parquet needs pyarrow, which is not installed.
    """
    ending, about = path.suffix.lower(), dict[str, Any]()
    if ending == ".csv":
        table = _read_csv(path)
    elif ending == ".json":
        with refusing(f"{path}: expected tracks as `Result.save` writes them, got other JSON"):
            content = read_json(path, "tracks as JSON")
            table, about = {name: np.asarray(column) for name, column in content["columns"].items()}, content[KNOWN]
    else:
        table, about = _read_parquet(path)
    with refusing(
        f"{path}: expected tracks as `Result.save` writes them, got other columns", lambda error: f": {error}"
    ):
        _check_columns(table)
    if "frame" in table:
        table["frame"] = np.asarray(table["frame"], dtype=np.int64) - 1
        if table["frame"].min(initial=0) < 0:
            raise RequestError(f"{path}: expected frames counted from 1, got frame {table['frame'].min() + 1}")
    return table, about


def _check_columns(table: Columns) -> None:
    """Raise ValueError where columns differ in length, or hold something else than their names say."""
    for name, column in table.items():
        if column.ndim != 1 or len(column) != len(next(iter(table.values()))):
            raise ValueError(f"{name} of another length")
        if name not in TEXTS and column.size and column.dtype.kind not in "biuf":
            raise ValueError(f"{name} of something else than numbers")
        if name in WHOLE and column.size and not (np.isfinite(column) & (column == np.floor(column))).all():
            raise ValueError(f"{name} of something else than whole numbers")


def _read_csv(path: Path) -> Columns:
    rows = read_named_rows(path, "tracks with a heading")
    table: Columns = {}
    for name in rows.names:
        cells = [row[name] for _, row in rows.rows]
        try:
            column = np.array(cells, dtype=np.str_) if name in TEXTS else np.array(cells, dtype=np.float64)
        except ValueError:
            column = np.array([finite_number(path, line, name, row[name]) for line, row in rows.rows])
        table[name] = column.astype(np.int64) if name in WHOLE else column
    return table


def _read_parquet(path: Path) -> tuple[Columns, dict[str, Any]]:
    needed("pyarrow", "Parquet")
    import pyarrow
    import pyarrow.parquet

    if not path.is_file():
        raise RequestError(f"expected tracks as Parquet at {path}, found no such file")
    try:
        with refusing(f"{path}: expected Parquet, got something else"):
            read = pyarrow.parquet.read_table(path)
            table = {name: np.asarray(read[name].to_pylist()) for name in read.column_names}
            about = (read.schema.metadata or {}).get(KNOWN.encode(), b"{}")
    except (pyarrow.ArrowException, OSError) as error:
        raise RequestError(f"{path}: expected Parquet, got something else") from error
    return table, json_of(about, str(path), "what is known of a result")
