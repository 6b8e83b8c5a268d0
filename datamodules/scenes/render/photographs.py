"""Photographs without people about generated ones: textures on the ground, whole views, and things cut out."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.render.composing import Thing
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Float32, Surface, across, along, boxes
from tsuiseki.datamodules.scenes.render.tracing import Layer, RayCamera, ray_grid, tight
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

# Opacity of 255 from which a pixel of a cut-out belongs to the thing.
OPAQUE = 128
# Width and height that the picture of a surface is brought to, texels.
_SIDE = 512
# Folders of photographs.
_KINDS = ("surfaces", "views", "things")
# Names of image files end like this.
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

    def _any(self, kind: str, rng: np.random.Generator) -> Path:
        return self.paths[kind][int(rng.integers(len(self.paths[kind])))]

    def covered(self, rng: np.random.Generator, picture: Float32, camera: RayCamera) -> Float32:
        """``picture`` ``(H, W, 3)``, linear light, with the structure of a random surface on its ground."""
        if not self.paths["surfaces"]:
            return picture
        levels = _pyramid(self._any("surfaces", rng))
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
        return _read(self._any("surfaces", rng))

    def thing(self, rng: np.random.Generator) -> ImageArray:
        """``(h, w, 4)`` uint8 RGBA, tight about what is opaque: a random thing, of which there must be one."""
        return _read_thing(self._any("things", rng))

    def view(self, rng: np.random.Generator, width: int, height: int) -> Float32 | None:
        """``(H, W, 3)`` linear light: a random part of a random view, or None where there are no views."""
        if not self.paths["views"]:
            return None
        image = _read(self._any("views", rng))
        h, w = image.shape[:2]
        shrink = min(w / width, h / height) * float(rng.uniform(0.35, 1.0))
        cut_w, cut_h = max(int(width * shrink), 1), max(int(height * shrink), 1)
        left, top = int(rng.integers(w - cut_w + 1)), int(rng.integers(h - cut_h + 1))
        part = image[top : top + cut_h, left : left + cut_w]
        if rng.random() < 0.5:
            part = part[:, ::-1]
        resized = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA if shrink > 1 else cv2.INTER_CUBIC)
        return np.asarray(np.square(resized.astype(np.float32) / np.float32(255)))


def shrunk(image: NDArray[Any], factor: float) -> ImageArray:
    """``image`` at ``factor`` of its size where that is below 1."""
    if factor >= 1:
        return np.asarray(image, np.uint8)
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), np.uint8)


@lru_cache(maxsize=600)
def _read(path: Path) -> ImageArray:
    image = decoded_image(path)
    if image is None:
        raise RequestError(f"expected a photograph at {path}, got something that cannot be decoded; remove it")
    return shrunk(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), 1400 / max(image.shape[:2]))


@lru_cache(maxsize=600)
def _read_thing(path: Path) -> ImageArray:
    image = decoded_image(path, cv2.IMREAD_UNCHANGED)
    if image is None or image.shape[2:] != (4,) or image.dtype != np.uint8 or not (image[..., 3] >= OPAQUE).any():
        raise RequestError(f"expected a cut-out thing at {path}, 8-bit colours with opacity, got none; remove it")
    x1, y1, x2, y2 = tight(image[..., 3] >= OPAQUE)
    small = shrunk(image[y1:y2, x1:x2], 512 / max(x2 - x1, y2 - y1))
    return np.ascontiguousarray(small[..., [2, 1, 0, 3]])


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


# Texels that a wall's picture has for each metre.
_FINE = 48
# Most texels along the longer side of a wall's picture.
_LARGEST = 1024


class Facade(Thing):
    """A flat picture that stands upright on the ground.

    Attributes:
        place: ``(2,)`` metres, the middle of its lower edge.
        angle: of its lower edge against the x axis, radians.
        size: width and height, metres.
        picture: ``(h, w, 3)`` uint8 RGB.
    """

    def __init__(self, place: FloatArray, angle: float, size: tuple[float, float], picture: ImageArray) -> None:
        wide, high = size
        middle, half = np.array([[*place, high / 2]]), np.array([[wide / 2, 0.05, high / 2]])
        super().__init__(boxes(middle, half, np.array([angle]), [Surface((0.5, 0.5, 0.5))]))
        self.place, self.angle, self.size, self.picture = place, angle, size, picture

    def trace(self, camera: RayCamera, samples: int) -> Layer | None:
        foot, aside, up = np.array([*self.place, 0.0]), along(self.angle), np.array([0.0, 0.0, self.size[1]])
        left, right = (foot + side * self.size[0] / 2 * aside for side in (-1, 1))
        corners, depth = camera.project(np.stack([left + up, right + up, right, left]))
        if (depth < 0.5).any() or np.abs(corners).max() > 40 * camera.width:
            return None
        corners = corners * samples
        width, height = camera.width * samples, camera.height * samples
        x1, y1 = np.clip(np.floor(corners.min(axis=0)), 0, [width, height]).astype(int)
        x2, y2 = np.clip(np.ceil(corners.max(axis=0)), 0, [width, height]).astype(int)
        if x1 >= x2 or y1 >= y2:
            return None
        picture = shrunk(self.picture, 1.2 * float(np.ptp(corners, axis=0).max()) / max(self.picture.shape[:2]))
        h, w = picture.shape[:2]
        source = np.array([[0, 0], [w, 0], [w, h], [0, h]], dtype=np.float32)
        turn = cv2.getPerspectiveTransform(source, (corners - [x1, y1]).astype(np.float32))
        turned = cv2.warpPerspective(picture, turn, (x2 - x1, y2 - y1), borderMode=cv2.BORDER_REPLICATE)
        there = cv2.warpPerspective(np.ones((h, w), np.uint8), turn, (x2 - x1, y2 - y1), flags=cv2.INTER_NEAREST)
        normal = across(self.angle)
        rays = ray_grid(camera, samples, x1, y1, x2, y2)
        towards = np.tensordot(normal.astype(np.float32), rays, axes=1)
        away = np.float32(normal @ (foot - camera.position)) / np.where(np.abs(towards) < 1e-6, np.inf, towards)
        distance = np.where((there > 0) & (away > 0), away, np.float32(np.inf)).astype(np.float32)
        if not np.isfinite(distance).any():
            return None
        return Layer(x1, y1, distance, np.zeros(distance.shape, np.int16), turned)

    def shade(self, layer: Layer, visible: BoolArray, camera: RayCamera, samples: int, light: Light) -> Float32:
        del samples
        normal = across(self.angle)[:2]
        if normal @ (camera.position[:2] - self.place) < 0:
            normal = -normal
        facing = max(float(normal @ light.direction[:2]), 0.0)
        albedo = np.square(layer.picture[visible].astype(np.float32) / np.float32(255))
        return np.asarray(albedo * (facing * light.sun + (light.sky + light.ground) / 2), dtype=np.float32)


def random_facades(
    rng: np.random.Generator, photographs: Photographs, count: int, spots: FloatArray, reach: float
) -> list[Thing]:
    """Up to ``count`` walls and stalls along +y, walls behind most of the ``spots`` ``(N, 2)`` where people stand.

    Args:
        rng: draws everything.
        photographs: whose surfaces cover them.
        count: at most.
        spots: kept clear.
        reach: metres to the farthest spot.
    """
    things: list[Thing] = []
    for _ in range(count if photographs.paths["surfaces"] else 0):
        wall = rng.random() < 0.65
        distance = reach * float(rng.uniform(0.75, 1.7) if wall else rng.uniform(0.3, 1.1))
        place = np.array([rng.uniform(-0.7, 0.7) * distance, distance])
        wide, high = rng.uniform([4.0, 2.5], [24.0, 11.0]) if wall else rng.uniform([0.7, 1.2], [3.0, 2.8])
        angle = float(rng.normal(0, 0.35)) if rng.random() < 0.75 else float(rng.uniform(0, np.pi))
        if len(spots) and np.linalg.norm(spots - place, axis=1).min() < 0.5 + 0.5 * min(wide, 4.0):
            continue
        things.append(Facade(place, angle, (wide, high), _picture(rng, photographs, wide, high)))
    return things


def _picture(rng: np.random.Generator, photographs: Photographs, wide: float, high: float) -> ImageArray:
    """A wall of one surface, with parts of others on it."""
    fine = min(_FINE, _LARGEST / max(wide, high))
    w, h = max(int(wide * fine), 8), max(int(high * fine), 8)
    side = max(int(float(rng.uniform(1.0, 5.0)) * fine), 4)
    tile = cv2.resize(photographs.surface(rng), (side, side), interpolation=cv2.INTER_AREA)
    wall = np.tile(tile, (h // side + 1, w // side + 1, 1))[:h, :w].copy()
    step = max(int(float(rng.uniform(1.2, 4.0)) * fine), 6)
    for kind in range(int(rng.integers(0, 3))):
        # Windows in rows, or single doors and posters.
        part = photographs.surface(rng)
        pw, ph = max(int(step * rng.uniform(0.25, 0.7)), 3), max(int(step * rng.uniform(0.3, 0.9)), 3)
        small = cv2.resize(part, (pw, ph), interpolation=cv2.INTER_AREA)
        part = np.clip(small * rng.uniform(0.3, 1.4), 0, 255).astype(np.uint8)
        lefts = range(int(rng.integers(step)), w - pw, step) if kind == 0 else [int(rng.integers(max(w - pw, 1)))]
        tops = range(int(rng.integers(step)), h - ph, step) if kind == 0 else [max(h - ph - int(rng.integers(step)), 0)]
        for top in tops:
            for left in lefts:
                wall[top : top + ph, left : left + pw] = part[: h - top, : w - left]
    return np.asarray(wall, np.uint8)
