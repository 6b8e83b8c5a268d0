"""Small things put into a large picture: each cluster of things that overlap is composed in a window of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.render import scene
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Float32, RayCamera, extents
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

# Standard deviation of the blur of shadows, pixels.
SOFTNESS = 1.0


@dataclass(frozen=True)
class _Window:
    """A part of a camera's image as a camera of its own."""

    camera: RayCamera
    left: int
    top: int
    width: int
    height: int

    @property
    def position(self) -> FloatArray:
        return self.camera.position

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        pixels, depth = self.camera.project(points)
        return pixels - [self.left, self.top], depth

    def rays(self, pixels: NDArray[Any]) -> NDArray[Any]:
        return self.camera.rays(pixels + np.array([self.left, self.top], dtype=pixels.dtype))


def draw_things(
    image: ImageArray, things: list[scene.Thing], camera: PinholeCamera, light: Light, samples: int
) -> list[scene.Sighting | None]:
    """Draw ``things`` and their shadows into ``image``, and return what is seen of each (None: nothing).

    Args:
        image: ``(H, W, 3)`` uint8, light after gamma 2; changed in place.
        things: to be drawn.
        camera: of the picture.
        light: of the scene.
        samples: rays along each side of a pixel.
    """
    _darken(image, things, camera, light)
    rects = [extents(thing.solids, camera) for thing in things]
    rects = [np.concatenate([r[:, :2].min(axis=0), r[:, 2:].max(axis=0)]) for r in rects]

    def below(rows: slice, columns: slice) -> scene.Picture:
        return scene.empty_picture(np.square(image[rows, columns].astype(np.float32) * np.float32(1 / 255)), samples)

    return draw_clusters(image, things, np.array(rects).reshape(-1, 4), camera, light, below)


def draw_clusters(
    image: ImageArray,
    things: list[scene.Thing],
    rects: FloatArray,
    camera: RayCamera,
    light: Light,
    below: Callable[[slice, slice], scene.Picture],
    exposure: float = 1.0,
) -> list[scene.Sighting | None]:
    """Draw ``things`` into ``image``, cluster by cluster, and return what is seen of each (None: nothing).

    Args:
        image: ``(H, W, 3)`` uint8, light after gamma 2; changed in place.
        things: to be drawn.
        rects: ``(N, 4)`` pixels that hold each of them; NaN for what is not drawn.
        camera: of the picture.
        light: of the scene.
        below: gives what is behind the things in rows and columns of the picture.
        exposure: factor from the scene's light to that of the image.
    """
    sightings: list[scene.Sighting | None] = [None] * len(things)
    for (x1, y1, x2, y2), members in clusters(rects, camera.width, camera.height):
        rows, columns = slice(y1, y2), slice(x1, x2)
        window: RayCamera = _Window(camera, x1, y1, x2 - x1, y2 - y1)
        if isinstance(camera, PinholeCamera):
            middle = camera.principal_point - np.array([x1, y1])
            window = replace(camera, width=x2 - x1, height=y2 - y1, principal_point=middle)
        picture, visible = scene.compose(below(rows, columns), [things[i] for i in members], window, light)
        image[rows, columns] = encoded(picture.colour, exposure)
        for i, sighting in zip(members, visible, strict=True):
            if sighting is not None:
                sightings[i] = scene.Sighting(sighting.box + np.array([x1, y1, x1, y1]), sighting.visibility)
    return sightings


def encoded(colour: Float32, exposure: float = 1.0) -> ImageArray:
    """Linear light ``(H, W, 3)`` times ``exposure`` as an image with gamma 2."""
    return np.asarray(255 * np.sqrt(np.clip(colour * np.float32(exposure), 0, 1)) + 0.5).astype(np.uint8)


def _darken(image: ImageArray, things: list[scene.Thing], camera: PinholeCamera, light: Light) -> None:
    up = light.direction[2] * light.sun
    share = np.float32((up / np.maximum(up + light.sky, 1e-6)).mean())
    sun, under = scene.both_shadows(things, camera, light, SOFTNESS)
    kept = np.sqrt((1 - share * sun) * (1 - np.float32(scene.OCCLUSION) * under))
    rows = np.flatnonzero(kept.min(axis=1) < 0.999)
    if len(rows):
        part = slice(int(rows[0]), int(rows[-1]) + 1)
        factor = cv2.merge([kept[part]] * 3)
        image[part] = cv2.multiply(image[part], factor, dtype=cv2.CV_8U)


def clusters(rects: FloatArray, width: int, height: int) -> list[tuple[tuple[int, int, int, int], IntArray]]:
    """Windows x1, y1, x2, y2 within the image, none touching another, and the rectangles ``(N, 4)`` each holds.

    A window is as large as what it holds, also where that leaves the image. Rectangles outside the image or with a
    NaN are in none.
    """
    size = np.array([width, height])
    with np.errstate(invalid="ignore"):
        visible = (rects[:, :2] < size).all(axis=1) & (rects[:, 2:] > 0).all(axis=1)
    groups = [(_inside(rects[i], width, height), [int(i)]) for i in np.flatnonzero(visible)]
    before = 0
    while len(groups) != before:
        before, apart = len(groups), list[tuple[FloatArray, list[int]]]()
        for window, members in groups:
            for k, (other, theirs) in enumerate(apart):
                if (window[:2] < other[2:]).all() and (other[:2] < window[2:]).all():
                    both = np.concatenate([np.minimum(window[:2], other[:2]), np.maximum(window[2:], other[2:])])
                    apart[k] = (both, theirs + members)
                    break
            else:
                apart.append((window, members))
        groups = apart
    return [((int(w[0]), int(w[1]), int(w[2]), int(w[3])), np.array(m)) for w, m in groups]


def _inside(rect: FloatArray, width: int, height: int) -> FloatArray:
    """Whole pixels of the image about ``rect``, moved inward where it leaves the image."""
    limit = np.array([width, height])
    low, high = np.floor(rect[:2]) - 1, np.ceil(rect[2:]) + 1
    size = np.minimum(high - low, limit)
    low = np.clip(low, 0, limit - size)
    return np.concatenate([low, low + size])
