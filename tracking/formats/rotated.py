"""Rotated boxes of people under overhead cameras: the label files of CEPDOF, MW-R and HABBOF, and detections like them.

CEPDOF and MW-R are one COCO-like JSON: ``annotations`` with ``image_id``, ``bbox`` = ``[cx, cy, w, h, degrees
clockwise]`` and maybe ``person_id``; detections are a JSON list of the same with ``score``. HABBOF is a text file an
image, ``person cx cy w h degrees``. Degrees lie in [-90, 90), so 90 becomes -90; pixels are 0-based. Here boxes are
``(N, 5)`` with the angle in radians.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import Sieve, UnusableError
from tsuiseki.tracking.formats.labelled_boxes import finite, id_of
from tsuiseki.tracking.formats.mot_sequence import name_parts
from tsuiseki.tracking.formats.rows import read_rows
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.types import Detections, FloatArray, IntArray

HABBOF_ROW = "person cx cy w h degrees"
# Between the rectangle (1) and the ellipse (2) in a rotated box: what fits the outline of the two-cylinder person best.
BODY = 1.5


@dataclass(frozen=True)
class RotatedBoxes:
    """The boxes of one image.

    Attributes:
        boxes: ``(N, 5)`` centre x, y, width, height, pixels, and the angle clockwise, radians in [-pi/2, pi/2).
        ids: ``(N,)`` of the people, -1 where there is none; no two of one image are alike.
        scores: ``(N,)`` of detections, 1 for labels.
    """

    boxes: FloatArray
    ids: IntArray
    scores: FloatArray


def is_rotated(path: Path) -> bool:
    """Whether ``path`` has labels of rotated boxes: JSON with annotations, or a folder of HABBOF's text files."""
    if path.is_dir():
        files = (read_rows(text, "labels").cells for text in sorted(path.glob("*.txt")))
        return next((cells for cells in files if cells), [[""]])[0][0] == "person"
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    try:
        content = read_json(path, "JSON")
    except RequestError:
        return False
    entries = content.get("annotations") if isinstance(content, dict) else None
    if not isinstance(entries, list):
        return False
    boxes = [(entry["bbox"], entry) for entry in entries if isinstance(entry, dict) and "bbox" in entry]
    # COCO's own annotations are of a track, or have four numbers.
    upright = sum(isinstance(box, list) and (len(box) == 4 or "track_id" in entry) for box, entry in boxes)
    turned = sum(isinstance(box, list) and len(box) == 5 and "track_id" not in entry for box, entry in boxes)
    return turned > upright or (turned == upright and not content.get("categories"))


def read_rotated_labels(path: Path) -> dict[str, RotatedBoxes]:
    """The labels at ``path`` by image, in the order of the images' names.

    Raises:
        RequestError: nothing to read, or a box is no five numbers with a positive size.
    """
    if path.is_dir():
        sieve, texts = Sieve(path), sorted(path.glob("*.txt"), key=lambda text: name_parts(text.stem))
        rows = [row for text in texts for row in _habbof_rows(sieve, text)]
        names = [text.stem for text in texts]
        sieve.tell()
    else:
        content = read_json(path, "JSON with labels of rotated boxes")
        entries = content.get("annotations") if isinstance(content, dict) else None
        if not isinstance(entries, list):
            raise RequestError(f"{path}: expected a list named annotations, found none")
        rows = _rows(Sieve(path, "annotations"), entries)
        images = content["images"] if isinstance(content.get("images"), list) else []
        names = [str(i.get("id")) for i in images if isinstance(i, dict) and "id" in i]
    if not rows:
        raise RequestError(f"{path}: expected labelled boxes, found none")
    return _grouped(rows, names)


def read_rotated_detections(path: Path) -> dict[str, RotatedBoxes]:
    """Detections by image: a JSON list of ``image_id``, ``bbox`` and ``score``.

    Raises:
        RequestError: the file is missing or something else.
    """
    content = read_json(path, "JSON with labels of rotated boxes")
    if not isinstance(content, list):
        raise RequestError(f"{path}: expected a JSON list of detections, got a {type(content).__name__}")
    return _grouped(_rows(Sieve(path, "detections"), content), [])


def write_rotated_detections(path: Path, detections: Mapping[str, RotatedBoxes]) -> None:
    """Write what `read_rotated_detections` reads."""
    rows = [
        {"image_id": name, "bbox": [*np.round(box[:4], 3).tolist(), round(float(np.degrees(box[4])), 4)],
         "score": round(float(score), 5)}
        for name, image in detections.items()
        for box, score in zip(image.boxes, image.scores, strict=True)
    ]  # fmt: skip
    path.write_text(json.dumps(rows) + "\n", encoding="utf-8")


