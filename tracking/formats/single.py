"""Sequences with one labelled target: folders of OTB, VOT and UAV123, and folders of label files alone.

Quirks of the data sets that are met here:

* OTB: ``img/`` beside ``groundtruth_rect.txt``; two targets of one video have ``groundtruth_rect.1.txt`` and ``.2.txt``
  and count as two sequences; David, BlurCar1, BlurCar3 and BlurCar4 have labels from a later frame on; several have
  more images than boxes: the images without a box at the end are not used;
* VOT: images in ``color/``, ``imgs/`` or the folder itself, polygons in ``groundtruth.txt``;
* UAV123: images in ``data_seq/UAV123/NAME/``, labels in ``anno/UAV123/NAME.txt``, or both in one folder laid out like
  OTB; a video cut into several sequences has ``NAME_1.txt``, ``NAME_2.txt``, …, which begin at images known by number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import compare_with_picture
from tsuiseki.tracking.formats.mot_sequence import image_size, list_images
from tsuiseki.tracking.formats.rows import Rows, read_rows
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import read_text, refusing
from tsuiseki.tracking.types import FloatArray

ATTRIBUTES = {
    "IV": "illumination variation",
    "SV": "scale variation",
    "OCC": "occlusion",
    "DEF": "deformation",
    "MB": "motion blur",
    "FM": "fast motion",
    "IPR": "in-plane rotation",
    "OPR": "out-of-plane rotation",
    "OV": "out of view",
    "BC": "background clutter",
    "LR": "low resolution",
}
# Number of the first labelled image of OTB's sequences that begin later, by `same_name`.
FIRST_NUMBERS = {"david": 300, "blurcar1": 247, "blurcar3": 3, "blurcar4": 18}
# First image of each further part of UAV123's videos, at 30 frames/s; UAV123@10fps keeps every third.
LATER_PARTS = {
    "bird1": (775, 1573), "car1": (751, 1627), "car6": (487, 1807, 2953, 3925), "car8": (1357,), "car16": (415,),
    "group1": (1333, 2515, 3925), "group2": (907, 1771), "group3": (1567, 2827, 4369), "person2": (1189,),
    "person4": (1501,), "person5": (877,), "person7": (1249,), "person8": (1075,), "person12": (601,),
    "person14": (847, 1813), "person17": (1501,), "person19": (1243, 2791), "truck4": (577,), "uav1": (1555, 2473),
}  # fmt: skip
IMAGE_FOLDERS = ("img", "imgs", "color", "images")
LABEL_NAMES = re.compile(r"groundtruth(_rect)?(\.\d+)?\.txt")


@dataclass(frozen=True)
class SingleSequence:
    """A video with one labelled target.

    Attributes:
        name: of the sequence.
        images: ``T`` paths, one a box; empty where only labels are there.
        boxes: ``(T, 4)`` pixels, NaN where the target is out of view.
        attributes: short names of `ATTRIBUTES`.
    """

    name: str
    images: tuple[Path, ...]
    boxes: FloatArray
    attributes: frozenset[str] = frozenset()


def same_name(name: str) -> str:
    """What the spellings of one sequence's name have in common: BasketBall, Basketball; Human4.2, Human4-2."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def find_single_sequences(folder: str | Path, attributes: Path | None = None) -> list[SingleSequence]:
    """The sequence that ``folder`` is, or those in it, by name.

    Args:
        folder: a sequence; a folder with sequences; a folder with label files ``NAME.txt``; or one label file.
        attributes: a list like OTB's ``tb_50.txt``, ``NAME<tab>IV, OCC`` a line; only sequences in it are taken.

    Raises:
        RequestError: nothing there, or a file is broken.
    """
    folder = Path(folder)
    listed = read_attributes(attributes) if attributes is not None else None
    if folder.is_file():
        name = folder.parent.name if LABEL_NAMES.fullmatch(folder.name) else folder.stem
        sequences = [SingleSequence(name, (), read_boxes(folder))]
    elif not folder.is_dir():
        raise RequestError(f"expected a folder of sequences or a label file at {folder}, found none")
    else:
        sequences = _in_folder(folder) or [
            s for child in sorted(folder.iterdir()) if child.is_dir() for s in _in_folder(child)
        ]
        sequences = sequences or _label_files(folder, listed)
    if listed is not None:
        sequences = [replace(s, attributes=listed[same_name(s.name)]) for s in sequences if same_name(s.name) in listed]
    if not sequences:
        raise RequestError(f"{folder}: expected groundtruth_rect.txt, groundtruth.txt or NAME.txt files, found none")
    return sorted(sequences, key=lambda sequence: sequence.name.lower())


