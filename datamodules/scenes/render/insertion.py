"""Small things put into a large picture: each cluster of things that overlap is composed in a window of its own."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.render.ground import dark_ground
from tsuiseki.datamodules.scenes.render.scene import Picture, Sighting, Thing, compose, empty_picture
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import extents
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

# Standard deviation of the blur of shadows, pixels.
SOFTNESS = 1.0


def draw_things(
    image: ImageArray, things: list[Thing], camera: PinholeCamera, light: Light, samples: int
) -> list[Sighting | None]:
    """Draw ``things`` and their shadows into ``image``, and return what is seen of each (None: nothing).

    Args:
        image: ``(H, W, 3)`` uint8, light after gamma 2; changed in place.
        things: to be drawn.
        camera: of the picture.
        light: of the scene.
        samples: rays along each side of a pixel.
    """
    _darken(image, things, camera, light)
    rects = np.array([_rectangle(thing, camera) for thing in things]).reshape(-1, 4)
    sightings: list[Sighting | None] = [None] * len(things)
    for window, members in clusters(rects, camera.width, camera.height):
        x1, y1, x2, y2 = window
        part = image[y1:y2, x1:x2]
        below = np.square(part.astype(np.float32) * np.float32(1 / 255))
        shifted = replace(
            camera, width=x2 - x1, height=y2 - y1, principal_point=camera.principal_point - np.array([x1, y1])
        )
        picture, seen = compose(empty_picture(below, samples), [things[i] for i in members], shifted, light)
        part[:] = _encoded(picture)
        for i, sighting in zip(members, seen, strict=True):
            if sighting is not None:
                sightings[i] = Sighting(sighting.box + np.array([x1, y1, x1, y1]), sighting.visibility)
    return sightings


def _encoded(picture: Picture) -> ImageArray:
    return np.asarray(255 * np.sqrt(np.clip(picture.colour, 0, 1)) + 0.5).astype(np.uint8)


def _darken(image: ImageArray, things: list[Thing], camera: PinholeCamera, light: Light) -> None:
    kept = np.sqrt(dark_ground(things, camera, light, SOFTNESS))
    rows = np.flatnonzero(kept.min(axis=1) < 0.999)
    if len(rows):
        part = slice(int(rows[0]), int(rows[-1]) + 1)
        factor = cv2.merge([kept[part]] * 3)
        image[part] = cv2.multiply(image[part], factor, dtype=cv2.CV_8U)


def _rectangle(thing: Thing, camera: PinholeCamera) -> FloatArray:
    """``(4,)`` pixels that surely hold ``thing``; NaN where it is not wholly before the camera."""
    rects = extents(thing.solids, camera)
    return np.concatenate([rects[:, :2].min(axis=0), rects[:, 2:].max(axis=0)])


def clusters(rects: FloatArray, width: int, height: int) -> list[tuple[tuple[int, int, int, int], IntArray]]:
    """Windows x1, y1, x2, y2 within the image, none touching another, and the rectangles ``(N, 4)`` each holds.

    A window is as large as what it holds, also where that leaves the image. Rectangles outside the image or with a
    NaN are in none.
    """
    size = np.array([width, height])
    with np.errstate(invalid="ignore"):
        seen = (rects[:, :2] < size).all(axis=1) & (rects[:, 2:] > 0).all(axis=1)
    groups = [(_inside(rects[i], width, height), [int(i)]) for i in np.flatnonzero(seen)]
    merged = True
    while merged:
        merged = False
        result: list[tuple[FloatArray, list[int]]] = []
        for window, members in groups:
            for k, (other, theirs) in enumerate(result):
                if (window[:2] < other[2:]).all() and (other[:2] < window[2:]).all():
                    both = np.concatenate([np.minimum(window[:2], other[:2]), np.maximum(window[2:], other[2:])])
                    result[k] = (both, theirs + members)
                    merged = True
                    break
            else:
                result.append((window, members))
        groups = result
    return [((int(w[0]), int(w[1]), int(w[2]), int(w[3])), np.array(m)) for w, m in groups]


def _inside(rect: FloatArray, width: int, height: int) -> FloatArray:
    """Whole pixels of the image about ``rect``, moved inward where it leaves the image."""
    limit = np.array([width, height])
    low, high = np.floor(rect[:2]) - 1, np.ceil(rect[2:]) + 1
    size = np.minimum(high - low, limit)
    low = np.clip(low, 0, limit - size)
    return np.concatenate([low, low + size])
