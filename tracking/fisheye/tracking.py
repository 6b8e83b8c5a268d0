"""Ceiling cameras with their sources: opened, checked against each other, and looked through frame by frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, read_cameras
from tsuiseki.tracking.cameras.person_model import PersonModel, cached_table
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Detect
from tsuiseki.tracking.fisheye.settings import FisheyeSettings, FloorFlowSettings
from tsuiseki.tracking.fisheye.tracker import FisheyeTracker, flow_on_floor
from tsuiseki.tracking.fisheye.view import CeilingView, FloorGate
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.formats.rotated import (
    as_detections,
    is_rotated,
    read_rotated_detections,
    read_rotated_labels,
)
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, Frame, IntArray
from tsuiseki.tracking.types.tracks import FloorDetections, FloorTrack
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import Source, SourceLike, open_source

Scaling: TypeAlias = Literal["no", "cut", "widen"]
FloorMethod: TypeAlias = Literal["hungarian", "flow"]
REACH = 10.0


@dataclass(frozen=True)
class CeilingSource:
    """A source, its camera for images of this size, and the floor.

    Attributes:
        source: the video.
        placed: its camera.
        floor: ``(4,)`` x1, y1, x2, y2 of the floor that people stand on, metres.
    """

    source: Source
    placed: CameraOverFloor
    floor: FloatArray

    @property
    def rate(self) -> float:
        """Frames per second."""
        return self.placed.frame_rate or self.source.frame_rate

    def seconds(self, frames: IntArray) -> FloatArray:
        """``(N,)`` times of 0-based ``frames`` ``(N,)``, as fast as the camera file says."""
        source = self.source
        return source.times.at(frames, source.frame_rate) * (1.0 if source.live else source.frame_rate / self.rate)

    def view(self, tables: Path, person: PersonModel) -> CeilingView:
        """What finds people's places, with the table of boxes that the folder ``tables`` keeps."""
        camera = self.placed.camera
        return CeilingView(camera, cached_table(tables, camera, self.floor, person), person)


def open_ceiling(
    sources: Sequence[SourceLike],
    cameras: Path,
    resize: Scaling = "no",
    *,
    needs_images: bool = True,
    only: str | None = None,
) -> list[CeilingSource]:
    """Sources with their cameras, checked against each other.

    Args:
        sources: one for each camera, in their order.
        cameras: the camera file.
        resize: how a calibration is scaled to images of another size.
        needs_images: refuse a sequence that is text only.
        only: name of the camera to take; by default all.

    Raises:
        RequestError: there is no such camera, the numbers differ, there are no images, a calibration is of another
            size, or one of several sources is live.
    """
    placed = read_cameras(cameras)
    if only is not None:
        names = ", ".join(entry.name for entry in placed)
        placed = [entry for entry in placed if entry.name == only]
        if not placed:
            raise RequestError(f"`camera`: expected one of {names} in {cameras}, got {only}")
    if len(sources) != len(placed):
        raise RequestError(
            f"expected one source for each camera, got {len(sources)} sources and {len(placed)} cameras in {cameras}"
        )
    views = []
    for text, entry in zip(sources, placed, strict=True):
        opened = open_source(text)
        if opened.live and len(sources) > 1:
            raise RequestError(f"{opened.name} is live and never ends; track each live source in a run of its own")
        if needs_images and not opened.has_images:
            raise RequestError(f"{opened.name} has no images; give `detections`, and none for `appearance`")
        fitted = _fitted(entry, opened, resize)
        x, y = fitted.camera.position[:2]
        floor = np.array([x - REACH, y - REACH, x + REACH, y + REACH]) if fitted.floor is None else fitted.floor
        views.append(CeilingSource(opened, fitted, floor))
    return views


def _image_size(source: Source) -> tuple[int, int] | None:
    """Width and height of a source's images, of a live one of its first; None for text that does not say."""
    if isinstance(source, ImageFolder):
        return source.size if min(source.size) > 0 else None
    height, width = next(iter(source.frames())).image.shape[:2]
    return width, height


def _fitted(placed: CameraOverFloor, source: Source, resize: Scaling) -> CameraOverFloor:
    """The camera for the source's images."""
    size = _image_size(source)
    have = placed.camera.width, placed.camera.height
    if size is None or size == have:
        return placed
    width, height = size
    if resize == "no":
        raise RequestError(
            f"{placed.name}: expected images of {have[0]}x{have[1]} as calibrated, got {width}x{height} in "
            f"{source.name}; calibrate at that size, or scale the calibration with `resize` cut or widen"
        )
    return placed.resized(width, height, resize)