def turned_detections(image: RotatedBoxes) -> Detections:
    """The boxes of an image as detections with angles."""
    half = image.boxes[:, 2:4] / 2
    corners = np.concatenate([image.boxes[:, :2] - half, image.boxes[:, :2] + half], axis=1)
    return Detections(corners, image.scores, angles=image.boxes[:, 4])


def half_turned(angles: FloatArray) -> FloatArray:
    """Angles in [-pi/2, pi/2) that give the same boxes, radians.

    >>> half_turned(np.array([np.pi / 2])).round(4).tolist()
    [-1.5708]
    """
    return np.asarray((np.asarray(angles) + np.pi / 2) % np.pi - np.pi / 2)


def about_bodies(boxes: FloatArray) -> FloatArray:
    """``(N, 4)`` upright boxes x1, y1, x2, y2 about the people in ``(N, 5)`` rotated ones.

    A person does not fill the corners of a rotated box, so this one is smaller than that about the corners.

    >>> about_bodies(np.array([[10.0, 10.0, 2.0, 6.0, np.pi / 2]])).round(6).tolist()
    [[7.0, 9.0, 13.0, 11.0]]
    """
    cos, sin = np.abs(np.cos(boxes[:, 4])), np.abs(np.sin(boxes[:, 4]))
    across = np.stack([boxes[:, 2] * cos, boxes[:, 2] * sin], axis=1)
    along = np.stack([boxes[:, 3] * sin, boxes[:, 3] * cos], axis=1)
    half = (across**BODY + along**BODY) ** (1 / BODY) / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1)


_Row = tuple[str, list[float], int, float]


def _rows(sieve: Sieve, entries: Sequence[Any]) -> list[_Row]:
    """The rows of annotations or detections, counted from 1; a sieve is told of others."""
    named = ((f"{sieve.what[:-1]} {number}", entry) for number, entry in enumerate(entries, start=1))
    rows = [*sieve.read(named, _row)]
    sieve.tell()
    return rows


def _row(_: str, entry: Any) -> _Row:
    """An annotation; raises UnusableError, see `Sieve`."""
    if not isinstance(entry, dict) or "image_id" not in entry:
        raise UnusableError("without an image_id")
    box, person = entry.get("bbox"), entry.get("person_id")
    if not isinstance(box, list):
        raise UnusableError(FIVE)
    number = id_of(person, "person_id")
    return (
        str(entry["image_id"]),
        _checked(box),
        -1 if number is None else number,
        finite(entry.get("score"), "score", 1.0),
    )


def _habbof_rows(sieve: Sieve, path: Path) -> list[_Row]:
    table = read_rows(path, "labels of HABBOF")
    table.refuse((np.array([len(cells) != 1 + 5 for cells in table.cells]), HABBOF_ROW))
    numbers = table.numbers(HABBOF_ROW, range(1, 6)).tolist()
    named = zip([f"{path.name}:{line}" for line in table.lines], numbers, strict=True)
    return [(path.stem, box, -1, 1.0) for box in sieve.read(named, lambda _, values: _checked(values))]


# Why a label cannot be used whose box is another one.
FIVE = "without cx, cy, w, h and degrees"


def _checked(values: Sequence[object]) -> list[float]:
    """A turned box, whose angle becomes radians; raises UnusableError, see `Sieve`."""
    if len(values) != 5:
        raise UnusableError(FIVE)
    box = [finite(value, "bbox") for value in values]
    if min(box[2:4]) <= 0:
        raise UnusableError("without a positive w and h")
    return [*box[:4], float(np.radians(box[4]))]


def _grouped(rows: Sequence[_Row], names: Sequence[str]) -> dict[str, RotatedBoxes]:
    grouped: dict[str, list[_Row]] = {name: [] for name in sorted({*names, *(row[0] for row in rows)}, key=name_parts)}
    for row in rows:
        grouped[row[0]].append(row)
    largest = max((row[2] for row in rows), default=0)
    result = {}
    for name, image_rows in grouped.items():
        boxes = np.array([row[1] for row in image_rows], dtype=np.float64).reshape(-1, 5)
        boxes[:, 4] = half_turned(boxes[:, 4])
        ids = np.array([row[2] for row in image_rows], dtype=np.int64)
        # The second box of a person in one image is somebody of its own.
        first = np.zeros(len(ids), dtype=np.bool_)
        first[np.unique(ids, return_index=True)[1]] = True
        for k in np.flatnonzero(~first & (ids >= 0)):
            largest += 1
            ids[k] = largest
        result[name] = RotatedBoxes(boxes, ids, np.array([row[3] for row in image_rows], dtype=np.float64))
    return result
