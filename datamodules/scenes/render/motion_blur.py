"""What moves while the shutter is open, and smears: people, and the picture as a whole where the camera does."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.render.scene import Picture, Sighting, by_pixel
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.types import FloatArray

# Shutters from 1/250 to 1/12 second, seconds; the longer ones smear.
_SHUTTER = (1 / 250, 1 / 12)
# Most that anything moves meanwhile, pixels of a picture of 640.
_FARTHEST = 10.0
# Metres a second of people: from who stands to who runs a little.
_SPEED = (0.0, 2.5)
# Pixels a second of the whole picture, of a picture of 640: from a mast in the wind to a bus in a bend.
_CAMERA = (5.0, 250.0)
# Everybody bobs a little up and down.
_UPWARD = 0.12
_HEIGHT = 1.7
# Less is no blur, pixels.
_LEAST = 0.5


def smeared(rng: np.random.Generator, picture: Picture, sightings: list[Sighting | None]) -> Float32:
    """The colours of ``picture`` as a shutter of a random time sees them.

    Args:
        rng: draws the time, how fast everybody walks, and whether and how fast the camera turns.
        picture: that things were composed into.
        sightings: of the people in it, the first of the things.

    Returns:
        ``(H, W, 3)`` linear light.
    """
    shutter = float(np.exp(rng.uniform(*np.log(_SHUTTER))))
    large = picture.colour.shape[1] / 640
    tall = np.array([0.0 if s is None else s.box[3] - s.box[1] for s in sightings])
    heading, speed = rng.uniform(0, 2 * np.pi, len(tall)), rng.uniform(*_SPEED, len(tall))
    metres = shutter * speed[:, None] * np.stack([np.cos(heading), _UPWARD * np.sin(heading)], axis=1)
    shifts = np.clip(metres * tall[:, None] / _HEIGHT, -_FARTHEST * large, _FARTHEST * large)
    colour = move_people(picture, sightings, shifts)
    if rng.random() < 0.5:
        return colour
    pace = min(shutter * float(np.exp(rng.uniform(*np.log(_CAMERA)))), _FARTHEST) * large
    # Cameras are turned, and carried past, more than they are nodded.
    angle = float(rng.normal(0, 0.25)) if rng.random() < 0.7 else float(rng.uniform(0, np.pi))
    return move_camera(colour, pace * np.array([np.cos(angle), np.sin(angle)]))


def move_camera(colour: Float32, shift: FloatArray) -> Float32:
    """``(H, W, 3)`` light smeared along ``shift`` ``(2,)`` pixels."""
    if np.linalg.norm(shift) < _LEAST:
        return colour
    return np.asarray(cv2.filter2D(colour, -1, line_kernel(shift), borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def move_people(picture: Picture, sightings: list[Sighting | None], shifts: FloatArray) -> Float32:
    """The colours of ``picture`` with each person smeared along a line ``(N, 2)`` pixels, over what is farther away.

    What comes to light behind somebody is guessed from what is seen beside him. At silhouettes, where pixels hold both,
    light is wrong by some hundredths.
    """
    colour, height, width = picture.colour.copy(), *picture.colour.shape[:2]
    windows = []
    for index, (sighting, shift) in enumerate(zip(sightings, shifts, strict=True)):
        if sighting is None or np.linalg.norm(shift) < _LEAST:
            continue
        reach = np.tile(np.abs(shift) + 2, 2) * [-1, -1, 1, 1]
        window = _Window(*clip_boxes(sighting.box + reach, width, height).round().astype(int).tolist())
        fine = window.fine(picture.samples)
        own = picture.owner[fine] == index
        if own.any():
            windows.append((float(picture.distance[fine][own].min()), index, window, own))
    # Who is nearer smears over whoever is behind, smeared or not.
    for nearest, index, window, own in sorted(windows, key=lambda w: -w[0]):
        at, fine, n = window.fine(1), window.fine(picture.samples), picture.samples
        before = colour[at]
        nearer = by_pixel((~own & (picture.distance[fine] < nearest)).astype(np.float32), n)[..., None]
        after = _moved(before, by_pixel(own.astype(np.float32), n)[..., None], line_kernel(shifts[index]))
        colour[at] = nearer * before + (1 - nearer) * after
    return colour


@dataclass(frozen=True)
class _Window:
    """Whole pixels from ``x1``, ``y1`` up to, not including, ``x2``, ``y2``."""

    x1: int
    y1: int
    x2: int
    y2: int

    def fine(self, samples: int) -> tuple[slice, slice]:
        """Rows and columns on the grid of ``samples`` subpixels."""
        return slice(self.y1 * samples, self.y2 * samples), slice(self.x1 * samples, self.x2 * samples)


def _moved(before: Float32, share: Float32, kernel: Float32) -> Float32:
    """``before`` ``(h, w, 3)`` with what covers ``share`` ``(h, w, 1)`` of it smeared."""
    person, rest, uncovered = (_along(kernel, part) for part in (share * before, (1 - share) * before, 1 - share))
    return person + np.where(share < 0.5, uncovered * before, rest)


def _along(kernel: Float32, values: Float32) -> Float32:
    filtered = cv2.filter2D(values, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(filtered, dtype=np.float32).reshape(values.shape)


def line_kernel(shift: FloatArray) -> Float32:
    """Odd square weights of sum 1 along a line of ``shift`` ``(2,)`` pixels about the middle.

    >>> line_kernel(np.array([2.0, 0.0]))[1].round(2).tolist()
    [0.25, 0.5, 0.25]
    """
    half = int(np.ceil(np.abs(shift).max() / 2))
    steps = (np.arange(n := 16 * (2 * half + 1)) + 0.5) / n - 0.5
    points = half + steps[:, None] * shift
    corner = np.floor(points).astype(int)
    part = points - corner
    kernel = np.zeros((2 * half + 2, 2 * half + 2))
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
        np.add.at(kernel, (corner[:, 1] + dy, corner[:, 0] + dx), weight)
    kernel = kernel[: 2 * half + 1, : 2 * half + 1]
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)
