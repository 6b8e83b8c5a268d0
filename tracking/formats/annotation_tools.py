"""Tracks in the files of annotation tools: COCO's JSON, Label Studio and CVAT.

COCO's JSON with tracks: ``videos``, ``images`` with ``frame_id`` from 0, and ``annotations`` with ``track_id``.

A ``bbox`` is x, y, width, height in pixels from 0. ``instance_id``, as other tools call it, is read like ``track_id``.
Where annotations have neither, as in COCO itself, they are labels of single pictures; crowds are ignored there.
``detection`` is the row of the box in what the detector or the user gave for the frame, where that is known.

Label Studio's JSON of video: a list of tasks, with a ``videorectangle`` for each track.

Frames count from 1; x, y, width and height are percent of the picture. A key frame that is ``enabled`` holds on a
straight line to the next one, or to the end; one that is not is the last before a gap. A track has one score. The size
of the picture, which other files do not say, stands in ``data`` under ``size``.

CVAT for video 1.1: an XML file with a ``track`` for each object and a ``box`` for each key frame, counted from 0.

A box holds on a straight line to the next one; one with ``outside="1"`` ends the track, or begins a gap. What is filled
in is ``occluded``. Scores stand in the attribute ``score``, the row of the detection among those of the frame in
``detection``; CVAT leaves out what the task does not have. Tasks of single images,
an ``image`` with boxes each, are read, too.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.tracked_video import (
    BoxOfPicture,
    Size,
    TrackedVideo,
    between_keys,
    inside,
    runs_of,
    tracks_of_rows,
    tracks_without_ids,
)
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.openers.xml_files import read_xml
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME

COCO = "COCO's JSON"


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
    """The tracks of the only video in a file, or the boxes of its pictures where any has no id.

    Raises:
        RequestError: it is something else or broken, or has several videos.
    """
    content = read_json(path, COCO)
    with refusing(f"{path}: expected {COCO} with images, categories and annotations of boxes, got ", repr):
        images = content["images"]
        categories = {category["id"]: str(category["name"]) for category in content["categories"]}
        several = {image.get("video_id", 0) for image in images}
        if len(several) > 1:
            raise RequestError(f"{path}: expected one video, got {len(several)}; keep the images of one")
        order = sorted(range(len(images)), key=lambda k: images[k].get("frame_id", k))
        counted = all("frame_id" in image for image in images)
        frames = {images[k]["id"]: int(images[k]["frame_id"]) if counted else n for n, k in enumerate(order)}
        rows, single, classes = [], list[BoxOfPicture](), dict[int, tuple[int, str]]()
        for entry in content["annotations"]:
            places = (entry, entry.get("attributes") or {})
            tags = ((place, name) for name in ("track_id", "instance_id") for place in places)
            number = next((int(place[name]) for place, name in tags if name in place), None)
            x, y, width, height = map(float, entry["bbox"])
            box = (x, y, x + width, y + height)
            observed = not entry.get("filled", False)
            score, row = float(entry.get("score", 1)), int(entry.get("detection", -1))
            frame, kind = frames[entry["image_id"]], (int(entry["category_id"]), categories[entry["category_id"]])
            rows.append((frame, number, box, score, observed, row))
            if number is not None:
                classes[number] = kind
            single.append((frame, kind, box, bool(entry.get("iscrowd"))))
        identified = all(number is not None for _, number, *_ in rows)
        names = tuple(inside(images[k].get("file_name", "")) or "" for k in order)
        sizes = {(int(image["width"]), int(image["height"])) for image in images if image.get("width")}
    video = TrackedVideo(tracks_of_rows(path, rows, classes)) if identified else tracks_without_ids(path, single)
    info = content.get("info") if isinstance(content.get("info"), dict) else {}
    rate = info.get("frame_rate", 0.0)
    videos = content.get("videos") or [{}]
    return replace(
        video,
        name=str(videos[0].get("name") or path.stem),
        frame_rate=float(rate) if isinstance(rate, int | float) else 0.0,
        size=sizes.pop() if len(sizes) == 1 else None,
        length=max(frames.values(), default=-1) + 1,
        images=names if all(names) else (),
    )


LABEL_STUDIO = "Label Studio's JSON of video"
SIDES = ("x", "y", "width", "height")


def write_label_studio(path: Path, video: TrackedVideo) -> None:
    """Write the tracks as predictions; in ``data`` stands the video's name, for which its address is to be put."""
    size = np.array(video.pixels)
    regions = [_region(track, video, size) for track in video.tracks]
    task = {
        "data": {"video": video.name, "size": size.tolist(), "frame_rate": video.frame_rate},
        "predictions": [{"model_version": "tsuiseki", "result": regions}],
    }
    path.write_text(json.dumps([task]) + "\n", encoding="utf-8")


