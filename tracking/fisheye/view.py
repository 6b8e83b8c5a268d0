"""Ceiling cameras with their sources, and their detections before tracking: rotated boxes, places, appearance.

People are cut out of the image and turned upright: the local panorama of thesis 4.2.2.2, eq. (4.2)-(4.4). Eq. (4.2)
turns the image about the centre of a rotated box until the feet are below. As printed its last column does not keep
that centre in place (the signs of ``beta y_r`` and ``beta x_r`` are those of a matrix turned the other way, that of
``(1 - alpha) y_r`` is of neither); here it does. Turning and cutting out are one map for each box, from the crop's
pixels to the image's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, read_cameras
from tsuiseki.tracking.cameras.person_model import PersonModel, PersonTable, cached_table
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Describe
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.formats.rotated import (
    about_bodies,
    is_rotated,
    read_rotated_detections,
    read_rotated_labels,
    turned_detections,
)
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray, IntArray
from tsuiseki.tracking.types.tracks import FloorDetections
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import Source, SourceLike, open_source

Crops = Literal["image", "upright"]
Scaling: TypeAlias = Literal["no", "cut", "widen"]
# Height and width of a crop, pixels: what the shipped appearance network takes.
CROP = (128, 64)
# Beyond this many pixels of the image in one of the crop, the crop is drawn finer and shrunk.
COARSEST = 1.5


@dataclass(frozen=True)
class CeilingView:
    """The table of boxes of a camera and the appearance model.

    Attributes:
        table: gives the rotated box and the floor position of an upright box.
        appearance: the appearance model; None uses no appearance.
        crops: its input: the upright box as it is in the ``image``, or the rotated box turned ``upright``.
    """

    table: PersonTable
    appearance: Describe | None = None
    crops: Crops = "upright"

    def locate(self, detections: Detections, times: StageTimes | None = None) -> FloorDetections:
        """Rotated boxes and places of detected boxes; ``times`` gets the stage ``look up``."""
        times = times or StageTimes()
        with times.measure("look up"):
            if detections.angles is None:
                return FloorDetections(detections, *self.table.look_up(detections.boxes))
            return self._turned(detections, detections.angles)

    def _turned(self, detections: Detections, angles: FloatArray) -> FloorDetections:
        """Boxes that a network has turned itself, with the feet's end and the place of the upright box about each."""
        turned = np.column_stack([as_unturned(detections.boxes)[:, :4], angles])
        upright = about_bodies(turned)
        looked_up, places = self.table.look_up(upright)
        # Labels and networks tell the body's line, not which of its ends is up: the model does.
        flipped = np.cos(looked_up[:, 4] - angles) < 0
        rotated = turned.copy()
        rotated[:, 4] = (angles + np.pi * flipped + np.pi) % (2 * np.pi) - np.pi
        return FloorDetections(replace(detections, boxes=upright, angles=None), rotated, places)

    def describe(self, image: ImageArray, located: FloorDetections, times: StageTimes | None = None) -> FloorDetections:
        """``located`` with appearance features; ``times`` gets the stages ``rectify`` and ``describe``."""
        if self.appearance is None or not len(located):
            return located
        times = times or StageTimes()
        with times.measure("rectify"):
            boxes = located.rotated if self.crops == "upright" else as_unturned(located.detections.boxes)
            crops = upright_crops(image, boxes, *CROP)
        with times.measure("describe"):
            # An appearance model takes an image and boxes: the crops are stacked to one image.
            rows = np.arange(len(crops))[:, None] * CROP[0]
            cells = np.concatenate([0 * rows, rows, 0 * rows + CROP[1], rows + CROP[0]], axis=1).astype(np.float64)
            features = self.appearance.describe(crops.reshape(-1, CROP[1], 3), cells)
        return replace(located, detections=located.detections.with_features(features))


def as_unturned(boxes: FloatArray) -> FloatArray:
    """``(N, 5)`` rotated boxes of angle 0 from ``(N, 4)`` x1, y1, x2, y2."""
    centre, size = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    return np.concatenate([centre, size, np.zeros((len(boxes), 1))], axis=1)


# Metres from the camera to the ends of a floor that the camera file does not tell.
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
        return source.times_of(frames) * (1.0 if source.live else source.frame_rate / self.rate)

    def view(self, tables: Path, person: PersonModel) -> CeilingView:
        """What finds people's places, with the table of boxes that the folder ``tables`` keeps."""
        return CeilingView(cached_table(tables, self.placed.camera, self.floor, person))


