"""What one task has seen in a stretch of a video: detections and features a frame, and where the camera stood still.

A file of these holds numbers only and is read without unpickling. What comes out is what went in, bit for bit.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.types import BoolArray, Detections, IntArray

COLUMNS = ("boxes", "scores", "features", "angles", "classes", "sources")


@dataclass(frozen=True)
class Observations:
    """Of frames that follow each other.

    Attributes:
        found: detections of each frame, with features where they were described.
        same: ``(F,)`` whether each frame shows what the one it was compared with does; none where nobody looked.
        compared: ``(F,)`` number of that frame.
        about: height and width of the frames, seconds of each stage, and what else is to be kept.
    """

    found: Sequence[Detections]
    same: BoolArray
    compared: IntArray
    about: dict[str, Any]


def write_observations(path: Path, seen: Observations) -> None:
    """Write a file, whole or not at all.

    Raises:
        RequestError: the disk is full, or the folder cannot be written to.
    """
    arrays: dict[str, Any] = {"same": seen.same, "compared": seen.compared}
    arrays["counts"] = np.array([len(each) for each in seen.found], dtype=np.int64)
    for name in COLUMNS:
        parts = [getattr(each, name) for each in seen.found]
        told = np.array([part is not None for part in parts], dtype=np.bool_)
        arrays[f"told_{name}"] = told
        if told.any():
            arrays[name] = _packed(np.concatenate([part for part in parts if part is not None and len(part)] or [[]]))
            arrays[f"width_{name}"] = max((np.shape(part)[1:] for part in parts if part is not None), default=())
    names = {number: name for each in seen.found for number, name in each.names.items()}
    arrays["about"] = np.array(json.dumps({**seen.about, "names": names}))
    with whole_file(path) as file:
        np.savez(file, **arrays)


def _packed(values: Any) -> Any:
    """The same numbers in half the bytes, where that loses none."""
    values = np.asarray(values)
    if values.dtype != np.float64:
        return values
    short = values.astype(np.float32)
    return short if np.array_equal(short.astype(np.float64), values, equal_nan=True) else values


def read_observations(path: Path) -> Observations:
    """What `write_observations` wrote."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    about = json.loads(str(arrays["about"]))
    names = {int(number): name for number, name in about.pop("names").items()}
    counts, columns = arrays["counts"], {}
    for name in COLUMNS:
        told = arrays[f"told_{name}"]
        parts: list[Any] = [None] * len(counts)
        if told.any():
            width, values = tuple(arrays[f"width_{name}"]), arrays[name]
            values = values.astype(np.float64) if values.dtype == np.float32 else values
            cuts = np.cumsum(counts * told)
            pieces = np.split(values.reshape(-1, *width), cuts[:-1])
            parts = [piece if is_told else None for piece, is_told in zip(pieces, told.tolist(), strict=True)]
        columns[name] = parts
    found = [
        Detections(**dict(zip(COLUMNS, row, strict=True)), names=names) for row in zip(*columns.values(), strict=True)
    ]
    return Observations(found, arrays["same"], arrays["compared"], about)
