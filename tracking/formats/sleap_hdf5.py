"""Points of animals in SLEAP's HDF5 files: projects (.slp) and analysis files (.h5). Needs h5py.

A project holds tables: ``frames`` (a range of instances each), ``instances`` (a range of points and a track each),
``points`` of users and ``pred_points`` of the network, and JSON with the names. Before format 1.1 the corner of the
first pixel was 0, 0; from then on, and here, it is its centre. An analysis file holds arrays:
SLEAP's own ``tracks`` is tracks x 2 x nodes x frames, and that of sleap-io says in ``dims`` what its axes are.
"""

from __future__ import annotations

import importlib.util
import io
import json
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.openers.json_files import json_of
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.tracks import PointTable

SIGNATURE = b"\x89HDF\r\n\x1a\n"
MISSING = "pip install h5py (or tsuiseki[hdf5]), or give CSV: sleap-convert --format analysis.csv"
# Type of an instance that a user placed.
USER = 0
# Type of an instance that a network found.
PREDICTED = 1
CENTRED = 1.1
"""Format of projects from which the first pixel's centre is 0, 0."""
# Format of projects that are written; its tables follow.
WRITTEN = 1.2
FRAME = [("frame_id", "u8"), ("video", "u4"), ("frame_idx", "u8"), ("instance_id_start", "u8"),
         ("instance_id_end", "u8")]  # fmt: skip
INSTANCE = [("instance_id", "i8"), ("instance_type", "u1"), ("frame_id", "u8"), ("skeleton", "u4"), ("track", "i4"),
            ("from_predicted", "i8"), ("score", "f4"), ("point_id_start", "u8"), ("point_id_end", "u8"),
            ("tracking_score", "f4")]  # fmt: skip