def _region(track: Track, video: TrackedVideo, size: Any) -> dict[str, Any]:
    shares = (xywh_from_corners(track.boxes) / np.tile(size, 2) * 100).round(5)
    ends = {int(run[-1]) for run in runs_of(track.frames)}
    sequence = [
        {"frame": frame + 1, "enabled": k not in ends, "rotation": 0, **dict(zip(SIDES, box, strict=True)),
         **({"time": (frame + 1) / video.frame_rate} if video.frame_rate else {})}
        for k, (frame, box) in enumerate(zip(track.frames.tolist(), shares.tolist(), strict=True))
    ]  # fmt: skip
    value = {"framesCount": video.frame_count, "sequence": sequence, "labels": [video.kind[track.id]]}
    if video.frame_rate:
        value["duration"] = video.frame_count / video.frame_rate
    names = {"id": str(track.id), "type": "videorectangle", "from_name": "box", "to_name": "video"}
    return {**names, "origin": "prediction", "score": round(float(track.scores.mean()), 4), "value": value}


def read_label_studio(path: Path) -> TrackedVideo:
    """The tracks of the only task in a file: those that people made, or else predictions.

    Names of tracks are numbers, or they are numbered from 1.

    Raises:
        RequestError: it is something else or broken, or has several tasks.
    """
    content = read_json(path, LABEL_STUDIO)
    if not isinstance(content, list) or len(content) != 1:
        count = len(content) if isinstance(content, list) else 0
        raise RequestError(f"{path}: expected one task of {LABEL_STUDIO}, got {count}; export one at a time")
    with refusing(f"{path}: expected {LABEL_STUDIO}, got a broken one: ", repr):
        task = content[0]
        annotation = next((entry for name in ("annotations", "predictions") for entry in task.get(name) or []), None)
        regions = [region for region in (annotation or {}).get("result", []) if region.get("type") == "videorectangle"]
        if annotation is None or (annotation["result"] and not regions):
            raise RequestError(f"{path}: expected `videorectangle` in {LABEL_STUDIO}, found none")
        names = [str(region["id"]) for region in regions]
        numbered = all(name.isdecimal() and len(name) < 19 for name in names) and len({*names}) == len(names)
        ids = [int(name) if numbered else k + 1 for k, name in enumerate(names)]
        data = task["data"]
        size = (int(data["size"][0]), int(data["size"][1])) if "size" in data else None
        length = max((int(region["value"].get("framesCount") or 0) for region in regions), default=0)
        numbered_regions = zip(ids, regions, strict=True)
        rows = [row for number, region in numbered_regions for row in _region_rows(path, number, region, size)]
        labels = (str((region["value"].get("labels") or [""])[0]) for region in regions)
        classes = {number: (-1, label) for number, label in zip(ids, labels, strict=True)}
        name = PurePosixPath(str(data.get("video") or path.stem).split("?")[0]).name
        value = regions[0]["value"] if regions else {}
        measured = float(value["framesCount"]) / float(value["duration"]) if value.get("duration") else 0.0
        rate = float(data.get("frame_rate") or 0) or measured
    return TrackedVideo(tracks_of_rows(path, rows, classes), name, rate, size, length, shares=size is None)


