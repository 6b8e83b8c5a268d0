"""GEFF, the exchange format of graphs that motile, napari and others read: a folder of Zarr, written without it.

A node is a box or a body in a frame, with ``t`` (the frame, from 0), ``y`` and ``x`` (the centre), what else is known
of it, and ``track_id``; an edge joins it to the next one of its track. Arrays are of Zarr format 2, one raw chunk each.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.geometry import centres

VERSION = "1.1"
AXES = (("t", "time", "frame"), ("y", "space", "pixel"), ("x", "space", "pixel"))
CORNERS = ("x1", "y1", "x2", "y2")


def write_geff(folder: Path, video: TrackedVideo) -> None:
    """Write the graph of the tracks.

    Raises:
        RequestError: they have no places in a plane.
    """
    nodes = _nodes(video)
    ids, frames = nodes["track_id"], nodes["t"]
    order = np.lexsort([frames, ids])
    joined = ids[order][1:] == ids[order][:-1]
    edges = np.column_stack([order[:-1][joined], order[1:][joined]])
    axes = [{"name": name, "type": kind, "unit": unit, **_reach(nodes[name])} for name, kind, unit in AXES]
    about = {
        "geff_version": VERSION,
        "directed": True,
        "axes": axes,
        "node_props_metadata": {name: {"identifier": name, "dtype": str(v.dtype)} for name, v in nodes.items()},
        "edge_props_metadata": {},
        "track_node_props": {"tracklet": "track_id"},
        "extra": {"frame_rate": video.frame_rate, "source": video.name},
    }
    for group in ("", "nodes", "nodes/props", *(f"nodes/props/{name}" for name in nodes), "edges", "edges/props"):
        (folder / group).mkdir(parents=True, exist_ok=True)
        _json(folder / group / ".zgroup", {"zarr_format": 2})
    _json(folder / ".zattrs", {"geff": about})
    _array(folder / "nodes/ids", np.arange(len(order), dtype=np.uint64))
    _array(folder / "edges/ids", edges.astype(np.uint64))
    for name, values in nodes.items():
        _array(folder / "nodes/props" / name / "values", values)


def _nodes(video: TrackedVideo) -> dict[str, NDArray[Any]]:
    rows, table = video.boxes, video.table
    if not table or "x1" in table:
        x, y = centres(rows.boxes).T
        about = {"t": rows.frames, "y": y, "x": x, "score": rows.scores, "track_id": rows.ids}
        return about | dict(zip(CORNERS, rows.boxes.T, strict=True))
    places = next((names for names in (("a", "b"), ("x", "y")) if {*names, "frame", "id"} <= table.keys()), None)
    if places is None:
        raise RequestError(f"expected tracks with frame, id and a place, got {', '.join(list(table)[:8])}")
    known = {"t": table["frame"], "y": table[places[1]], "x": table[places[0]], "track_id": table["id"]}
    return known | {n: v for n, v in table.items() if v.dtype.kind in "fi" and n not in (*places, "frame", "id")}


def _reach(values: NDArray[Any]) -> dict[str, float]:
    return {"min": float(values.min()), "max": float(values.max())} if len(values) else {}


def _array(folder: Path, values: NDArray[Any]) -> None:
    folder.mkdir()
    shape = list(values.shape)
    about = {"zarr_format": 2, "shape": shape, "chunks": [max(n, 1) for n in shape], "dtype": values.dtype.str,
             "compressor": None, "fill_value": 0, "order": "C", "filters": None}  # fmt: skip
    _json(folder / ".zarray", about)
    if values.size:
        (folder / ".".join("0" * values.ndim)).write_bytes(np.ascontiguousarray(values).tobytes())


def _json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")
