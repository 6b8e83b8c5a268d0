"""Tracks in CVAT's XML for video 1.1: a ``track`` for each object and a ``box`` for each key frame, counted from 0.

A box holds on a straight line to the next one; one with ``outside="1"`` ends the track, or begins a gap. What is filled
in is ``occluded``. ``rotation`` turns a box about its middle, in degrees clockwise. Scores stand in the attribute
``score``, the row of the detection among those of the frame in ``detection``; CVAT leaves out what the task does not
have. Tasks of single images, an ``image`` with boxes each, are read, too; their ``id`` is the frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import Sieve, UnusableError
from tsuiseki.tracking.formats.labelled_boxes import (
    TURNED,
    LabelledBox,
    about_turned,
    finite,
    labelled_video,
    with_area,
)
from tsuiseki.tracking.formats.listed_images import ListedImage, frames_of_images, listed_frames
from tsuiseki.tracking.formats.rows import whole
from tsuiseki.tracking.formats.tracked_video import TrackedVideo, between_keys, inside, runs_of
from tsuiseki.tracking.openers.xml_files import read_xml
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME

CORNERS = ("xtl", "ytl", "xbr", "ybr")
# What stands in a track or an image beside its shapes.
NO_SHAPES = ("attribute", "tag")


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
        RequestError: it is something else or broken, or most shapes cannot be used.
    """
    root = read_xml(path, "CVAT's XML")
    tracks, images = root.findall("track"), root.findall("image")
    if root.tag != "annotations":
        there = ", ".join(sorted({child.tag for child in root})[:5]) or "nothing"
        raise RequestError(f"{path}: expected tracks or images of CVAT 1.1, got {root.tag} with {there}")
    if images and not tracks:
        return _of_images(path, root, images)
    ids = [track.get("id", "") for track in tracks]
    if len({*ids}) < len(ids):
        twice = next(number for number in ids if ids.count(number) > 1)
        raise RequestError(f"{path}: expected an id of each track, got {twice!r} twice; export one task at a time")
    size = [_whole(root, f".//original_size/{side}") for side in ("width", "height")]
    sieve = Sieve(path, "key frames")
    video = labelled_video(path, [box for track in tracks for box in _track_boxes(path, sieve, track)], sieve)
    return replace(
        video,
        name=root.findtext(".//task/source") or root.findtext(".//job/source") or path.stem,
        size=(size[0], size[1]) if min(size) > 0 else None,
        length=_whole(root, ".//task/size") or _whole(root, ".//job/size"),
    )


def _whole(root: ElementTree.Element, place: str) -> int:
    text = (root.findtext(place) or "0").strip()
    return min(int(text), LAST_FRAME) if text.isdecimal() and len(text) < 10 else 0


def _of_images(path: Path, root: ElementTree.Element, images: list[ElementTree.Element]) -> TrackedVideo:
    """The boxes of a task of single images."""
    length = _whole(root, ".//task/size")
    listed = [_image(path, image) for image in images]
    frames = frames_of_images(path, listed, "id", length, tracked=False, first=0)
    sieve = Sieve(path, "shapes")
    boxes = [box for image, frame in zip(images, frames, strict=True) for box in _image_boxes(sieve, image, frame)]
    names = [""] * (max(frames) + 1)
    for image, frame in zip(listed, frames, strict=True):
        names[frame] = image.name
    return replace(
        labelled_video(path, boxes, sieve),
        name=path.stem,
        length=max(len(names), length),
        images=tuple(names) if all(image.name for image in listed) else (),
        image_sizes={image.name: image.size for image in listed if image.size is not None},
        listed=listed_frames(path, frames, length),
    )


def _image(path: Path, image: ElementTree.Element) -> ListedImage:
    text = image.get("id")
    number = None if text is None else whole(text)
    if text is not None and number is None:
        raise RequestError(f"{path}: expected the number of a frame as id of an image, got {text[:40]!r}")
    width, height = (whole(image.get(side, "0")) or 0 for side in ("width", "height"))
    return ListedImage(inside(image.get("name", "")) or "", number, (width, height) if min(width, height) > 0 else None)


