"""YOLO's rows: ``labels/NAME_1.txt …``, one file a frame that has boxes, and ``data.yaml``.

A row is ``class x y width height score id``: the centre and the size as shares of the picture, as ultralytics writes
them with ``save_txt`` and ``save_conf``. Without a score the id stands last, too. Five numbers a row are labels of
single pictures, which may lie in ``labels/train`` and ``images/train``. A frame is the number at the end of a file's
name, from 1, or the place of the image of that name in ``images/``. ``data.yaml``, here or beside the folder, names
the classes; width, height, frames and frame_rate in it are ours.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import yaml

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import Sieve
from tsuiseki.tracking.formats.labelled_boxes import LabelledBox, finite, labelled_video, with_area
from tsuiseki.tracking.formats.mot_sequence import image_size, list_images
from tsuiseki.tracking.formats.rows import read_rows, whole
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.openers.yaml_files import read_yaml

LABELS = "labels"
ABOUT = "data.yaml"
IMAGES = "images"
EXPECTED = "class x y width height [score] [id]"


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
    files = sorted(labels.glob("*.txt"))
    about = next((text for place in (folder, folder.parent, folder.parent.parent) if (text := _about(place))), {})
    images = list_images(pictures)
    width, height = int(about.get("width") or 0), int(about.get("height") or 0)
    size = (width, height) if min(width, height) > 0 else image_size(images[0]) if images else None
    names = about.get("names") or {}
    named = dict(enumerate(names)) if isinstance(names, list) else names if isinstance(names, dict) else {}
    places = {image.stem: frame for frame, image in enumerate(images)}
    sieve, boxes = Sieve(folder), list[LabelledBox]()
    for path in files:
        frame = _frame(path, places)
        picture = size if about.get("width") or not places else image_size(images[frame])
        boxes += sieve.read(_rows(path, frame, named), partial(_in_pixels, picture or (1, 1)))
    video = labelled_video(folder, boxes, sieve)
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


def _about(folder: Path) -> dict[str, Any]:
    path = folder / ABOUT
    if not path.exists():
        return {}
    content = read_yaml(path, "YOLO's settings")
    if not isinstance(content, dict) or not all(
        isinstance(content.get(name, 0), int | float) for name in ("width", "height", "frames", "frame_rate")
    ):
        raise RequestError(f"{path}: expected names of classes, and numbers of width, height, frames and frame_rate")
    return content


def _frame(path: Path, places: Mapping[str, int]) -> int:
    if places:
        if path.stem not in places:
            raise RequestError(f"{path}: expected an image {path.stem} in {IMAGES}, found none")
        return places[path.stem]
    number = re.search(r"\d{1,9}$", path.stem)
    if number is None:
        raise RequestError(f"{path}: expected the number of a frame at the end of its name, such as {path.stem}_1.txt")
    return int(number[0]) - 1


def _rows(path: Path, frame: int, names: Mapping[Any, Any]) -> Iterator[tuple[str, LabelledBox]]:
    """The rows of a file, by its name and their lines, with centre, width and height as corners."""
    table = read_rows(path, "YOLO's rows")
    for k, cells in enumerate(table.cells):
        single = len(cells) == EXPECTED.split().index("height") + 1
        number, kind = None if single else whole(cells[-1]), whole(cells[0])
        try:
            x, y, width, height, *score = [float(cell) for cell in (cells[1:] if single else cells[1:-1])]
        except ValueError:
            raise table.error(k, EXPECTED) from None
        if kind is None or len(score) > 1 or (number is None and not single):
            raise table.error(k, f"{EXPECTED}, with a whole number as id")
        corners = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        named = kind, str(names.get(kind, kind))
        yield (
            f"{path.name}:{table.lines[k]}",
            LabelledBox(frame, number, named, corners, score=score[0] if score else 1.0),
        )


def _in_pixels(size: tuple[int, int], _: str, row: LabelledBox) -> LabelledBox:
    """A row whose corners are shares, in pixels; raises UnusableError where they span nothing."""
    shares = with_area([finite(share, "place or size") for share in row.corners])
    return row._replace(corners=tuple(share * side for share, side in zip(shares, (*size, *size), strict=True)))
