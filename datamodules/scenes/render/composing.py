"""Puts things into a picture: who hides whom, what is seen of each, and the shadows on the ground.

Small things in a large picture are put into it cluster by cluster: those that overlap, in a window of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.people.outfit import Outfit
from tsuiseki.datamodules.scenes.render import tracing
from tsuiseki.datamodules.scenes.render.shading import Light, shade
from tsuiseki.datamodules.scenes.render.solids import CORNERS, Float32, Solids
from tsuiseki.datamodules.scenes.render.tracing import Layer, RayCamera
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, IntArray

# Share of all light that reaches the ground under a thing less than beside it.
OCCLUSION = 0.3
# Standard deviation of the blur of shadows of small things, pixels.
SOFTNESS = 1.0


class Thing:
    """Solids that belong together, a person's with an outfit. Subclasses show a picture; their solids cast shadows."""

    def __init__(self, solids: Solids, outfit: Outfit | None = None) -> None:
        self.solids, self.outfit = solids, outfit

    def trace(self, camera: RayCamera, samples: int) -> Layer | None:
        """The thing as the camera sees it alone; None where it is not seen."""
        # Only of people it matters how much lies outside the image.
        return tracing.trace(self.solids, camera, samples, 0.0 if self.outfit is None else 1.0)

    def shade(self, layer: Layer, visible: BoolArray, camera: RayCamera, samples: int, light: Light) -> Float32:
        """Linear colours ``(n, 3)`` of the subpixels of its layer where ``visible`` is True, row by row."""
        return shade(layer, visible, self.solids, camera, samples, light, self.outfit)


def drawn_alone(thing: Thing, camera: RayCamera, samples: int, light: Light) -> ImageArray:
    """The thing cut out: ``(h, w, 4)`` uint8 RGBA, straight alpha, soft edges; ``samples`` rays a side of a pixel.

    Raises:
        ValueError: the camera does not see it.
    """
    layer = tracing.trace(thing.solids, camera, samples)
    if layer is None:
        raise ValueError("expected a thing before the camera, got one that it does not see")
    box = tracing.tight(layer.mask) + np.array([layer.left, layer.top] * 2)
    (x1, y1), (x2, y2) = box[:2] // samples, (box[2:] - 1) // samples + 1
    fine = np.zeros(((y2 - y1) * samples, (x2 - x1) * samples, 4), dtype=np.float32)
    rows, columns = np.nonzero(layer.mask)
    y, x = rows + layer.top - y1 * samples, columns + layer.left - x1 * samples
    fine[y, x, :3] = shade(layer, layer.mask, thing.solids, camera, samples, light, thing.outfit)
    fine[y, x, 3] = 1
    # Linear colour times coverage, and coverage, by pixels.
    drawn = fine.reshape(y2 - y1, samples, x2 - x1, samples, 4).mean(axis=(1, 3))
    alpha = drawn[..., 3:]
    colour = np.sqrt(np.clip(drawn[..., :3] / np.maximum(alpha, 1e-6), 0, 1))
    return np.asarray(np.concatenate([colour, alpha], axis=-1) * 255 + 0.5).astype(np.uint8)


@dataclass(frozen=True)
class Sighting:
    """What the picture shows of one thing.

    Attributes:
        box: ``(4,)`` pixels, the extent of the whole silhouette, hidden parts and what leaves the image included.
        visibility: share of the silhouette's pixels that are in the image and not hidden, [0, 1].
    """

    box: FloatArray
    visibility: float


@dataclass(frozen=True)
class Picture:
    """A picture that more things can be put into.

    Attributes:
        colour: ``(H, W, 3)`` linear light.
        distance: ``(H * samples, W * samples)`` metres to what stands there, infinite for ground and sky.
        samples: subpixels along each side of a pixel.
    """

    colour: Float32
    distance: Float32
    samples: int

    @property
    def open_ground(self) -> Float32:
        """``(H, W)`` share of each pixel that nothing stands on."""
        return by_pixel(np.isinf(self.distance).astype(np.float32), self.samples)