def read_attributes(path: Path) -> dict[str, frozenset[str]]:
    """Attributes by `same_name`.

    Args:
        path: a list like OTB's ``tb_50.txt``, or a folder of tracker_benchmark's score files ``IV.json`` and so on,
            whose lists of sequences differ from it in some names.

    Raises:
        RequestError: the list is missing, or names an unknown attribute.
    """
    if path.is_dir():
        published = read_published(path)
        listed = {a: {same_name(name) for name in scores.sequences} for a, scores in published.items()}
        return {name: frozenset(a for a in ATTRIBUTES if name in listed.get(a, ())) for name in listed["ALL"]}
    result = {}
    for number, line in enumerate(read_text(path, "a list of sequences and attributes").splitlines(), 1):
        if line.strip():
            name, _, attributes = line.strip().replace("\t", " ").partition(" ")
            result[same_name(name)] = _attribute_set(attributes, f"{path}, line {number}")
    return result


@dataclass(frozen=True)
class PublishedScores:
    """What tracker_benchmark published of a tracker: curves alone, no boxes.

    Attributes:
        success: 21 shares.
        precision: 51 shares.
        sequences: names of the sequences behind them.
    """

    success: tuple[float, ...]
    precision: tuple[float, ...]
    sequences: tuple[str, ...]


def read_published(folder: Path) -> dict[str, PublishedScores]:
    """Scores by ``ALL`` and the short names of `ATTRIBUTES`, from a folder of tracker_benchmark's score files.

    Raises:
        RequestError: a file is broken, or there is no ``ALL.json``.
    """
    result = {}
    for name in ("ALL", *ATTRIBUTES):
        path = folder / f"{name}.json"
        if path.is_file():
            with refusing(f"{path}: expected scores of tracker_benchmark, cannot read them"):
                content = read_json(path, "a result or scores of tracker_benchmark in JSON")
                success, precision = (tuple(map(float, content[k])) for k in ("successRateList", "precisionList"))
                result[name] = PublishedScores(success, precision, tuple(map(str, content["seqs"])))
    if "ALL" not in result:
        raise RequestError(f"expected score files of tracker_benchmark, ALL.json and others, in {folder}")
    return result


def _attribute_set(text: str, where: str) -> frozenset[str]:
    names = frozenset(word for word in re.split(r"[\s,]+", text.strip()) if word)
    if unknown := sorted(names - ATTRIBUTES.keys()):
        raise RequestError(f"{where}: expected attributes of {', '.join(ATTRIBUTES)}, got {unknown[0]!r}")
    return names


def _in_folder(folder: Path) -> list[SingleSequence]:
    """The sequences of one folder: none, one, or one a target."""
    labels = sorted(p for p in folder.iterdir() if LABEL_NAMES.fullmatch(p.name))
    if not labels:
        images = list_images(folder)
        parts = _labels_apart(folder) if images else []
        return [_paired(p.stem, images, read_boxes(p), frozenset(), _first_of_part(p)) for p in parts]
    images = next((listing for name in IMAGE_FOLDERS if (listing := list_images(folder / name))), list_images(folder))
    listed = folder / "attrs.txt"
    attributes = _attribute_set(read_text(listed, "attributes"), str(listed)) if listed.is_file() else frozenset[str]()
    result = []
    for path in labels:
        number = path.name.split(".")[1]
        name = folder.name + (f"-{number}" if number.isdigit() else "")
        result.append(_paired(name, images, read_boxes(path), attributes, _first_number(folder)))
    return result


def has_labels(folder: Path) -> bool:
    """Whether ``folder`` is a sequence whose labels lie in it or, as in UAV123, apart."""
    return any(LABEL_NAMES.fullmatch(path.name) for path in folder.iterdir()) or bool(_labels_apart(folder))


def _labels_apart(folder: Path) -> list[Path]:
    """UAV123's label files of the images in ``folder``, in order."""
    folder = folder.resolve()
    for root in list(folder.parents)[:3]:
        for place in (root / "anno" / folder.parent.name, root / "anno"):
            label_file = place / f"{folder.name}.txt"
            if label_file.is_file():
                return [label_file]
            if parts := sorted(place.glob(f"{folder.name}_[1-9].txt")):
                return parts
    return []


def _first_of_part(labels: Path) -> int:
    """Number of the image with which a part of a video of UAV123 begins."""
    video, _, part = labels.stem.rpartition("_")
    starts = LATER_PARTS.get(video, ())
    if not part.isdigit() or not 2 <= int(part) <= len(starts) + 1:
        return 1
    first = starts[int(part) - 2]
    return (first - 1) // 3 + 1 if "10fps" in labels.parent.name else first