def _image_boxes(sieve: Sieve, image: ElementTree.Element, frame: int) -> Iterator[LabelledBox]:
    name = f"in image {image.get('name') or image.get('id')}"

    def box_of(name: str, shape: ElementTree.Element) -> LabelledBox:
        corners, degrees = _corners(sieve, name, shape)
        upright = about_turned(np.array([corners]), np.array([degrees]))[0].tolist()
        return LabelledBox(frame, None, (-1, shape.get("label", "")), upright)

    yield from sieve.read(((name, shape) for shape in image if shape.tag not in NO_SHAPES), box_of)


def _corners(sieve: Sieve, name: str, shape: ElementTree.Element) -> tuple[list[float], float]:
    """Corners, and the degrees by which they are turned; raises UnusableError, see `Sieve`."""
    if shape.tag != "box":
        raise UnusableError(f"of the shape {shape.tag}, which is no box")
    corners = [finite(shape.get(side), side) for side in CORNERS]
    with_area(corners)
    degrees = finite(shape.get("rotation"), "rotation", 0.0)
    if degrees % 360:
        sieve.mend(name, TURNED)
    return corners, degrees


class _Key(NamedTuple):
    """A key frame of a track; where it is outside, the corners may be of anything."""

    frame: int
    outside: bool
    hidden: bool
    corners: list[float]
    degrees: float
    score: float
    detection: int


def _key(sieve: Sieve, name: str, shape: ElementTree.Element) -> _Key:
    frame, outside = whole(shape.get("frame", "")), shape.get("outside") == "1"
    if frame is None or not 0 <= frame < LAST_FRAME:
        raise UnusableError(f"without a frame from 0 to {LAST_FRAME - 1}")
    try:
        corners, degrees = _corners(sieve, name, shape)
    except UnusableError:
        if not outside:
            raise
        corners, degrees = [np.nan] * 4, 0.0
    score = finite(shape.findtext("attribute[@name='score']") or None, "score", 1.0)
    detection = finite(shape.findtext("attribute[@name='detection']") or None, "detection", -1.0)
    return _Key(frame, outside, shape.get("occluded") == "1", corners, degrees, score, int(detection))


def _track_boxes(path: Path, sieve: Sieve, track: ElementTree.Element) -> Iterator[LabelledBox]:
    """The boxes of a track in all its frames."""
    number, name = whole(track.get("id", "")), f"track {track.get('id', 'without an id')}"
    # A track without any shape counts as a shape without a frame.
    shapes = [shape for shape in track if shape.tag not in NO_SHAPES] or [ElementTree.Element("box")]
    named = ((f"frame {shape.get('frame')} of {name}", shape) for shape in shapes)
    if number is None or number < 0:
        sieve.usable([name for name, _ in named], (np.ones(len(shapes), np.bool_), "without a whole number as id"))
        return
    keys = sorted(sieve.read(named, partial(_key, sieve)), key=lambda key: key.frame)
    if not keys:
        return
    frames = np.array([key.frame for key in keys], dtype=np.int64)
    if (np.diff(frames) == 0).any():
        raise RequestError(f"{path}: expected each frame from 0 to {LAST_FRAME - 1} once in {name}")
    track_frames, corners, at_key = between_keys(path, frames, _turned_corners(keys))
    upright = about_turned(corners[:, :4], corners[:, 4])
    for row, frame in enumerate(track_frames.tolist()):
        key = keys[at_key[row]]
        if not key.outside:
            visible = key.frame == frame and not key.hidden
            kind, detection = (-1, track.get("label", "")), key.detection if visible else -1
            yield LabelledBox(frame, number, kind, upright[row].tolist(), False, key.score, visible, detection)


def _turned_corners(keys: Sequence[_Key]) -> FloatArray:
    """``(K, 5)`` corners and degrees, which go the short way round; a key that has none has those before it."""
    corners = np.column_stack([[key.corners for key in keys], np.unwrap([key.degrees for key in keys], period=360)])
    filled = np.maximum.accumulate(np.where(np.isfinite(corners).all(axis=1), np.arange(len(keys)), 0))
    return np.asarray(corners[filled])