def _region_rows(path: Path, number: int, region: Any, size: Size) -> Iterator[tuple[int, int, Any, float, bool]]:
    keys = sorted(region["value"]["sequence"], key=lambda key: int(key["frame"]))
    frames = np.array([int(key["frame"]) - 1 for key in keys], dtype=np.int64)
    last = int(region["value"].get("framesCount") or 0) - 1
    if not len(frames) or frames[0] < 0 or max(int(frames[-1]), last) >= LAST_FRAME or (np.diff(frames) == 0).any():
        raise RequestError(f"{path}: expected each frame from 1 to {LAST_FRAME} once in track {region['id']}")
    if any(key.get("rotation") for key in keys):
        raise RequestError(f"{path}: expected upright boxes, got a turned one in track {region['id']}")
    shares = np.array([[float(key[side]) for side in SIDES] for key in keys])
    boxes = corners_from_xywh(shares) * np.tile(size or (1, 1), 2) / 100
    enabled = np.array([bool(key.get("enabled", True)) for key in keys])
    track_frames, values, key = between_keys(path, frames, boxes, last if enabled[-1] else 0)
    listed = frames[key] == track_frames
    score = float(region.get("score") or 1)
    for row in np.flatnonzero(enabled[key] | listed).tolist():
        yield int(track_frames[row]), number, values[row], score, bool(listed[row])


CORNERS = ("xtl", "ytl", "xbr", "ybr")


def write_cvat(path: Path, video: TrackedVideo) -> None:
    """Write the tracks; a track ends with a box outside, unless it lasts to the last frame."""
    width, height = video.pixels
    root = ElementTree.Element("annotations")
    _add(root, "version", "1.1")
    task = _add(_add(root, "meta"), "task")
    facts = {"name": video.stem, "size": video.frame_count, "mode": "interpolation", "start_frame": 0,
             "stop_frame": max(video.frame_count - 1, 0), "source": video.name}  # fmt: skip
    for name, value in facts.items():
        _add(task, name, value)
    labels = _add(task, "labels")
    for kind in video.kinds:
        label = _add(labels, "label")
        _add(label, "name", kind)
        attributes = _add(label, "attributes")
        for key in ("score", "detection"):
            attribute = _add(attributes, "attribute")
            for name, value in {"name": key, "mutable": "True", "input_type": "text"}.items():
                _add(attribute, name, value)
    original = _add(task, "original_size")
    _add(original, "width", width)
    _add(original, "height", height)
    for track in video.tracks:
        parent = _add(root, "track", id=str(track.id), label=video.kind[track.id], source="auto")
        for run in runs_of(track.frames):
            for row in run.tolist():
                _add_box(parent, track, row, int(track.frames[row]))
            next_frame = int(track.frames[run[-1]]) + 1
            if next_frame < video.frame_count:
                _add_box(parent, track, int(run[-1]), next_frame, outside=True)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _add(parent: ElementTree.Element, name: str, text: object = None, **attributes: str) -> ElementTree.Element:
    element = ElementTree.SubElement(parent, name, attributes)
    element.text = None if text is None else str(text)
    return element


def _add_box(parent: ElementTree.Element, track: Track, row: int, frame: int, outside: bool = False) -> None:
    corners = dict(zip(CORNERS, (f"{value:.3f}" for value in track.boxes[row].tolist()), strict=True))
    state = {"frame": str(frame), "keyframe": "1", "outside": str(int(outside))}
    hidden = {"occluded": str(int(not track.observed[row])), "z_order": "0"}
    box = _add(parent, "box", **state, **hidden, **corners)
    ElementTree.SubElement(box, "attribute", {"name": "score"}).text = f"{track.scores[row]:.4f}"
    if track.detection[row] >= 0:
        ElementTree.SubElement(box, "attribute", {"name": "detection"}).text = str(track.detection[row])