POINT = [("x", "f8"), ("y", "f8"), ("visible", "?"), ("complete", "?")]


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5, by its first bytes."""
    with path.open("rb") as raw:
        return raw.read(len(SIGNATURE)) == SIGNATURE


def hdf5_installed() -> bool:
    """Whether h5py is there."""
    return importlib.util.find_spec("h5py") is not None


def _h5py(path: Path) -> Any:
    if not hdf5_installed():
        raise RequestError(f"{path} is HDF5, which needs h5py: {MISSING}")
    return importlib.import_module("h5py")


@contextmanager
def _written(h5py: Any, path: Path) -> Iterator[Any]:
    """A file to fill, which is made in memory: HDF5 crashes where it closes one on a full disk."""
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        yield file
    path.write_bytes(content.getbuffer())


def read_sleap_hdf5(path: Path) -> PointTable:
    """The points in a project or analysis file; of a project's first video.

    Where a user placed an animal that the network had found too, the user's points count.

    Raises:
        RequestError: h5py is missing, or the file is neither, such as DeepLabCut's.
    """
    h5py = _h5py(path)
    try:
        with h5py.File(path, "r") as file:
            if "pred_points" in file and "instances" in file:
                return _project(path, file)
            if "tracks" in file and "node_names" in file:
                return _analysis(file)
            names = ", ".join(list(file)[:5])
    except (OSError, RuntimeError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise RequestError(
            f"{path}: expected SLEAP's project or analysis file, got one that is broken: {error}"
        ) from error
    raise RequestError(
        f"{path}: expected SLEAP's project or analysis file, got HDF5 with {names}; DeepLabCut's .h5 is a table of "
        "pandas: give the CSV beside it"
    )


def write_sleap_analysis(path: Path, table: PointTable, length: int) -> None:
    """Write SLEAP's analysis file of the animals that ``tracks`` name, in a video of ``length`` frames.

    Raises:
        RequestError: h5py is missing.
    """
    h5py = _h5py(path)
    names = list(dict.fromkeys(table.tracks))
    points = np.full((length, len(table.nodes), 2, len(names)), np.nan)
    scores = np.full((length, len(table.nodes), len(names)), np.nan)
    there = np.zeros((len(names), length))
    for n in range(len(table)):
        track = names.index(table.tracks[n])
        points[table.frames[n], :, :, track] = table.points[n]
        scores[table.frames[n], :, track] = table.scores[n]
        there[track, table.frames[n]] = 1
    with _written(h5py, path) as file:
        arrays = {"tracks": points, "point_scores": scores, "track_occupancy": there}
        for name, values in arrays.items():
            file.create_dataset(name, data=values.T, compression="gzip")
        for name, texts in {"node_names": table.nodes, "track_names": names}.items():
            file.create_dataset(name, data=np.array([text.encode() for text in texts], dtype="S"))


def write_sleap_project(path: Path, video: TrackedVideo) -> None:
    """Write SLEAP's project, with all points as predictions; it names the video, which SLEAP expects beside it.

    Raises:
        RequestError: h5py is missing.
    """
    h5py = _h5py(path)
    table = video.nodes
    order = np.argsort(table.frames, kind="stable")
    names, count = list(dict.fromkeys(table.tracks)), len(table.nodes)
    numbers, starts = np.unique(table.frames[order], return_index=True)
    ends = np.append(starts, len(order))
    means = np.nan_to_num(table.scores).mean(axis=1)
    instances = [
        (k, PREDICTED, frame, 0, names.index(table.tracks[n]), -1, means[n], k * count, (k + 1) * count, 0.0)
        for k, (n, frame) in enumerate(
            zip(order.tolist(), np.repeat(np.arange(len(numbers)), np.diff(ends)).tolist(), strict=True)
        )
    ]
    points = table.points[order].reshape(-1, 2)
    scores = np.nan_to_num(table.scores[order]).ravel().tolist()
    rows = [(x, y, bool(np.isfinite(x + y)), False, s) for (x, y), s in zip(points.tolist(), scores, strict=True)]
    nodes = [{"name": name, "weight": 1.0} for name in table.nodes]
    skeleton = {"directed": True, "graph": {"name": "animal", "num_edges_inserted": 0}, "links": [],
                "multigraph": True, "nodes": [{"id": k} for k in range(count)]}  # fmt: skip
    about = {"version": "2.0.0", "skeletons": [skeleton], "nodes": nodes, "videos": [], "tracks": [],
             "suggestions": [], "negative_anchors": {}, "provenance": {}}  # fmt: skip
    film = {"filename": video.name, "backend": {"type": "MediaVideo", "filename": video.name, "grayscale": False}}
    frames = [(k, 0, int(n), a, b) for k, (n, a, b) in enumerate(zip(numbers, ends[:-1], ends[1:], strict=True))]
    with _written(h5py, path) as file:
        group = file.create_group("metadata")
        group.attrs["format_id"], group.attrs["json"] = WRITTEN, np.bytes_(json.dumps(about))
        texts: dict[str, list[Any]] = {
            "videos_json": [film],
            "tracks_json": [[0, name] for name in names],
            "suggestions_json": [],
        }
        for name, lines in texts.items():
            file.create_dataset(name, data=np.array([json.dumps(line) for line in lines], dtype="S"))
        arrays: dict[str, tuple[list[Any], Any]] = {
            "frames": (frames, FRAME),
            "instances": (instances, INSTANCE),
            "points": ([], POINT),
            "pred_points": (rows, [*POINT, ("score", "f8")]),
        }
        for name, (values, kind) in arrays.items():
            file.create_dataset(name, data=np.array(values, dtype=kind))


def _project(path: Path, file: Any) -> PointTable:
    info = json_of(file["metadata"].attrs["json"], file.filename, "a project of SLEAP")
    frames, instances = file["frames"][()], file["instances"][()]
    if not len(frames) or not len(instances):
        raise RequestError(f"{path}: expected at least one animal that is labelled or predicted, got none")
    order = [node["id"] for node in info["skeletons"][0]["nodes"]]
    nodes = tuple(str(info["nodes"][number]["name"]) for number in order)
    lines = file["tracks_json"][()] if "tracks_json" in file else []
    tracks = [_text(json_of(line, file.filename, "a track of SLEAP")[1]) for line in lines]
    shift = 0.0 if float(file["metadata"].attrs.get("format_id", 1.0)) >= CENTRED else -0.5
    placed = {USER: _points(file["points"][()], shift), PREDICTED: _points(file["pred_points"][()], shift)}
    animals: list[tuple[int, str, FloatArray]] = []
    elsewhere = frames["video"] != frames["video"].min()
    if elsewhere.any():
        line = f"{elsewhere.sum()} of {len(frames)} frames are of further videos, and are left out"
        warnings.warn(f"{path}: {line}", InputWarning, stacklevel=3)
    for frame in frames[~elsewhere]:
        rows = instances[int(frame["instance_id_start"]) : int(frame["instance_id_end"])]
        corrected = {int(row["from_predicted"]) for row in rows if row["instance_type"] == USER}
        for row in rows:
            if row["instance_type"] == PREDICTED and int(row["instance_id"]) in corrected:
                continue
            kind, track = int(row["instance_type"]), int(row["track"])
            values = placed[kind][int(row["point_id_start"]) : int(row["point_id_end"])]
            animals.append((int(frame["frame_idx"]), tracks[track] if 0 <= track < len(tracks) else "", values))
    values = np.array([points for _, _, points in animals]).reshape(-1, len(nodes), 3)
    numbers = np.array([number for number, _, _ in animals], dtype=np.int64)
    return PointTable(nodes, numbers, tuple(name for _, name, _ in animals), values[:, :, :2], values[:, :, 2])


def _points(rows: Any, shift: float) -> FloatArray:
    """``(N, 3)`` x, y, score; NaN of what is not visible, and of scores that users' points have not."""
    values = np.full((len(rows), 3), np.nan)
    visible = rows["visible"].astype(bool)
    values[visible, 0], values[visible, 1] = rows["x"][visible] + shift, rows["y"][visible] + shift
    if "score" in rows.dtype.names:
        values[visible, 2] = rows["score"][visible]
    return values


