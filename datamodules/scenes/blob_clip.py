"""Coloured objects that move over natural clutter, entering, leaving and crossing, with exact truth.

Objects differ in purity: the share of their pixels that has the colour, so that the likelihood of a region differs
between targets however well a box fits.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes.clip import Clip, ClipSettings, FrameTruth, Moment, Span, ground_truth
from tsuiseki.datamodules.scenes.render.tracing import overlap
from tsuiseki.tracking.bounds import SETTINGS, PositiveShare
from tsuiseki.tracking.geometry import areas, intersections
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray
from tsuiseki.tracking.types.labels import GroundTruth

Colour = Literal["red", "orange", "yellow", "green", "cyan", "blue", "magenta"]
# Hue of each colour, degrees.
HUES: dict[Colour, float] = {
    "red": 0.0, "orange": 28.0, "yellow": 55.0, "green": 120.0, "cyan": 182.0, "blue": 230.0, "magenta": 300.0
}  # fmt: skip
# Browns, greys, dull greens: hue in degrees, saturation, value.
NATURAL = np.array([[30, 0.35, 0.45], [42, 0.3, 0.6], [85, 0.3, 0.4], [100, 0.4, 0.3], [25, 0.5, 0.3], [210, 0.1, 0.6]])


@settings_dataclass(frozen=True, config=SETTINGS)
class BlobSceneSettings(ClipSettings):
    """A clip.

    Attributes:
        objects: how many appear in all.
        colour: theirs, one of `HUES`.
        purity: least and greatest share of an object's pixels that has the colour; spread evenly over the objects.
        size: least and greatest side, pixels.
        speed: mean, pixels a frame.
        clutter: patches of the same colour, smaller than objects, in the background.
        clutter_reach: their greatest radius, as a share of the least side of an object.
        flashes: patches of the same colour and sizes that show in one frame only, in each frame.
        enter: share of the objects that enter after the start.
        stay: objects turn back at the border instead of leaving.
    """

    objects: PositiveInt = 5
    colour: Colour = "red"
    purity: Span[PositiveShare] = (0.45, 0.95)
    size: Span[Annotated[float, Field(ge=4)]] = (26.0, 44.0)
    speed: float = 3.0
    clutter: NonNegativeInt = 12
    clutter_reach: PositiveShare = 1 / 6
    flashes: NonNegativeInt = 0
    enter: float = 0.4
    stay: bool = False


class BlobClip(Clip[FloatArray]):
    """The clip of a seed. Nearer objects (later ones) cover farther ones.

    Attributes:
        purity: ``(K,)`` of the objects.
    """

    def __init__(self, settings: BlobSceneSettings, seed: int) -> None:
        self.settings, self._rng = settings, (rng := np.random.default_rng(seed))
        count, extent = settings.objects, [settings.width, settings.height]
        self.purity = np.array([settings.purity[1]])
        if count > 1:
            self.purity = rng.permutation(np.linspace(*settings.purity, count))
        sizes = np.round(rng.uniform(*settings.size, (count, 2)))
        late = np.arange(count) < round(settings.enter * count)
        start = np.where(late, rng.integers(1, max(settings.frames // 2, 2), count), 0)
        self._boxes = boxes = np.full((settings.frames, count, 4), np.nan)
        for k, half in enumerate(sizes / 2):
            centres = _path(settings, sizes[k], bool(late[k]), settings.frames - int(start[k]), rng)
            boxes[start[k] :, k] = np.concatenate([centres - half, centres + half], axis=1)
        boxes[(np.minimum(boxes[..., 2:], extent) - np.maximum(boxes[..., :2], 0)).min(axis=-1) < 3] = np.nan
        hue = HUES[settings.colour]
        self._objects = [_sprite(size, share, hue, rng) for size, share in zip(sizes, self.purity, strict=True)]
        self._ground = _ground(settings, rng)

    def frames(self) -> Iterator[Moment[FloatArray]]:
        """The truth is the boxes ``(K, 4)`` of a frame, NaN while an object is away."""
        rng = copy.deepcopy(self._rng)
        for boxes in self._boxes:
            image = self._ground.copy()
            _stain_colour(image, self.settings, self.settings.flashes, rng)
            for box, (picture, shape) in zip(boxes, self._objects, strict=True):
                if np.isfinite(box[0]):
                    # Its corner lies at whole pixels.
                    there, part = overlap(image.shape, (round(float(box[1])), round(float(box[0]))), shape.shape)
                    image[there][shape[part]] = picture[part][shape[part]]
            noise = 4.0 * rng.standard_normal(image.shape, dtype=np.float32)
            yield (np.clip(image + noise, 0, 255).astype(np.uint8),), boxes

    def write_truth(self, folder: Path, name: str, truths: list[FloatArray]) -> None:
        """Write ``gt/gt.txt`` and ``seqinfo.ini``."""
        self.settings.write_info(folder, name, as_ground_truth(np.stack(truths)))


def as_ground_truth(boxes: FloatArray) -> GroundTruth:
    """Labels of boxes ``(T, K, 4)``; visibility is the share that later objects leave uncovered."""
    truths = []
    for now in boxes:
        there = np.flatnonzero(np.isfinite(now[:, 0]))
        covered = np.triu(intersections(now[there, None], now[there][None]), 1).sum(axis=1)
        truths.append(FrameTruth(there + 1, now[there], np.maximum(1 - covered / areas(now[there]), 0)))
    return ground_truth(truths)


def _path(
    settings: BlobSceneSettings, size: FloatArray, late: bool, frames: int, rng: np.random.Generator
) -> FloatArray:
    """Centres ``(frames, 2)``: a smooth way across the image, from its border where the object comes late."""
    extent = np.array([settings.width, settings.height], dtype=np.float64)
    goal = extent * rng.uniform(0.3, 0.7, 2)
    if late:
        place = extent * rng.random(2)
        side = int(rng.integers(2))
        place[side] = -size[side] / 2 if rng.random() < 0.5 else extent[side] + size[side] / 2
    else:
        place = size + (extent - 2 * size) * rng.random(2)
    heading = goal - place
    velocity = settings.speed * rng.uniform(0.7, 1.3) * heading / max(float(np.linalg.norm(heading)), 1.0)
    way = np.empty((frames, 2))
    for index in range(frames):
        way[index] = place
        velocity = velocity + 0.06 * settings.speed * rng.standard_normal(2)
        velocity *= min(1.6 * settings.speed / max(float(np.linalg.norm(velocity)), 1e-9), 1.0)
        place = place + velocity
        if settings.stay:
            out = ((place < size) & (velocity < 0)) | ((place > extent - size) & (velocity > 0))
            velocity = np.where(out, -velocity, velocity)
    return way


def _sprite(size: FloatArray, purity: float, hue: float, rng: np.random.Generator) -> tuple[ImageArray, BoolArray]:
    """A rounded object: cells of 3 pixels, ``purity`` of them in the colour and the others grey or brown."""
    width, height = (int(side) for side in size)
    cells = (-(-height // 3), -(-width // 3))
    number = cells[0] * cells[1]
    pure = rng.permutation(number) < round(purity * number)
    background = NATURAL[rng.integers(len(NATURAL), size=number)] * [1, 0.5, 1.0]
    hues, saturations = (hue + rng.normal(0, 4, number)) % 360, rng.uniform(0.75, 0.95, number)
    object_colours = np.stack([hues, saturations, rng.uniform(0.6, 0.9, number)], axis=1)
    picture = _rgb(np.where(pure[:, None], object_colours, background).reshape(*cells, 3))
    picture = np.repeat(np.repeat(picture, 3, axis=0), 3, axis=1)[:height, :width]
    y, x = np.mgrid[:height, :width]
    round_off = ((x + 0.5) / width * 2 - 1) ** 6 + ((y + 0.5) / height * 2 - 1) ** 6 <= 1.0
    return picture, round_off


def _ground(settings: BlobSceneSettings, rng: np.random.Generator) -> ImageArray:
    """Leaves and stones in natural colours, and small patches of the objects' colour among them."""
    height, width = settings.height, settings.width
    base = np.zeros((height, width, 3), np.float32)
    for octave, strength in ((8, 0.5), (32, 0.3), (128, 0.2)):
        grid = rng.random((octave * height // width + 2, octave + 2, 3)).astype(np.float32)
        base += strength * cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC)
    hsv = np.stack([60 + 60 * base[..., 0], 0.2 + 0.25 * base[..., 1], 0.25 + 0.35 * base[..., 2]], axis=-1)
    image = _rgb(hsv)
    for _ in range(width * height // 900):
        colour = NATURAL[rng.integers(len(NATURAL))] * [1, 1, rng.uniform(0.6, 1.3)]
        _stain(image, np.clip(colour, 0, [360, 1, 1]), rng.uniform(3, 14, 2), rng)
    _stain_colour(image, settings, settings.clutter, rng)
    return cv2.GaussianBlur(image, (0, 0), 0.7).astype(np.uint8)


def _stain_colour(image: ImageArray, settings: BlobSceneSettings, count: int, rng: np.random.Generator) -> None:
    """So many patches of the objects' colour anywhere."""
    for _ in range(count):
        colour = np.array([HUES[settings.colour], rng.uniform(0.5, 0.9), rng.uniform(0.4, 0.8)])
        _stain(image, colour, rng.uniform(1.5, max(settings.size[0] * settings.clutter_reach, 1.5), 2), rng)


def _stain(image: ImageArray, hsv: FloatArray, radii: FloatArray, rng: np.random.Generator) -> None:
    """An ellipse anywhere, drawn into ``image``."""
    centre = (int(rng.integers(image.shape[1])), int(rng.integers(image.shape[0])))
    axes = (max(int(radii[0]), 1), max(int(radii[1]), 1))
    colour = tuple(int(v) for v in _rgb(hsv[None, None])[0, 0])
    cv2.ellipse(image, centre, axes, float(rng.uniform(0, 180)), 0, 360, colour, cv2.FILLED, cv2.LINE_AA)


def _rgb(hsv: FloatArray) -> ImageArray:
    """Hue in degrees, saturation and value in [0, 1] ``(H, W, 3)`` to uint8 RGB."""
    return (255 * cv2.cvtColor(np.ascontiguousarray(hsv, dtype=np.float32), cv2.COLOR_HSV2RGB)).round().astype(np.uint8)
