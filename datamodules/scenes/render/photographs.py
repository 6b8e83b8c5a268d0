"""Photographs without people about generated ones: textures on the ground, whole views, and things cut out."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.render.raster import RayCamera, ray_grid
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import ImageArray

# Opacity from which a pixel of a cut-out belongs to the thing.
OPAQUE = 128
_SIDE = 512
_KINDS = ("surfaces", "views", "things")
_SUFFIXES = {".jpg", ".jpeg", ".png", ".webp"}


class Photographs:
    """A folder of photographs without people, any of three kinds.

    ``surfaces/`` are seen from straight above or before, ``views/`` as a camera sees a place, and ``things/`` are cut
    out: what is transparent does not belong to them.

    Raises:
        RequestError: all are empty.
    """

    def __init__(self, folder: str | Path) -> None:
        self.paths = {
            kind: sorted(p for p in (Path(folder) / kind).rglob("*") if p.suffix.lower() in _SUFFIXES)
            for kind in _KINDS
        }
        if not any(self.paths.values()):
            raise RequestError(
                f"expected photographs in surfaces, views or things of {folder}, got none; fill one of the folders"
            )

    def covered(self, rng: np.random.Generator, picture: Float32, camera: RayCamera) -> Float32:
        """``picture`` ``(H, W, 3)``, linear light, with the structure of a random surface on its ground."""
        if not self.paths["surfaces"]:
            return picture
        levels = _pyramid(self.paths["surfaces"][int(rng.integers(len(self.paths["surfaces"])))])
        rays = ray_grid(camera, 1, 0, 0, camera.width, camera.height)
        down = np.maximum(-rays[2], np.float32(1e-3))
        distance = np.float32(camera.position[2]) / down
        # Metres that the picture of the surface covers.
        size = float(np.exp(rng.uniform(np.log(0.8), np.log(8.0))))
        turn, strength = float(rng.uniform(0, 2 * np.pi)), np.float32(rng.uniform(0.4, 1.0))
        x = (rays[0] * np.cos(turn) - rays[1] * np.sin(turn)) * distance / size
        y = (rays[0] * np.sin(turn) + rays[1] * np.cos(turn)) * distance / size
        angle = float(np.sqrt(np.square(rays[:, 0, 1] - rays[:, 0, 0]).sum()))
        texels = distance * angle * np.sqrt(distance / float(camera.position[2])) / size * _SIDE
        level = np.clip(np.round(np.log2(np.maximum(texels, 1))), 0, len(levels) - 1).astype(np.int8)
        factor = np.ones_like(picture)
        for n, texture in enumerate(levels):
            at = (level == n) & (rays[2] < -1e-3)
            side = len(texture)
            row, column = ((v[at] % 1 * side).astype(np.int64) % side for v in (y, x))
            factor[at] = texture[row, column]
        return np.asarray(picture * factor**strength, dtype=np.float32)

    def surface(self, rng: np.random.Generator) -> ImageArray:
        """``(h, w, 3)`` uint8 RGB: a random surface, of which there must be one."""
        return _read(self.paths["surfaces"][int(rng.integers(len(self.paths["surfaces"])))])

    def thing(self, rng: np.random.Generator) -> ImageArray:
        """``(h, w, 4)`` uint8 RGBA, tight about what is opaque: a random thing, of which there must be one."""
        return _read_thing(self.paths["things"][int(rng.integers(len(self.paths["things"])))])

    def view(self, rng: np.random.Generator, width: int, height: int) -> Float32 | None:
        """``(H, W, 3)`` linear light: a random part of a random view, or None where there are no views."""
        if not self.paths["views"]:
            return None
        image = _read(self.paths["views"][int(rng.integers(len(self.paths["views"])))])
        h, w = image.shape[:2]
        shrink = min(w / width, h / height) * float(rng.uniform(0.35, 1.0))
        cut_w, cut_h = max(int(width * shrink), 1), max(int(height * shrink), 1)
        left, top = int(rng.integers(w - cut_w + 1)), int(rng.integers(h - cut_h + 1))
        part = image[top : top + cut_h, left : left + cut_w]
        if rng.random() < 0.5:
            part = part[:, ::-1]
        resized = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA if shrink > 1 else cv2.INTER_CUBIC)
        return np.asarray(np.square(resized.astype(np.float32) / np.float32(255)))


@lru_cache(maxsize=600)
def _read(path: Path) -> ImageArray:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise RequestError(f"expected a photograph at {path}, got something that cannot be decoded; remove it")
    shrink = 1400 / max(image.shape[:2])
    return np.asarray(
        cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA) if shrink < 1 else image
    )


@lru_cache(maxsize=600)
def _read_thing(path: Path) -> ImageArray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape[2:] != (4,) or image.dtype != np.uint8 or not (image[..., 3] >= OPAQUE).any():
        raise RequestError(f"expected a cut-out thing at {path}, 8-bit colours with opacity, got none; remove it")
    rows, columns = (np.flatnonzero((image[..., 3] >= OPAQUE).any(axis=axis)) for axis in (1, 0))
    tight = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    shrink = min(512 / max(tight.shape[:2]), 1.0)
    tight = cv2.resize(tight, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA) if shrink < 1 else tight
    return np.ascontiguousarray(tight[..., [2, 1, 0, 3]])


@lru_cache(maxsize=256)
def _pyramid(path: Path) -> list[Float32]:
    """The surface relative to its own mean, linear light, at falling sizes down to one texel."""
    image = cv2.resize(_read(path), (_SIDE, _SIDE), interpolation=cv2.INTER_AREA)
    linear = np.square(image.astype(np.float32) / np.float32(255)) + np.float32(0.01)
    linear /= linear.mean(axis=(0, 1)) ** np.float32(0.7) * linear.mean() ** np.float32(0.3)
    levels = [np.clip(linear, 0, 4)]
    while len(levels[-1]) > 1:
        half = len(levels[-1]) // 2
        levels.append(cv2.resize(levels[-1], (half, half), interpolation=cv2.INTER_AREA).reshape(half, half, 3))
    return levels
