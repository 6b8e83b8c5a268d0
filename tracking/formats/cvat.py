"""CVAT for video 1.1: an XML file with a ``track`` for each object and a ``box`` for each key frame, counted from 0.

A box holds on a straight line to the next one; one with ``outside="1"`` ends the track, or begins a gap. What is filled
in is ``occluded``. Scores stand in the attribute ``score``, the row of the detection among those of the frame in
``detection``; CVAT leaves out what the task does not have. Tasks of single images,
an ``image`` with boxes each, are read, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import read_text
from tsuiseki.tracking.formats.tracked_video import (
    BoxOfPicture,
    TrackedVideo,
    between_keys,
    runs_of,
    tracks_of_rows,
    tracks_without_ids,
)
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME

CORNERS = ("xtl", "ytl", "xbr", "ybr")


def write_cvat(path: Path, video: TrackedVideo) -> None:
    """Write the tracks; a track ends with a box outside, unless it lasts to the last frame."""
    width, height = video.pixels
    root = ElementTree.Element("annotations")
    _text(root, "version", "1.1")
    task = ElementTree.SubElement(ElementTree.SubElement(root, "meta"), "task")
    facts = {"name": video.stem, "size": video.frame_count, "mode": "interpolation", "start_frame": 0,
             "stop_frame": max(video.frame_count - 1, 0), "source": video.name}  # fmt: skip
    for name, value in facts.items():
        _text(task, name, value)
    labels = ElementTree.SubElement(task, "labels")
    for kind in video.kinds:
        label = ElementTree.SubElement(labels, "label")
        _text(label, "name", kind)
        attributes = ElementTree.SubElement(label, "attributes")
        for key in ("score", "detection"):
            attribute = ElementTree.SubElement(attributes, "attribute")
            for name, value in {"name": key, "mutable": "True", "input_type": "text"}.items():
                _text(attribute, name, value)
    original = ElementTree.SubElement(task, "original_size")
    _text(original, "width", width)
    _text(original, "height", height)
    for track in video.tracks:
        names = {"id": str(track.id), "label": video.kind[track.id], "source": "auto"}
        _write_track(ElementTree.SubElement(root, "track", names), track, video.frame_count)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _text(parent: ElementTree.Element, name: str, value: object) -> None:
    ElementTree.SubElement(parent, name).text = str(value)


def _write_track(parent: ElementTree.Element, track: Track, frames: int) -> None:
    for run in runs_of(track.frames):
        for row in run.tolist():
            _write_box(parent, track, row, int(track.frames[row]), False)
        after = int(track.frames[run[-1]]) + 1
        if after < frames:
            _write_box(parent, track, int(run[-1]), after, True)


def _write_box(parent: ElementTree.Element, track: Track, row: int, frame: int, outside: bool) -> None:
    corners = dict(zip(CORNERS, (f"{value:.3f}" for value in track.boxes[row].tolist()), strict=True))
    state = {"frame": str(frame), "keyframe": "1", "outside": str(int(outside))}
    hidden = {"occluded": str(int(not track.observed[row])), "z_order": "0"}
    box = ElementTree.SubElement(parent, "box", state | hidden | corners)
    ElementTree.SubElement(box, "attribute", {"name": "score"}).text = f"{track.scores[row]:.4f}"
    if track.detection[row] >= 0:
        ElementTree.SubElement(box, "attribute", {"name": "detection"}).text = str(track.detection[row])


def read_cvat(path: Path) -> TrackedVideo:
    """The tracks of boxes in a file, or the boxes of a task of single images.

    Raises:
        RequestError: it is something else or broken.
    """
    text = read_text(path, "CVAT's XML")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RequestError(f"{path}: expected CVAT's XML, which defines no entities")
    try:
        root = ElementTree.fromstring(text.encode())
    except ElementTree.ParseError as error:
        raise RequestError(f"{path}: expected CVAT's XML, got a broken one: {error}") from error
    found, images = root.findall("track"), sorted(root.findall("image"), key=lambda image: int(image.get("id", 0)))
    if root.tag == "annotations" and images and not found:
        rows = (row for frame, image in enumerate(images) for row in _boxes(path, frame, image))
        names = tuple(image.get("name", "") for image in images)
        return replace(tracks_without_ids(path, rows), name=path.stem, length=len(images), images=names)
    if root.tag != "annotations":
        there = ", ".join(sorted({child.tag for child in root})[:5]) or "nothing"
        raise RequestError(f"{path}: expected tracks or images of CVAT 1.1, got {root.tag} with {there}")
    size = [_whole(root, f".//original_size/{side}") for side in ("width", "height")]
    classes = {int(track.get("id", -1)): (-1, track.get("label", "")) for track in found}
    tracks = tracks_of_rows(path, (row for track in found for row in _rows(path, track)), classes)
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
            wanted = f"{', '.join(CORNERS)} of each box in numbers"
            raise RequestError(f"{path}: expected {wanted}, got {error} in {dict(box.attrib)}") from error


def _rows(path: Path, track: ElementTree.Element) -> Iterator[tuple[Any, ...]]:
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
    every, values, key = between_keys(path, frames, corners)
    visible = (frames[key] == every) & ~hidden[key]
    for row in np.flatnonzero(~outside[key]).tolist():
        source = sources[key[row]] if visible[row] else -1
        yield int(every[row]), number, values[row], scores[key[row]], bool(visible[row]), source