def empty_picture(colour: Float32, samples: int) -> Picture:
    """``colour`` ``(H, W, 3)`` with nothing in it yet."""
    height, width = colour.shape[:2]
    fine = (height * samples, width * samples)
    return Picture(colour, np.full(fine, np.inf, dtype=np.float32), samples)


def compose(
    picture: Picture, things: list[Thing], camera: RayCamera, light: Light
) -> tuple[Picture, list[Sighting | None]]:
    """``picture`` with ``things`` in it, the nearer before the farther, and what is seen of each (None: nothing).

    Soft edges come from the share of a pixel's rays that meet a thing.
    """
    samples = picture.samples
    distance = picture.distance.copy()
    owner = np.full(distance.shape, -1, dtype=np.int16)
    layers = [thing.trace(camera, samples) for thing in things]
    for index, layer in enumerate(layers):
        if layer is not None:
            there, pixels = tracing.overlap(distance.shape, (layer.top, layer.left), layer.distance.shape)
            closer = layer.distance[pixels] < distance[there]
            np.copyto(distance[there], layer.distance[pixels], where=closer)
            np.copyto(owner[there], np.int16(index), where=closer)
    added = picture.colour * by_pixel((owner < 0).astype(np.float32), samples)[:, :, None]
    sightings: list[Sighting | None] = []
    for index, (thing, layer) in enumerate(zip(things, layers, strict=True)):
        if layer is None:
            sightings.append(None)
            continue
        there, pixels = tracing.overlap(owner.shape, (layer.top, layer.left), layer.distance.shape)
        visible = np.zeros(layer.distance.shape, dtype=np.bool_)
        visible[pixels] = owner[there] == index
        if visible.any():
            _draw(added, thing, layer, visible, camera, samples, light)
        share = int((visible & layer.own).sum()) / max(int(layer.own.sum()), 1)
        sightings.append(Sighting(tracing.silhouette_box(layer, samples), share))
    return Picture(added, distance, samples), sightings


def _draw(
    colour: Float32, thing: Thing, layer: Layer, visible: BoolArray, camera: RayCamera, samples: int, light: Light
) -> None:
    """Adds the ``visible`` part of the layer of a thing to ``colour``."""
    weight = np.full(visible.shape, 1 / samples**2, dtype=np.float32)
    if thing.outfit is None:
        visible, weight = _fewer(layer, visible, samples)
    rows, columns = np.nonzero(visible)
    values = thing.shade(layer, visible, camera, samples, light) * weight[rows, columns][:, None]
    rows, columns = (rows + layer.top) // samples, (columns + layer.left) // samples
    top, left = rows[0], columns.min()
    shape = (rows[-1] - top + 1, columns.max() - left + 1)
    cell = (rows - top) * shape[1] + columns - left
    for channel in range(3):
        sums = np.bincount(cell, values[:, channel], minlength=shape[0] * shape[1])
        colour[top : top + shape[0], left : left + shape[1], channel] += sums.reshape(shape)