def read_cvat(path: Path) -> TrackedVideo:
    """The tracks of boxes in a file, or the boxes of a task of single images.

    Raises:
        RequestError: it is something else or broken.
    """
    root = read_xml(path, "CVAT's XML")
    elements, images = root.findall("track"), sorted(root.findall("image"), key=lambda image: int(image.get("id", 0)))
    if root.tag == "annotations" and images and not elements:
        rows = (row for frame, image in enumerate(images) for row in _boxes(path, frame, image))
        names = tuple(image.get("name", "") for image in images)
        return replace(tracks_without_ids(path, rows), name=path.stem, length=len(images), images=names)
    if root.tag != "annotations":
        there = ", ".join(sorted({child.tag for child in root})[:5]) or "nothing"
        raise RequestError(f"{path}: expected tracks or images of CVAT 1.1, got {root.tag} with {there}")
    size = [_whole(root, f".//original_size/{side}") for side in ("width", "height")]
    classes = {int(track.get("id", -1)): (-1, track.get("label", "")) for track in elements}
    tracks = tracks_of_rows(path, (row for track in elements for row in _track_rows(path, track)), classes)
    return TrackedVideo(
        tracks,
        name=root.findtext(".//task/source") or root.findtext(".//job/source") or path.stem,
        size=(size[0], size[1]) if min(size) > 0 else None,
        length=_whole(root, ".//task/size") or _whole(root, ".//job/size"),
    )


def _whole(root: ElementTree.Element, place: str) -> int:
    text = (root.findtext(place) or "0").strip()
    return min(int(text), LAST_FRAME) if text.isdecimal() and len(text) < 10 else 0


def _boxes(path: Path, frame: int, image: ElementTree.Element) -> Iterator[BoxOfPicture]:
    for box in image.findall("box"):
        try:
            yield frame, (-1, box.get("label", "")), [float(box.attrib[name]) for name in CORNERS], False
        except (KeyError, ValueError) as error:
            expected = f"{', '.join(CORNERS)} of each box in numbers"
            raise RequestError(f"{path}: expected {expected}, got {error} in {dict(box.attrib)}") from error


def _track_rows(path: Path, track: ElementTree.Element) -> Iterator[tuple[Any, ...]]:
    try:
        number = int(track.attrib["id"])
        boxes = sorted(track.findall("box"), key=lambda box: int(box.attrib["frame"]))
        corners = np.array([[float(box.attrib[name]) for name in CORNERS] for box in boxes])
        scores = [float(box.findtext("attribute[@name='score']") or 1) for box in boxes]
        sources = [int(box.findtext("attribute[@name='detection']") or -1) for box in boxes]
    except (KeyError, ValueError) as error:
        raise RequestError(
            f"{path}: expected id, frame, {', '.join(CORNERS)} of each box in numbers, got {error} in a track "
            f"{dict(track.attrib)}"
        ) from error
    frames = np.array([int(box.attrib["frame"]) for box in boxes], dtype=np.int64)
    if not len(frames):
        raise RequestError(f"{path}: expected a box in each track, got none in track {number}")
    if not np.isfinite(corners).all():
        raise RequestError(f"{path}: expected finite corners of each box, got others in track {number}")
    if frames[0] < 0 or frames[-1] >= LAST_FRAME or (np.diff(frames) == 0).any():
        raise RequestError(f"{path}: expected each frame from 0 to {LAST_FRAME - 1} once in track {number}")
    outside, hidden = (np.array([box.get(name) == "1" for box in boxes]) for name in ("outside", "occluded"))
    track_frames, values, key = between_keys(path, frames, corners)
    visible = (frames[key] == track_frames) & ~hidden[key]
    for row in np.flatnonzero(~outside[key]).tolist():
        source = sources[key[row]] if visible[row] else -1
        yield int(track_frames[row]), number, values[row], scores[key[row]], bool(visible[row]), source
