"""YOLO's rows: ``labels/NAME_1.txt …``, one file a frame that has boxes, and ``data.yaml``.

A row is ``class x y width height score id``: the centre and the size as shares of the picture, as ultralytics writes
them with ``save_txt`` and ``save_conf``. Score or id may be left out. Where no row of a folder has both, a sixth number
is the id if all of them are whole, or else the score; where one has both, it is the score of a box without an id.
Five numbers a row are labels of single pictures, which may lie in ``labels/train`` and ``images/train``. A frame is the
number at the end of a file's name, from 1, or the place of the image of that name in ``images/``. ``data.yaml``, here
or beside the folder, names the classes, or else ``classes.txt``; width, height, frames, frame_rate, and first_frame,
the number of the first frame where it is not 1, are ours.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import yaml

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.label_checks import Sieve
from tsuiseki.tracking.formats.labelled_boxes import LabelledBox, finite, labelled_video, with_area
from tsuiseki.tracking.formats.mot_sequence import image_size, list_images
from tsuiseki.tracking.formats.rows import Rows, read_rows, whole
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.openers.text import read_text
from tsuiseki.tracking.openers.yaml_files import read_yaml
from tsuiseki.tracking.types.frame_range import LAST_FRAME

LABELS = "labels"
ABOUT = "data.yaml"
IMAGES = "images"
# Name the classes, one a line, where there is no data.yaml: of Label Studio, labelImg and darknet.
NAME_FILES = ("classes.txt", "obj.names")
EXPECTED = "class x y width height [score] [id]"
# Cells of a row with a score or an id.
WITH_ONE = 6
# What stands in `ABOUT` beside the names of the classes.
NUMBERS = ("width", "height", "frames", "frame_rate", "first_frame")


def is_yolo(folder: Path) -> bool:
    """Whether a folder has ``labels`` of this kind, or is a part of them, such as ``labels/train``."""
    labels, _ = picture_places(folder)
    empty = (folder / ABOUT).is_file() and labels.is_dir() and not any(labels.iterdir())
    return any(labels.glob("*.txt")) or empty


def picture_places(folder: Path) -> tuple[Path, Path]:
    """The folders of label files and of images."""
    if folder.parent.name == LABELS:
        return folder, folder.parent.parent / IMAGES / folder.name
    return folder / LABELS, folder / IMAGES


def write_yolo(folder: Path, video: TrackedVideo) -> None:
    """Write the boxes; classes keep their numbers, where these are known."""
    size = np.tile(video.pixels, 2)
    (folder / LABELS).mkdir(parents=True)
    about: dict[str, Any] = {"train": IMAGES, "val": IMAGES, "names": {k: kind for kind, k in video.kinds.items()}}
    about |= {"width": int(size[0]), "height": int(size[1]), "frames": video.frame_count}
    about |= {"frame_rate": video.frame_rate}
    (folder / ABOUT).write_text(yaml.safe_dump(about, sort_keys=False, allow_unicode=True), encoding="utf-8")
    rows = video.boxes
    middle = centres(rows.boxes)
    shares = np.concatenate([middle, rows.boxes[:, 2:] - rows.boxes[:, :2]], axis=1) / size
    texts: dict[int, list[str]] = {}
    for frame, number, box, score, *_ in rows.listed(boxes=shares):
        place = " ".join(f"{value:.6f}" for value in box)
        texts.setdefault(frame, []).append(f"{video.kinds[video.kind[number]]} {place} {score:.4f} {number}\n")
    for frame, lines in texts.items():
        stem = PurePosixPath(video.image(frame)).stem if video.images else f"{video.stem}_{frame + 1}"
        (folder / LABELS / f"{stem}.txt").write_text("".join(lines), encoding="utf-8")


def read_yolo(folder: Path) -> TrackedVideo:
    """The tracks in a folder, or the boxes of its pictures where a row has no id.

    Raises:
        RequestError: a row is broken.
    """
    labels, pictures = picture_places(folder)
    files = sorted(path for path in labels.glob("*.txt") if path.name not in NAME_FILES)
    about = next((text for place in (folder, folder.parent, folder.parent.parent) if (text := _about(place))), {})
    images = list_images(pictures)
    width, height = int(about.get("width") or 0), int(about.get("height") or 0)
    size = (width, height) if min(width, height) > 0 else image_size(images[0]) if images else None
    named = _class_names(about, (folder, labels, folder.parent, folder.parent.parent))
    places = {image.stem: frame for frame, image in enumerate(images)}
    sieve, boxes = Sieve(folder), list[LabelledBox]()
    tables = _by_frame(files, places, int(about.get("first_frame", 1)))
    sixth_is_id = _sixth_is_id(tables.values())
    for frame, table in tables.items():
        picture = size if about.get("width") or not places else image_size(images[frame])
        boxes += sieve.read(_rows(table, frame, named, sixth_is_id), partial(_in_pixels, picture or (1, 1)))
    video = labelled_video(folder, boxes, sieve)
    unnamed = {box.kind[0] for box in boxes} - named.keys()
    if unnamed and (named or len(unnamed) > 1):
        line = f"no {ABOUT} or {NAME_FILES[0]} names the classes {', '.join(map(str, sorted(unnamed)[:8]))}"
        warnings.warn(f"{folder}: {line}; they are called by their numbers", InputWarning, stacklevel=3)
    stem = re.sub(r"_?\d+$", "", files[0].stem) if files and video.identified else ""
    return replace(
        video,
        name=stem or folder.resolve().name,
        frame_rate=float(about.get("frame_rate") or 0),
        size=size,
        length=int(about.get("frames") or len(images)),
        images=tuple(image.name for image in images),
        image_sizes={image.name: size for image in images} if size and about.get("width") else {},
        shares=size is None,
    )


def _class_names(about: Mapping[str, Any], folders: Sequence[Path]) -> dict[int, str]:
    """Names of the classes by number: those of ``data.yaml``, or the lines of a file of `NAME_FILES` in a folder."""
    names = about.get("names") or {}
    if isinstance(names, dict):
        named = {whole(str(number)): str(name) for number, name in names.items()}
    else:
        named = dict(enumerate(map(str, names))) if isinstance(names, list) else {}
    path = next((place / name for place in folders for name in NAME_FILES if (place / name).is_file()), None)
    if not named and path is not None:
        named = dict(enumerate(read_text(path, "names of classes, one a line").rstrip().splitlines()))
    return {number: name.strip() for number, name in named.items() if number is not None}


def _about(folder: Path) -> dict[str, Any]:
    path = folder / ABOUT
    if not path.exists():
        return {}
    content: dict[str, Any] = read_yaml(path, "YOLO's settings")
    numbers = [content.get(name) or 0 for name in NUMBERS] if isinstance(content, dict) else [None]
    if not all(isinstance(number, int | float) and 0 <= number <= LAST_FRAME for number in numbers):
        raise RequestError(f"{path}: expected names of classes, and {', '.join(NUMBERS)} as numbers up to {LAST_FRAME}")
    return content


def _by_frame(files: Sequence[Path], places: Mapping[str, int], first: int) -> dict[int, Rows]:
    """By frame the rows of its file; raises RequestError where two files are of one frame, or a name has no number."""
    tables = dict[int, Rows]()
    for path in files:
        frame = _frame(path, places, first)
        if frame in tables:
            raise RequestError(f"{path}: expected one file a frame, got {tables[frame].path.name}, too")
        tables[frame] = read_rows(path, "YOLO's rows")
    return tables


def _frame(path: Path, places: Mapping[str, int], first: int) -> int:
    if places:
        if path.stem not in places:
            raise RequestError(f"{path}: expected an image {path.stem} in {IMAGES}, found none")
        return places[path.stem]
    number = re.search(r"\d{1,9}$", path.stem)
    if number is None:
        raise RequestError(f"{path}: expected the number of a frame at the end of its name, such as {path.stem}_1.txt")
    if int(number[0]) < first:
        raise RequestError(
            f"{path}: expected frames counted from {first} in the names, got {number[0]}; where they count from "
            f"another number, say it in {ABOUT}, such as first_frame: 0"
        )
    return int(number[0]) - first


def _sixth_is_id(tables: Iterable[Rows]) -> bool:
    """Whether the last of six cells of a row is an id, and no score."""
    listed = [cells for table in tables for cells in table.cells]
    return all(len(cells) <= WITH_ONE for cells in listed) and all(
        whole(cells[-1]) is not None for cells in listed if len(cells) == WITH_ONE
    )


def _rows(
    table: Rows, frame: int, names: Mapping[Any, Any], sixth_is_id: bool
) -> Iterator[tuple[str, LabelledBox]]:  # fmt: skip
    """The rows of a file, by its name and their lines, with centre, width and height as corners."""
    for k, cells in enumerate(table.cells):
        identified = len(cells) > WITH_ONE or (len(cells) == WITH_ONE and sixth_is_id)
        number, kind = whole(cells[-1]) if identified else None, whole(cells[0])
        try:
            x, y, width, height, *score = [float(cell) for cell in (cells[1:-1] if identified else cells[1:])]
        except ValueError:
            raise table.error(k, EXPECTED) from None
        if kind is None or len(score) > 1 or (number is None and identified):
            raise table.error(k, f"{EXPECTED}, with a whole number as id")
        if not identified and score and not 0 <= score[0] <= 1:
            raise table.error(k, f"{EXPECTED}, with a score from 0 to 1 where others have score and id")
        number = None if number is not None and number < 0 else number
        corners = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        named = kind, str(names.get(kind, kind))
        yield (
            f"{table.path.name}:{table.lines[k]}",
            LabelledBox(frame, number, named, corners, score=score[0] if score else 1.0),
        )


def _in_pixels(size: tuple[int, int], _: str, row: LabelledBox) -> LabelledBox:
    """A row whose corners are shares, in pixels; raises UnusableError where they span nothing."""
    shares = with_area([finite(share, "place or size") for share in row.corners])
    return row._replace(corners=tuple(share * side for share, side in zip(shares, (*size, *size), strict=True)))
