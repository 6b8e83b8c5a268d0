"""Leaves: fallen ones on the ground, heaps and hedges of them, and branches that hang before the camera."""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.figures.standing_sprites import flat_thing
from tsuiseki.datamodules.scenes.render.composing import Thing
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Float32, Solids, Surface, boxes
from tsuiseki.datamodules.scenes.render.tracing import Layer, RayCamera
from tsuiseki.datamodules.scenes.things.street_things import clutter_around
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

# Colours of fresh leaves, sRGB.
_FRESH = np.array([[0.20, 0.34, 0.12], [0.30, 0.44, 0.16], [0.12, 0.24, 0.10], [0.40, 0.46, 0.22]])
# Colours of fallen leaves, sRGB.
_FALLEN = np.array([[0.55, 0.32, 0.12], [0.70, 0.50, 0.15], [0.42, 0.22, 0.12], [0.62, 0.20, 0.10], [0.35, 0.27, 0.16]])
# Colours that the leaves of one patch have.
_SHADES = 14
# (shortest, longest) leaf on the ground, metres.
_LEAF = (0.04, 0.16)
# Distance of a branch from the camera, metres: nearer than anything else.
_NEAR = 0.6


def leaf_colours(rng: np.random.Generator) -> FloatArray:
    """``(_SHADES, 3)`` sRGB of the leaves of one place: fresh ones, fallen ones, or both."""
    palette = (_FRESH, _FALLEN, np.concatenate([_FRESH, _FALLEN]))[int(rng.choice(3, p=[0.45, 0.35, 0.2]))]
    shades = palette[rng.integers(len(palette), size=_SHADES)] * rng.uniform(0.35, 1.5, (_SHADES, 1))
    return np.clip(shades + rng.normal(0, 0.03, (_SHADES, 3)), 0.01, 1)


def draw_leaves(
    picture: Float32 | ImageArray, middles: FloatArray, axes: FloatArray, colours: FloatArray, rng: np.random.Generator
) -> None:
    """Leaves, pointed at both ends, painted into ``picture`` ``(H, W, C)`` in place.

    Args:
        picture: to paint on.
        middles: ``(N, 2)`` pixels.
        axes: ``(N, 2, 2)`` pixels: half of the length and half of the width of each leaf.
        colours: ``(K, C)`` of which each leaf has one.
        rng: draws which.
    """
    angle = np.linspace(0, 2 * np.pi, 10, endpoint=False)
    # A circle whose sides are drawn in towards both ends.
    outline = np.stack([np.cos(angle), np.sin(angle) * np.abs(np.sin(angle)) ** 0.4], axis=1)
    points = np.round((middles[:, None] + outline @ axes) * 16).astype(np.int32)
    which = rng.integers(len(colours), size=len(points))
    for k, colour in enumerate(colours):
        cv2.fillPoly(picture, list(points[which == k]), colour.tolist(), cv2.LINE_AA, 4)


def fallen_leaves(rng: np.random.Generator, ground: Float32, camera: AnyCamera) -> Float32:
    """``ground`` ``(H, W, 3)``, linear light, with leaves on it, in drifts or all over."""
    count = int(np.exp(rng.uniform(np.log(40), np.log(1500))))
    size = np.array([camera.width, camera.height])
    if rng.random() < 0.5:
        drift = rng.uniform([0, 0.4], [1, 1.1]) * size
        feet = drift + rng.normal(0, 1, (count, 2)) * size * [0.25, 0.08]
    else:
        feet = rng.uniform([0, 0.1], [1, 1.1], (count, 2)) * size
    spots = camera.ground(feet)
    spots = spots[np.isfinite(spots).all(axis=1) & (np.linalg.norm(spots[:, :2], axis=1) < 40)]
    if not len(spots):
        return ground
    yaw, half = rng.uniform(0, 2 * np.pi, len(spots)), rng.uniform(*_LEAF, len(spots)) / 2
    level = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(len(spots))], axis=1)
    aside = np.stack([-level[:, 1], level[:, 0], level[:, 2]], axis=1) * rng.uniform(0.3, 0.8, (len(spots), 1))
    middle, _ = camera.project(spots)
    ends = [camera.project(spots + half[:, None] * direction)[0] - middle for direction in (level, aside)]
    axes = np.stack(ends, axis=1)
    seen = np.isfinite(axes).all(axis=(1, 2)) & (np.abs(axes).max(axis=(1, 2)) < 200)
    picture = ground.copy()
    brightness = float(np.median(ground)) / 0.2
    draw_leaves(picture, middle[seen], axes[seen], np.square(leaf_colours(rng)) * max(brightness, 0.2), rng)
    return picture


