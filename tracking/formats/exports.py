"""The files of other programs that tracks go into, by name; those with ``read`` are read again, also as labels.

GEFF is the exchange format of graphs that motile, napari and others read: a folder of Zarr, written here without it. A
node is a box or a body in a frame, with ``t`` (the frame, from 0), ``y`` and ``x`` (the centre), what else is known
of it, and ``track_id``; an edge joins it to the next one of its track. Arrays are of Zarr format 2, one raw chunk each.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.body_points import write_deeplabcut
from tsuiseki.tracking.formats.box_labels import is_kitti_file, read_kitti_video, write_kitti
from tsuiseki.tracking.formats.coco import read_coco, write_coco
from tsuiseki.tracking.formats.cvat import read_cvat, write_cvat
from tsuiseki.tracking.formats.label_studio import read_label_studio, write_label_studio
from tsuiseki.tracking.formats.mot import read_tracks, write_tracks
from tsuiseki.tracking.formats.mot_sequence import write_sequence
from tsuiseki.tracking.formats.rows import column_names, write_csv
from tsuiseki.tracking.formats.sleap_hdf5 import write_sleap_analysis, write_sleap_project
from tsuiseki.tracking.formats.track_tables import CORNERS, KNOWN, read_table, tracks_of, write_table
from tsuiseki.tracking.formats.tracked_video import NONE, Size, TrackedVideo
from tsuiseki.tracking.formats.yolo import is_yolo, read_yolo, write_yolo
from tsuiseki.tracking.geometry import centres, xywh_from_corners
from tsuiseki.tracking.types import Track

GEFF_VERSION = "1.1"
AXES = (("t", "time", "frame"), ("y", "space", "pixel"), ("x", "space", "pixel"))


def write_geff(folder: Path, video: TrackedVideo) -> None:
    """Write the graph of the tracks; raises RequestError where they have no places in a plane."""
    nodes = _nodes(video)
    ids, frames = nodes["track_id"], nodes["t"]
    order = np.lexsort([frames, ids])
    joined = ids[order][1:] == ids[order][:-1]
    edges = np.column_stack([order[:-1][joined], order[1:][joined]])
    axes: list[dict[str, Any]] = [{"name": name, "type": kind, "unit": unit} for name, kind, unit in AXES]
    for axis in axes if len(ids) else ():
        axis |= {"min": float(nodes[axis["name"]].min()), "max": float(nodes[axis["name"]].max())}
    about = {
        "geff_version": GEFF_VERSION,
        "directed": True,
        "axes": axes,
        "node_props_metadata": {name: {"identifier": name, "dtype": str(v.dtype)} for name, v in nodes.items()},
        "edge_props_metadata": {},
        "track_node_props": {"tracklet": "track_id"},
        "extra": {"frame_rate": video.frame_rate, "source": video.name},
    }
    for group in ("", "nodes", "nodes/props", *(f"nodes/props/{name}" for name in nodes), "edges", "edges/props"):
        (folder / group).mkdir(parents=True, exist_ok=True)
        _write_json(folder / group / ".zgroup", {"zarr_format": 2})
    _write_json(folder / ".zattrs", {"geff": about})
    _write_array(folder / "nodes/ids", np.arange(len(order), dtype=np.uint64))
    _write_array(folder / "edges/ids", edges.astype(np.uint64))
    for name, values in nodes.items():
        _write_array(folder / "nodes/props" / name / "values", values)


def _nodes(video: TrackedVideo) -> dict[str, NDArray[Any]]:
    rows, table = video.boxes, video.table
    if not table or "x1" in table:
        x, y = centres(rows.boxes).T
        about = {"t": rows.frames, "y": y, "x": x, "score": rows.scores, "track_id": rows.ids}
        return about | dict(zip(CORNERS, rows.boxes.T, strict=True))
    places = next((names for names in (("a", "b"), ("x", "y")) if {*names, "frame", "id"} <= table.keys()), None)
    if places is None:
        raise RequestError(f"expected tracks with frame, id and a place, got {', '.join(list(table)[:8])}")
    columns = {"t": table["frame"], "y": table[places[1]], "x": table[places[0]], "track_id": table["id"]}
    return columns | {n: v for n, v in table.items() if v.dtype.kind in "fi" and n not in (*places, "frame", "id")}


def _write_array(folder: Path, values: NDArray[Any]) -> None:
    folder.mkdir()
    shape = list(values.shape)
    about = {"zarr_format": 2, "shape": shape, "chunks": [max(n, 1) for n in shape], "dtype": values.dtype.str,
             "compressor": None, "fill_value": 0, "order": "C", "filters": None}  # fmt: skip
    _write_json(folder / ".zarray", about)
    if values.size:
        (folder / ".".join("0" * values.ndim)).write_bytes(np.ascontiguousarray(values).tobytes())


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")


HEADING = ("filename", "file_size", "file_attributes", "region_count", "region_id", "region_shape_attributes",
           "region_attributes")  # fmt: skip


def write_via_tracks(path: Path, video: TrackedVideo) -> None:
    """Write the boxes, by frame, then by id."""
    rows = video.boxes
    columns = rows.listed(boxes=xywh_from_corners(rows.boxes).round(3), scores=rows.scores.round(4))
    lines = []
    for frame, number, box, score, *_ in columns:
        shape = {"name": "rect", **dict(zip(("x", "y", "width", "height"), box, strict=True))}
        about = {"track": str(number), "confidence": str(score), "class": video.kind[number]}
        image = f"{video.stem}_{frame:08d}.jpg"
        lines.append([image, 0, json.dumps({"frame": frame}), 1, 0, json.dumps(shape), json.dumps(about)])
    write_csv(path, HEADING, lines)


FOLDER = ""


@dataclass(frozen=True)
class ExportFormat:
    """A kind of file.

    Attributes:
        suffix: of its name; `FOLDER` for a folder.
        write: into a new file, or into an empty folder.
        read: what was written; None where nothing reads it, or `Result.load` does.
        holds: any tracks, boxes alone, or boxes and points of animals.
        sized: it needs the size of the frames.
    """

    suffix: str
    write: Callable[[Path, TrackedVideo], object]
    read: Callable[[Path], TrackedVideo] | None = None
    holds: Literal["all", "boxes", "points"] = "boxes"
    sized: bool = False

    def check(self, name: str, path: Path, video: TrackedVideo) -> None:
        """Refuse what does not fit into ``path``, which is a file of the format ``name``.

        Raises:
            RequestError: the path ends in something else, the tracks have no boxes, one is empty, or there are fewer
                pictures.
        """
        if path.suffix.lower() != self.suffix and (self.suffix or path.is_file()):
            raise RequestError(f"expected the name of a {self.suffix or 'folder'} for {name}, got {path}")
        if video.images and (last := int(video.boxes.frames.max(initial=-1))) >= len(video.images):
            raise RequestError(
                f"expected frames up to {len(video.images)}, one a picture of {video.name}, got a box in frame "
                f"{last + 1}; are these the pictures that were tracked?"
            )
        if empty := [track.id for track in video.tracks if not len(track)]:
            raise RequestError(f"expected a frame of each track, got none of id {empty[0]}; leave it out")
        if self.holds == "boxes" and not video.tracks and video.table.get("frame", NONE).size + ("time" in video.table):
            raise RequestError(f"{path}: {name} holds boxes, and these tracks have none; save as .csv")


def _write_table(path: Path, video: TrackedVideo) -> None:
    write_table(path, dict(video.table), video.about)


FORMATS = {
    "csv": ExportFormat(".csv", _write_table, holds="all"),
    "json": ExportFormat(".json", _write_table, holds="all"),
    "parquet": ExportFormat(".parquet", _write_table, holds="all"),
    "mot": ExportFormat(".txt", lambda path, video: write_tracks(path, video.tracks)),
    "dancetrack": ExportFormat(FOLDER, write_sequence, sized=True),
    "kitti": ExportFormat(".txt", write_kitti, read_kitti_video),
    "coco": ExportFormat(".json", write_coco, read_coco, sized=True),
    "cvat": ExportFormat(".xml", write_cvat, read_cvat, sized=True),
    "label-studio": ExportFormat(".json", write_label_studio, read_label_studio, sized=True),
    "yolo": ExportFormat(FOLDER, write_yolo, read_yolo, sized=True),
    "sleap": ExportFormat(".slp", write_sleap_project, holds="points"),
    "sleap-analysis": ExportFormat(
        ".h5", lambda path, video: write_sleap_analysis(path, video.nodes, video.frame_count), holds="points"
    ),
    "deeplabcut": ExportFormat(
        ".csv", lambda path, video: write_deeplabcut(path, video.nodes, video.frame_count), holds="points"
    ),
    "via": ExportFormat(".csv", write_via_tracks),
    "geff": ExportFormat(FOLDER, write_geff, holds="points"),
}
# Where labels lie in a folder of others.
LABEL_FILES = ("annotations.xml", "annotations.json", "_annotations.coco.json", "labels.json",
               *(f"annotations/{part}*.json" for part in ("instances_", "train", "val", "test")))  # fmt: skip
SUFFIXES: dict[str, str] = {}
"""By suffix the format that is meant where none is named: the first above."""
for _name, _format in FORMATS.items():
    if _format.suffix:
        SUFFIXES.setdefault(_format.suffix, _name)


def format_named(name: str) -> ExportFormat:
    """The format of a name; raises RequestError where there is none."""
    if name not in FORMATS:
        raise RequestError(f"`to`: expected one of {', '.join(FORMATS)}, got {name}")
    return FORMATS[name]


def format_at(path: Path) -> str | None:
    """The name of the format that can be read at a path, by its suffix and first letters; None where there is none."""
    if path.is_dir():
        return "yolo" if is_yolo(path) else None
    suffix = path.suffix.lower()
    if suffix == ".txt" and path.is_file():
        return "kitti" if is_kitti_file(path) else None
    if suffix != ".json" or not path.is_file():
        return "cvat" if suffix == ".xml" else None
    with path.open("rb") as file:
        start = file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n")
    if start.startswith(f'{{"{KNOWN}"'.encode()):
        return None
    return "label-studio" if start.startswith(b"[") else "coco"


def exported_in(folder: Path) -> list[Path]:
    """What can be read in a folder, or else in those in it: a file of `LABEL_FILES`, or the folder itself.

    Folders in ``labels`` come last.
    """
    inner = sorted(path for path in folder.iterdir() if path.is_dir())
    for places in ([folder], inner, sorted((folder / "labels").glob("*/"))):
        files = [[file for pattern in LABEL_FILES for file in sorted(place.glob(pattern))] for place in places]
        candidates = [at for place, label_files in zip(places, files, strict=True) for at in (place, *label_files)]
        if readable := [at for at in candidates if format_at(at)]:
            return readable
    return []


def read_exported(path: Path, single: bool = False) -> TrackedVideo:
    """What is at a path of `format_at`; where ``single``, boxes of pictures without ids will do.

    Raises:
        RequestError: it is broken, or of another kind, or has no ids.
    """
    name = format_at(path)
    read = FORMATS[name].read if name else None
    if read is None:
        readable = ", ".join(n for n, export in FORMATS.items() if export.read)
        raise RequestError(f"expected a file of {readable}, got {path}")
    video = read(path)
    if not (video.identified or single):
        raise RequestError(f"{path}: expected an id of each box, found none: labels of single pictures")
    return video if single else video.tracked(path)


def read_boxes(path: Path, size: Size = None) -> list[Track]:
    """The tracks of boxes in a file of any format that is read, or of MOTChallenge's text.

    Boxes that are shares of a picture are of one of this ``size``.

    Raises:
        RequestError: it is broken, or its tracks are no boxes.
    """
    if format_at(path):
        return [*read_exported(path).in_pixels(path, size).tracks]
    if not _is_table(path):
        return read_tracks(path)
    tracks = [getattr(track, "track", track) for track in tracks_of(read_table(path)[0])]
    if not all(isinstance(track, Track) for track in tracks):
        raise RequestError(f"{path}: expected tracks of boxes, got others")
    return tracks


def _is_table(path: Path) -> bool:
    """Whether a file is a table as `Result.save` writes it."""
    if path.suffix.lower() == ".csv" and path.is_file():
        return {"frame", "id", *CORNERS} <= {*column_names(path, "tracks")}
    return path.suffix.lower() in (".json", ".parquet")