def _analysis(file: Any) -> PointTable:
    nodes = tuple(_text(name) for name in file["node_names"][()])
    names = [_text(name) for name in file["track_names"][()]] if "track_names" in file else []
    sizes = {"xy": 2, "node": len(nodes), **({"track": len(names)} if names else {})}
    points = _by_axes(file["tracks"], ("frame", "node", "xy", "track"), sizes)
    scores = np.full(points[:, :, 0].shape, np.nan)
    if "point_scores" in file:
        scores = _by_axes(file["point_scores"], ("frame", "node", "track"), sizes)
    names = names if len(names) == points.shape[3] else [f"track_{number}" for number in range(points.shape[3])]
    frames, tracks = np.nonzero(np.isfinite(points).any(axis=(1, 2)))
    return PointTable(
        nodes, frames.astype(np.int64), tuple(names[track] for track in tracks), points[frames, :, :, tracks],
        scores[frames, :, tracks],
    )  # fmt: skip


def _by_axes(data: Any, names: tuple[str, ...], sizes: dict[str, int]) -> FloatArray:
    """The array of a file with the axes ``names``, in whose reverse SLEAP writes it, and sleap-io as it says.

    Raises:
        ValueError: its axes are others than it says, or have not the ``sizes`` that are known.
    """
    order = data.attrs.get("dims")
    axes = names[::-1] if order is None else tuple(json_of(order, data.file.filename, "names of axes"))
    if sorted(axes) != sorted(names) or any(sizes.get(a, n) != n for a, n in zip(axes, data.shape, strict=True)):
        raise ValueError(f"an array of shape {data.shape} with axes {', '.join(map(str, axes))}, expected {sizes}")
    return np.asarray(np.transpose(data[()], [axes.index(name) for name in names]), dtype=np.float64)


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
