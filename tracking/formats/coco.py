"""Tracks in COCO's JSON: ``videos``, ``images`` with ``frame_id`` from 0, and ``annotations`` with ``track_id``.

A ``bbox`` is x, y, width, height in pixels from 0. ``instance_id``, as other tools call it, is read like ``track_id``.
An annotation without one is a box without an id: where all are so, as in COCO itself, they are labels of single
pictures. A crowd is a region in which results are neither right nor wrong. ``rotation`` in ``attributes`` turns a box,
in degrees clockwise, as CVAT has it. ``detection`` is the row of the box in what the detector or the user gave for the
frame, where that is known.

Files of others count ``frame_id`` from 1, or have none: see `listed_images.frames_of_images`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import Sieve, UnusableError
from tsuiseki.tracking.formats.labelled_boxes import (
    TURNED,
    LabelledBox,
    about_turned,
    finite,
    id_of,
    labelled_video,
    with_area,
)
from tsuiseki.tracking.formats.listed_images import ListedImage, frames_of_images, listed_frames
from tsuiseki.tracking.formats.rows import whole
from tsuiseki.tracking.formats.tracked_video import TrackedVideo, inside
from tsuiseki.tracking.geometry import xywh_from_corners
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import refusing

COCO = "COCO's JSON"
# Under these keys tools write the id of a track, and the number of an image's frame.
TRACK_KEYS = ("track_id", "instance_id")
FRAME_KEYS = ("frame_id", "frame_index")


def write_coco(path: Path, video: TrackedVideo) -> None:
    """Write the tracks; images of a video file are called 000001.jpg and so on."""
    width, height = video.pixels
    # Categories count from 1.
    first = min(video.kinds.values())
    rows, kinds = video.boxes, {kind: number + max(1 - first, 0) for kind, number in video.kinds.items()}
    columns = rows.listed(boxes=xywh_from_corners(rows.boxes).round(3), scores=rows.scores.round(4))
    content = {
        "info": {"description": video.name, "frame_rate": video.frame_rate},
        "licenses": [],
        "videos": [{"id": 1, "name": video.name, "width": width, "height": height, "length": video.frame_count}],
        "categories": [{"id": number, "name": kind, "supercategory": ""} for kind, number in kinds.items()],
        "images": [
            {"id": frame + 1, "file_name": video.image(frame), "width": width, "height": height, "video_id": 1,
             "frame_id": frame}
            for frame in range(video.frame_count)
        ],
        "annotations": [
            {"id": k, "image_id": frame + 1, "video_id": 1, "track_id": number,
             "category_id": kinds[video.kind[number]], "bbox": box, "area": round(box[2] * box[3], 3),
             "iscrowd": 0, "segmentation": [], "score": score, "filled": not observed,
             **({"detection": row} if row >= 0 else {})}
            for k, (frame, number, box, score, observed, row) in enumerate(columns, start=1)
        ],
    }  # fmt: skip
    path.write_text(json.dumps(content) + "\n", encoding="utf-8")


def read_coco(path: Path) -> TrackedVideo:
    """The tracks of the only video in a file, and the boxes that have no id.

    Raises:
        RequestError: it is something else or broken, has several videos, or most annotations cannot be used.
    """
    content = read_json(path, COCO)
    with refusing(f"{path}: expected {COCO} with images, categories and annotations of boxes, got something else"):
        images, categories, annotations = (_entries(path, content, part) for part in PARTS)
        kinds = _kinds(path, categories)
        several = {str(image.get("video_id", 0)) for image in images}
        if len(several) > 1:
            raise RequestError(f"{path}: expected one video, got {len(several)}; keep the images of one")
        videos = content.get("videos") or [{}]
        length = whole(str(videos[0].get("length"))) or 0
        tracked = any(_track(entry) not in (None, -1) for entry in annotations)
        frames, listed = _frames(path, images, length, tracked)
        sieve = Sieve(path, "annotations")
        entries = (
            (f"annotation {entry.get('id', number)}", entry) for number, entry in enumerate(annotations, start=1)
        )
        boxes = [*sieve.read(entries, lambda name, entry: _box(sieve, name, entry, frames, kinds))]
        info = content.get("info") if isinstance(content.get("info"), dict) else {}
        rate = info.get("frame_rate", 0.0)
        name = str(videos[0].get("name") or path.stem)
    sizes = {image.name: image.size for image in listed if image.size is not None}
    size = {*sizes.values()}
    last = max(frames.values(), default=-1)
    by_frame = [""] * (last + 1)
    for image, frame in zip(listed, frames.values(), strict=True):
        by_frame[frame] = image.name
    return replace(
        labelled_video(path, boxes, sieve),
        name=name,
        frame_rate=float(rate) if isinstance(rate, int | float) else 0.0,
        size=size.pop() if len(size) == 1 else None,
        length=max(last + 1, length),
        images=tuple(by_frame) if all(image.name for image in listed) else (),
        image_sizes=sizes,
        listed=listed_frames(path, [*frames.values()], length),
    )


PARTS = ("images", "categories", "annotations")


def _entries(path: Path, content: Any, part: str) -> list[dict[str, Any]]:
    entries = content.get(part) if isinstance(content, dict) else None
    if not isinstance(entries, list):
        raise RequestError(f"{path}: expected {COCO} with {', '.join(PARTS)}, found no list of {part}")
    if not all(isinstance(entry, dict) for entry in entries):
        raise RequestError(f"{path}: expected {COCO} with {', '.join(PARTS)}, got {part} that are no objects")
    return entries


def _key(value: object) -> int | str:
    """An id, which some tools write as text."""
    if isinstance(value, int):
        return value
    number = whole(str(value))
    return str(value) if number is None else number


def _kinds(path: Path, categories: list[dict[str, Any]]) -> dict[int | str, tuple[int, str]]:
    """By id the number and the name of each category."""
    kinds: dict[int | str, tuple[int, str]] = {}
    for category in categories:
        number, name = whole(str(category.get("id"))), category.get("name")
        if number is None or not isinstance(name, str | int):
            raise RequestError(f"{path}: expected a whole number as id and a name of each category, got {category}")
        if kinds.get(number, (number, str(name))) != (number, str(name)):
            raise RequestError(f"{path}: expected one name a category, got {kinds[number][1]} and {name} of {number}")
        kinds[number] = number, str(name)
    return kinds


def _frames(
    path: Path, images: list[dict[str, Any]], length: int, tracked: bool
) -> tuple[dict[int | str, int], list[ListedImage]]:
    """By id the frame of each image, and the images."""
    if not images:
        return {}, []
    keys = [_key(image.get("id")) for image in images]
    if len({*keys}) < len(keys):
        twice = next(key for key in keys if keys.count(key) > 1)
        raise RequestError(f"{path}: expected an id of each image, got {twice} twice")
    # Where images have neither number nor name, their ids are in order.
    order = sorted(range(len(keys)), key=lambda k: (isinstance(keys[k], str), keys[k]))
    listed = [_image(path, images[k]) for k in order]
    frames = frames_of_images(path, listed, "frame_id", length, tracked)
    return dict(zip([keys[k] for k in order], frames, strict=True)), listed


def _image(path: Path, image: Mapping[str, Any]) -> ListedImage:
    text = next((str(image[key]) for key in FRAME_KEYS if image.get(key) is not None), None)
    number = None if text is None else whole(text)
    if text is not None and number is None:
        raise RequestError(f"{path}: expected a whole number as frame_id, got {text[:40]!r} of image {image.get('id')}")
    width, height = (whole(str(image.get(side))) or 0 for side in ("width", "height"))
    return ListedImage(
        inside(image.get("file_name") or "") or "", number, (width, height) if min(width, height) > 0 else None
    )


def _attributes(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    attributes = entry.get("attributes")
    return attributes if isinstance(attributes, dict) else {}


def _track(entry: Mapping[str, Any]) -> object:
    places = (entry, _attributes(entry))
    return next((place[key] for key in TRACK_KEYS for place in places if place.get(key) is not None), None)


def _box(
    sieve: Sieve,
    name: str,
    entry: Mapping[str, Any],
    frames: Mapping[int | str, int],
    kinds: Mapping[int | str, tuple[int, str]],
) -> LabelledBox:
    """An annotation's box; raises UnusableError, see `Sieve`."""
    image, category, bbox = _key(entry.get("image_id")), _key(entry.get("category_id")), entry.get("bbox")
    if image not in frames:
        raise UnusableError("of an image that is not listed")
    if category not in kinds:
        raise UnusableError(f"of category {category}, which is not listed")
    if not isinstance(bbox, list) or len(bbox) != 4:
        raise UnusableError("without x, y, width and height in bbox")
    x, y, width, height = (finite(value, "bbox") for value in bbox)
    corners = with_area((x, y, x + width, y + height))
    degrees = finite(_attributes(entry).get("rotation"), "rotation", 0.0)
    if degrees % 360:
        sieve.mend(name, TURNED)
        corners = about_turned(np.array([corners]), np.array([degrees]))[0].tolist()
    return LabelledBox(
        frames[image],
        id_of(_track(entry), "track_id"),
        kinds[category],
        corners,
        crowd=finite(entry.get("iscrowd"), "iscrowd", 0.0) != 0,
        score=finite(entry.get("score"), "score", 1.0),
        observed=not entry.get("filled", False),
        detection=int(finite(entry.get("detection"), "detection", -1.0)),
    )