def given_detections(
    path: Path, view: CeilingSource, score_range: tuple[float, float] | None = None
) -> list[Detections]:
    """The detections of each frame of a source in a file: MOTChallenge text, or rotated boxes by image.

    Args:
        path: a det.txt, or what `tsuiseki.tracking.formats.rotated` reads: detections, or labels as such.
        view: the source, a folder of images where the boxes are rotated, since those name images; and its camera.
        score_range: smallest and largest score to expect; by default any.

    Raises:
        RequestError: the file is missing or malformed, names images that the source has not, or has boxes outside the
            image or the lens's rim or scores outside the range.
    """
    rotated = path.is_dir() or path.suffix.lower() == ".json"
    if rotated:
        found = _given_rotated(path, view.source, score_range)
    else:
        found = read_detections(path, view.source.length, score_range)
    size = np.array([view.placed.camera.width, view.placed.camera.height])
    for index, each in enumerate(found):
        # A box outside would be looked up as the nearest one at the rim.
        middle = (each.boxes[:, :2] + each.boxes[:, 2:]) / 2
        outside = middle[((middle < 0) | (middle > size)).any(axis=1)]
        if len(outside):
            raise RequestError(
                f"{path}: frame {index + 1}: expected boxes in images of {size[0]}x{size[1]}, got one about "
                f"{outside[0, 0]:g}, {outside[0, 1]:g}; was it found in images of another size?"
            )
        nowhere = middle[np.isnan(view.placed.camera.ground(middle)).any(axis=1)]
        if len(nowhere):
            raise RequestError(
                f"{path}: frame {index + 1}: expected boxes of people on the floor, got one about {nowhere[0, 0]:g}, "
                f"{nowhere[0, 1]:g}, where {view.placed.name} sees none: beyond the lens's rim or above the horizon"
            )
    return found


def _given_rotated(path: Path, source: Source, score_range: tuple[float, float] | None) -> list[Detections]:
    found = read_rotated_labels(path) if path.is_dir() or is_rotated(path) else read_rotated_detections(path)
    images = source.images if isinstance(source, ImageFolder) else ()
    if not images:
        raise RequestError(f"{path}: rotated boxes name images; expected a folder of images, got {source.name}")
    frames = {name: index for index, image in enumerate(images) for name in (image.name, image.stem)}
    strangers = [name for name in found if name not in frames]
    if strangers:
        raise RequestError(
            f"{path}: expected boxes of the {len(images)} images of {source.name}, got some of {strangers[0]}"
        )
    low, high = score_range or (-np.inf, np.inf)
    result = [Detections.empty()] * len(images)
    for name, each in found.items():
        outside = each.scores[~((each.scores >= low) & (each.scores <= high))]
        if len(outside):
            raise RequestError(f"{path}: {name}: expected scores from {low:g} to {high:g}, got {outside[0]:g}")
        result[frames[name]] = as_detections(each)
    return result


def people_on_floor(
    frames: Iterable[Frame],
    detect: Detect | Sequence[Detections],
    ceiling: CeilingView,
    times: StageTimes,
    length: int | None = None,
    gate: FloorGate | None = None,
) -> Iterator[FloorDetections]:
    """The people of each frame, located and described.

    Args:
        frames: of the source; not read where the detections are given and nothing looks at images.
        detect: what finds people, or what was found in each frame.
        ceiling: the camera.
        times: gets the stages.
        length: of the source; by default as many frames as detections.
        gate: leaves out detections of nobody on the floor; by default all are kept.
    """

    def kept(found: Detections) -> Detections:
        return found if gate is None else gate.keep(found)

    def found_at(given: Sequence[Detections], index: int) -> Detections:
        return kept(given[index]) if index < len(given) else Detections.empty()

    if isinstance(detect, Sequence) and ceiling.appearance is None:
        for index in range(len(detect) if length is None else length):
            yield ceiling.locate(found_at(detect, index), times)
        return
    for frame in frames:
        if isinstance(detect, Sequence):
            found = found_at(detect, frame.index)
        else:
            with times.measure("detect"):
                found = kept(detect.detect([frame.image])[0])
        yield ceiling.describe(frame.image, ceiling.locate(found, times), times)


def link_on_floor(
    found: Iterable[FloorDetections],
    rate: float,
    method: FloorMethod,
    hungarian: FisheyeSettings,
    flow: FloorFlowSettings,
    times: StageTimes,
) -> list[FloorTrack]:
    """The tracks of one camera: ``hungarian`` decides frame by frame, ``flow`` links the whole video at the end."""
    online, kept = FisheyeTracker(rate, hungarian), []
    for each in found:
        if method == "flow":
            kept.append(each)
            continue
        with times.measure("associate"):
            online.update(each)
    with times.measure("associate"):
        return flow_on_floor(kept, rate, flow) if method == "flow" else online.tracks()