def leaf_picture(rng: np.random.Generator, width: int, height: int, within: str) -> ImageArray:
    """``(height, width, 4)`` uint8 RGBA: leaves on nothing.

    Args:
        rng: draws everything.
        width: pixels.
        height: pixels.
        within: ``heap`` is half an ellipse, ``hedge`` a rectangle, ``branch`` follows twigs from above.
    """
    picture = np.zeros((height, width, 4), np.uint8)
    size = np.array([width, height])
    length = float(np.exp(rng.uniform(np.log(0.03), np.log(0.12)))) * max(width, height)
    count = int(np.clip(rng.uniform(2.0, 5.0) * width * height / length**2, 30, 1500))
    if within == "branch":
        twigs = int(rng.integers(2, 9))
        start = rng.uniform([0, -0.1], [1, 0.15], (twigs, 2)) * size
        reach = rng.uniform([-0.4, 0.2], [0.4, 0.9], (twigs, 2)) * size
        of_leaf, part = rng.integers(twigs, size=count // 3), rng.random((count // 3, 1))
        middles = start[of_leaf] + part * reach[of_leaf] + rng.normal(0, length * 0.7, (count // 3, 2))
        for a, b in zip(start.astype(int).tolist(), (start + reach).astype(int).tolist(), strict=True):
            cv2.line(picture, a, b, (45, 34, 25, 255), max(int(length / 9), 1), cv2.LINE_AA)
    else:
        inside = rng.uniform(-1, 1, (3 * count, 2))
        radius = np.square(inside).sum(axis=1) if within == "heap" else np.abs(inside).max(axis=1)
        inside = inside[radius < 1][:count]
        inside[:, 1] = -np.abs(inside[:, 1]) if within == "heap" else inside[:, 1]
        reach_up = (0.5, 1.0) if within == "heap" else (0.5, 0.5)
        middles = (inside * np.array(reach_up) + [0.5, 1.0 if within == "heap" else 0.5]) * size
    turn = rng.uniform(0, 2 * np.pi, len(middles))
    ahead = np.stack([np.cos(turn), np.sin(turn)], axis=1) * (length / 2 * rng.uniform(0.6, 1.3, (len(middles), 1)))
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) * rng.uniform(0.25, 0.8, (len(middles), 1))
    colours = np.column_stack([255 * leaf_colours(rng), np.full(_SHADES, 255.0)])
    draw_leaves(picture, middles, np.stack([ahead, aside], axis=1), colours, rng)
    return picture


def heaps(rng: np.random.Generator, camera: AnyCamera, count: int, occupied: FloatArray) -> list[Thing]:
    """Up to ``count`` heaps of leaves and hedges, clear of the ``occupied`` places ``(N, 2)``."""

    def heap(rng: np.random.Generator, spot: FloatArray) -> Thing:
        hedge = rng.random() < 0.5
        high = float(rng.uniform(0.5, 2.2) if hedge else rng.uniform(0.15, 0.9))
        wide = high * float(rng.uniform(0.4, 3.0) if hedge else rng.uniform(1.5, 4.0))
        rows = 200
        leaves = leaf_picture(rng, max(int(rows * wide / high), 8), rows, "hedge" if hedge else "heap")
        return flat_thing(leaves, camera, spot, high)

    return clutter_around(rng, camera, count, occupied, 0.15, heap)


class Branch(Thing):
    """Leaves between the camera and everything else: a picture as large as the camera's, ``(H, W, 4)`` uint8 RGBA."""

    def __init__(self, picture: ImageArray) -> None:
        super().__init__(_nothing())
        self.picture = picture

    def trace(self, camera: RayCamera, samples: int) -> Layer | None:
        """The leaves over the whole picture, nearer than anything else; see `Thing.trace`."""
        size = camera.width * samples, camera.height * samples
        fine = cv2.resize(self.picture, size, interpolation=cv2.INTER_NEAREST)
        there = fine[..., 3] > 127
        if not there.any():
            return None
        distance = np.where(there, np.float32(_NEAR), np.float32(np.inf))
        return Layer(0, 0, distance, np.zeros(there.shape, np.int16), fine[..., :3])

    def shade(self, layer: Layer, visible: BoolArray, camera: RayCamera, samples: int, light: Light) -> Float32:
        """Half in the sun and half in the light of sky and ground; see `Thing.shade`."""
        del camera, samples
        albedo = np.square(layer.picture[visible].astype(np.float32) / np.float32(255))
        return np.asarray(albedo * (0.5 * light.sun + 0.5 * (light.sky + light.ground)), dtype=np.float32)


def random_branch(rng: np.random.Generator, camera: AnyCamera) -> Branch:
    """Twigs that hang into a part of the picture, out of focus."""
    share = rng.uniform([0.25, 0.2], [0.9, 0.7])
    width, height = (max(int(n), 16) for n in share * [camera.width, camera.height])
    picture = np.zeros((camera.height, camera.width, 4), np.uint8)
    left = int(rng.integers(-width // 3, camera.width - width // 2))
    twigs = leaf_picture(rng, width, height, "branch")
    twigs = np.asarray(cv2.GaussianBlur(twigs, (0, 0), float(rng.uniform(0.3, 2.0))), dtype=np.uint8)
    low, high = max(left, 0), min(left + width, camera.width)
    picture[:height, low:high] = twigs[:, low - left : high - left]
    return Branch(picture)


def _nothing() -> Solids:
    """No solid: a branch throws no shadow on what is far from it."""
    return boxes(np.zeros((1, 3)), np.ones((1, 3)), np.zeros(1), [Surface((0.0, 0.0, 0.0))]).select(slice(0, 0))