def _fewer(layer: Layer, visible: BoolArray, samples: int) -> tuple[BoolArray, Float32]:
    """One subpixel for all those of a pixel that show the same solid, and the weights of the subpixels.

    Edges stay as they are; only the texture is sampled less finely, which is enough for things.
    """
    h, w = visible.shape
    above, left = layer.top % samples, layer.left % samples
    rows, columns = -(-(above + h) // samples), -(-(left + w) // samples)
    padded = np.full((rows * samples, columns * samples), -1, dtype=np.int16)
    padded[above : above + h, left : left + w] = np.where(visible, layer.solid, np.int16(-1))
    blocks = padded.reshape(rows, samples, columns, samples)
    first = blocks[:, :1, :, :1]
    uniform = (blocks == first) & (first >= 0)
    weight = np.full(blocks.shape, 1 / samples**2, dtype=np.float32)
    weight[:, 0, :, 0] = uniform.sum(axis=(1, 3)) / samples**2
    uniform[:, 0, :, 0] = False
    mixed = (blocks >= 0) & ~uniform
    window = (slice(above, above + h), slice(left, left + w))
    return mixed.reshape(padded.shape)[window], weight.reshape(padded.shape)[window]


def by_pixel(fine: Float32, samples: int) -> Float32:
    """Means over the subpixels of each pixel, ``(H * samples, W * samples, ...)`` to ``(H, W, ...)``."""
    height, width = fine.shape[:2]
    return np.asarray(cv2.resize(fine, (width // samples, height // samples), interpolation=cv2.INTER_AREA))


def darken(
    picture: Picture, things: list[Thing], camera: RayCamera, light: Light, sunlit: Float32, softness: float
) -> tuple[Picture, Float32]:
    """``picture`` with the shadows of ``things`` on its ground, and the ``(H, W)`` sunlit share that is left.

    Beside the sun's shadow, a thing keeps some of the sky's light from the ground right under it.

    Args:
        picture: to be darkened where nothing stands.
        things: that throw shadows.
        camera: of the picture.
        light: of the scene.
        sunlit: ``(H, W)`` share of the light that comes straight from the sun.
        softness: standard deviation of the blur of the shadows, pixels.
    """
    sun, under = both_shadows(things, camera, light, softness)
    brightness = (1 - sun * sunlit) * (1 - np.float32(OCCLUSION) * under)
    open_ground = picture.open_ground
    shade_factor = 1 - open_ground * (1 - brightness)
    return replace(picture, colour=picture.colour * shade_factor[:, :, None]), sunlit * (1 - sun) * open_ground


def both_shadows(things: list[Thing], camera: RayCamera, light: Light, softness: float) -> tuple[Float32, Float32]:
    """`shadows` of the sun, and softer ones straight below, where a thing keeps some of the sky's light away."""
    below = np.array([0, 0, 1], dtype=np.float32)
    return shadows(things, camera, light.direction, softness), shadows(things, camera, below, 2.0 + softness)


def shadows(things: list[Thing], camera: RayCamera, direction: Float32, softness: float) -> Float32:
    """``(H, W)`` share of the ground that ``things`` hide from ``direction``, in [0, 1].

    A cone-sphere's shadow is the convex hull of its spheres' shadows; ``softness`` blurs it, in pixels.
    """
    mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
    if direction[2] < 0.05:
        return mask.astype(np.float32)
    sun = direction.astype(np.float64)
    across = np.cross(sun, [0.0, 0.0, 1.0] if sun[2] < 0.99 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    ring = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(across, sun)
    for solids in (thing.solids for thing in things):
        axes, ends = solids.ends()
        mean_scale = np.where(solids.box[:, None], 0.0, solids.scale[:, 1:2] * 0.5 + 0.5)
        points = ends[:, :, None] + ring * (solids.radius * mean_scale)[:, :, None, None]
        corners = solids.start[:, None] + np.einsum("kij,cj->kci", axes, np.concatenate([CORNERS, CORNERS]))
        points = np.where(solids.box[:, None, None], corners, points.reshape(len(solids), 16, 3))
        points[:, :, 2] = np.maximum(points[:, :, 2], 0)
        pixels, depth = camera.project((points - points[:, :, 2:] / sun[2] * sun).reshape(-1, 3))
        pixels, in_view = pixels.reshape(len(solids), 16, 2), (depth.reshape(len(solids), 16) > 0.3).all(axis=1)
        limit = 8 * max(camera.width, camera.height)
        in_view &= (np.abs(np.nan_to_num(pixels, nan=1e9)) < limit).all(axis=(1, 2))
        # fillConvexPoly reads fixed-point numbers and puts a pixel's centre at a whole one.
        for fixed in np.round((pixels[in_view] - 0.5) * 16).astype(np.int32):
            cv2.fillConvexPoly(mask, cv2.convexHull(fixed), 255, lineType=cv2.LINE_AA, shift=4)
    blurred = cv2.GaussianBlur(mask, (0, 0), softness) if softness > 0 else mask
    return np.asarray(blurred, dtype=np.float32) / np.float32(255)


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
    up = light.direction[2] * light.sun
    share = np.float32((up / np.maximum(up + light.sky, 1e-6)).mean())
    sun, under = both_shadows(things, camera, light, SOFTNESS)
    brightness = np.sqrt((1 - share * sun) * (1 - np.float32(OCCLUSION) * under))
    rows = np.flatnonzero(brightness.min(axis=1) < 0.999)
    if len(rows):
        part = slice(int(rows[0]), int(rows[-1]) + 1)
        image[part] = cv2.multiply(image[part], cv2.merge([brightness[part]] * 3), dtype=cv2.CV_8U)
    rects = [tracing.extents(thing.solids, camera) for thing in things]
    rects = [np.concatenate([r[:, :2].min(axis=0), r[:, 2:].max(axis=0)]) for r in rects]

    def below(rows: slice, columns: slice) -> Picture:
        return empty_picture(np.square(image[rows, columns].astype(np.float32) * np.float32(1 / 255)), samples)

    return draw_clusters(image, things, np.array(rects).reshape(-1, 4), camera, light, below)


def draw_clusters(
    image: ImageArray,
    things: list[Thing],
    rects: FloatArray,
    camera: RayCamera,
    light: Light,
    below: Callable[[slice, slice], Picture],
    exposure: float = 1.0,
) -> list[Sighting | None]:
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
    sightings: list[Sighting | None] = [None] * len(things)
    for (x1, y1, x2, y2), members in clusters(rects, camera.width, camera.height):
        rows, columns = slice(y1, y2), slice(x1, x2)
        window = _Window(camera, x1, y1, x2 - x1, y2 - y1)
        picture, visible = compose(below(rows, columns), [things[i] for i in members], window, light)
        image[rows, columns] = encoded(picture.colour, exposure)
        for i, sighting in zip(members, visible, strict=True):
            if sighting is not None:
                sightings[i] = Sighting(sighting.box + np.array([x1, y1, x1, y1]), sighting.visibility)
    return sightings


def encoded(colour: Float32, exposure: float = 1.0) -> ImageArray:
    """Linear light ``(H, W, 3)`` times ``exposure`` as an image with gamma 2."""
    return np.asarray(255 * np.sqrt(np.clip(colour * np.float32(exposure), 0, 1)) + 0.5).astype(np.uint8)


def clusters(rects: FloatArray, width: int, height: int) -> list[tuple[tuple[int, int, int, int], IntArray]]:
    """Windows x1, y1, x2, y2 within the image, none touching another, and the rectangles ``(N, 4)`` each holds.

    A window is as large as what it holds, also where that leaves the image. Rectangles outside the image or with a
    NaN are in none.
    """
    limit = np.array([width, height])
    with np.errstate(invalid="ignore"):
        visible = np.flatnonzero((rects[:, :2] < limit).all(axis=1) & (rects[:, 2:] > 0).all(axis=1))
    # Whole pixels about each rectangle, moved inward where it leaves the image.
    low, high = np.floor(rects[visible, :2]) - 1, np.ceil(rects[visible, 2:]) + 1
    size = np.minimum(high - low, limit)
    low = np.clip(low, 0, limit - size)
    groups = [(window, [int(i)]) for window, i in zip(np.concatenate([low, low + size], axis=1), visible, strict=True)]
    count_before = 0
    while len(groups) != count_before:
        count_before, apart = len(groups), list[tuple[FloatArray, list[int]]]()
        for window, members in groups:
            for k, (bounds, theirs) in enumerate(apart):
                if (window[:2] < bounds[2:]).all() and (bounds[:2] < window[2:]).all():
                    both = np.concatenate([np.minimum(window[:2], bounds[:2]), np.maximum(window[2:], bounds[2:])])
                    apart[k] = (both, theirs + members)
                    break
            else:
                apart.append((window, members))
        groups = apart
    return [((int(w[0]), int(w[1]), int(w[2]), int(w[3])), np.array(m)) for w, m in groups]