def open_ceiling(
    sources: Sequence[SourceLike],
    cameras: Path,
    resize: Scaling = "no",
    *,
    needs_images: bool = True,
    only: str | None = None,
) -> list[CeilingSource]:
    """Sources with their cameras, in the same order, checked against each other; ``only`` takes the camera of a name.

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


def _fitted(placed: CameraOverFloor, source: Source, resize: Scaling) -> CameraOverFloor:
    """The camera for the source's images."""
    # Text may not say it.
    size = source.size if isinstance(source, ImageFolder) else next(iter(source.frames())).image.shape[1::-1]
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

    Rotated boxes are detections, or labels as such, see `formats.rotated`; they name images, so that the source is a
    folder of these.

    Raises:
        RequestError: the file is missing or malformed, names images that the source has not, or has boxes outside the
            image or the lens's rim or scores outside the range.
    """
    if path.is_dir() or path.suffix.lower() == ".json":
        detections = _given_rotated(path, view.source, score_range)
    else:
        detections = read_detections(path, view.source.length, score_range)
    size = np.array([view.placed.camera.width, view.placed.camera.height])
    for index, in_frame in enumerate(detections):
        # A box outside would be looked up as the nearest one at the rim.
        middle = centres(in_frame.boxes)
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
    return detections


def _given_rotated(path: Path, source: Source, score_range: tuple[float, float] | None) -> list[Detections]:
    rotated = read_rotated_labels(path) if path.is_dir() or is_rotated(path) else read_rotated_detections(path)
    images = source.images if isinstance(source, ImageFolder) else ()
    if not images:
        raise RequestError(f"{path}: rotated boxes name images; expected a folder of images, got {source.name}")
    frames = {name: index for index, image in enumerate(images) for name in (image.name, image.stem)}
    strangers = [name for name in rotated if name not in frames]
    if strangers:
        raise RequestError(
            f"{path}: expected boxes of the {len(images)} images of {source.name}, got some of {strangers[0]}"
        )
    low, high = score_range or (-np.inf, np.inf)
    result = [Detections.empty()] * len(images)
    for name, labelled in rotated.items():
        outside = labelled.scores[~((labelled.scores >= low) & (labelled.scores <= high))]
        if len(outside):
            raise RequestError(f"{path}: {name}: expected scores from {low:g} to {high:g}, got {outside[0]:g}")
        result[frames[name]] = turned_detections(labelled)
    return result


def upright_crops(image: ImageArray, rotated: FloatArray, height: int, width: int) -> ImageArray:
    """``(N, height, width, 3)`` crops of ``(N, 5)`` rotated boxes, heads up, stretched to the crop.

    The image is ``(H, W, 3)`` uint8; outside of it its border is repeated. Boxes are as `person_model` has them.
    """
    crops = np.empty((len(rotated), height, width, 3), dtype=np.uint8)
    for crop, matrix, scale in zip(crops, *_maps(rotated, height, width), strict=True):
        _sample(image, matrix, int(scale), crop)
    return crops


def _maps(rotated: FloatArray, height: int, width: int) -> tuple[FloatArray, FloatArray]:
    """``(N, 2, 3)`` from pixel centres of the crop to those of the image, and ``(N,)`` how much finer to sample."""
    scale = rotated[:, 2:4] / [width, height]
    finer = np.maximum(np.ceil(scale.max(axis=1) / COARSEST), 1)
    step = scale / finer[:, None]
    cos, sin = np.cos(rotated[:, 4]), np.sin(rotated[:, 4])
    matrix = np.empty((len(rotated), 2, 3))
    matrix[:, 0, 0], matrix[:, 0, 1] = cos * step[:, 0], -sin * step[:, 1]
    matrix[:, 1, 0], matrix[:, 1, 1] = sin * step[:, 0], cos * step[:, 1]
    middle = np.stack([width * finer, height * finer], axis=1) / 2 - 0.5
    matrix[:, :, 2] = rotated[:, :2] - 0.5 - np.einsum("nij,nj->ni", matrix[:, :, :2], middle)
    return matrix, finer


def _sample(image: ImageArray, matrix: FloatArray, finer: int, crop: ImageArray) -> None:
    height, width = crop.shape[:2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (width * finer, height * finer)
    if finer == 1:
        cv2.warpAffine(image, matrix, size, dst=crop, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return
    fine = cv2.warpAffine(image, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    cv2.resize(fine, (width, height), dst=crop, interpolation=cv2.INTER_AREA)