def _first_number(folder: Path) -> int | None:
    """Number of the first labelled image, where the sequence says or is known for it."""
    try:
        start = read_json(folder / "cfg.json", "JSON").get("startFrame")
    except (RequestError, AttributeError):
        start = None
    return start if isinstance(start, int) else FIRST_NUMBERS.get(folder.name.lower())


def _paired(
    name: str, images: tuple[Path, ...], boxes: FloatArray, attributes: frozenset[str], first: int | None
) -> SingleSequence:
    if not images:
        return SingleSequence(name, (), boxes, attributes)
    used = images
    if first is not None and len(images) > len(boxes):
        used = tuple(path for path in images if (number := _number(path)) is None or number >= first)
    if len(used) < len(boxes):
        raise RequestError(f"{name}: expected an image for each of its {len(boxes)} boxes, found {len(used)}")
    used = used[: len(boxes)]
    try:
        size = image_size(used[0])
    except RequestError:
        size = None  # reading the picture says so
    compare_with_picture(name, boxes, size)
    return SingleSequence(name, used, boxes, attributes)


def _number(path: Path) -> int | None:
    digits = re.search(r"(\d+)$", path.stem)
    return int(digits[1]) if digits else None


def _label_files(folder: Path, listed: Iterable[str] | None) -> list[SingleSequence]:
    """``NAME.txt`` files of labels alone; with a list, other text files beside them are passed over."""
    paths = sorted(folder.glob("*.txt"))
    if listed is not None:
        names = set(listed)
        paths = [path for path in paths if same_name(path.stem) in names]
    return [SingleSequence(path.stem, (), read_boxes(path)) for path in paths]


# Numbers of a row that is x, y, width, height.
RECTANGLE = 4
# Numbers of a row that is four corners x, y.
POLYGON = 8


def read_boxes(path: str | Path) -> FloatArray:
    """``(T, 4)`` corners, 0-based; a frame in which the target is out of view is a row of NaN.

    Raises:
        RequestError: the file is missing or empty, a row is not four or eight numbers, a number is infinite or only
            some of a row are NaN, or the first frame has no box with an area.
    """
    path = Path(path)
    table = read_rows(path, "a text file with one box a line").without_heading(RECTANGLE)
    rows = [_numbers(table, k) for k in range(len(table.cells))]
    if not rows:
        raise RequestError(f"{path}: expected one box a line, found an empty file")
    odd = next((k for k, row in enumerate(rows) if len(row) != len(rows[0])), None)
    if odd is not None:
        raise table.error(odd, f"{len(rows[0])} numbers as in every line")
    values = np.array(rows)
    boxes = corners_from_xywh(values - [1, 1, 0, 0]) if values.shape[1] == RECTANGLE else polygon_hulls(values)
    if not (np.isfinite(boxes[0]).all() and (boxes[0, 2:] > boxes[0, :2]).all()):
        raise RequestError(
            f"{path}: expected a box with an area in the first frame, where tracking starts, "
            f"got {xywh_from_corners(boxes[0]).tolist()}"
        )
    compare_with_picture(path, boxes)
    return boxes


def _numbers(table: Rows, row: int) -> list[float]:
    try:
        values = [float(cell) for cell in table.cells[row]]
    except ValueError:
        values = []
    if len(values) not in (RECTANGLE, POLYGON):
        raise table.error(row, "x,y,width,height or four corners")
    missing = sum(map(math.isnan, values))
    if any(map(math.isinf, values)) or 0 < missing < len(values):
        raise table.error(row, "finite numbers, or NaN in all of them for a hidden target")
    return values


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
    with refusing(f"{path}: expected a result of tracker_benchmark in JSON, cannot read it"):
        content = read_json(path, "a result or scores of tracker_benchmark in JSON")
    return _json_boxes(content, path)


def _json_boxes(content: Any, path: Path) -> FloatArray:
    run = content[0] if isinstance(content, list) and content else content
    kind = run.get("resType", "rect") if isinstance(run, dict) else None
    if kind not in ("rect", "4corner") or not run.get("res"):
        raise RequestError(f"{path}: expected boxes under 'res' with 'resType' rect or 4corner, got {kind!r}")
    with refusing(f"{path}: expected a list of boxes under 'res', got something else"):
        values = np.array(run["res"], dtype=np.float64).reshape(len(run["res"]), -1)
    if values.shape[1] == POLYGON:
        return polygon_hulls(values - 1)
    if values.shape[1] != RECTANGLE:
        raise RequestError(f"{path}: expected four numbers a box, got {values.shape[1]}")
    return corners_from_xywh(values - [1, 1, 0, 0])
