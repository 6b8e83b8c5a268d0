"""A sprite put on the ground of a scene: placed, dressed in other colours and lit by the scene's light."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.figures.mesh import Worn
from tsuiseki.datamodules.scenes.figures.rendering import Sprite, smaller
from tsuiseki.datamodules.scenes.people.outfit import MIDDLE, Outfit
from tsuiseki.datamodules.scenes.people.posture import mirrored
from tsuiseki.datamodules.scenes.render.composing import Thing
from tsuiseki.datamodules.scenes.render.photographs import OPAQUE, Photographs
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Float32, Solids, Surface, boxes
from tsuiseki.datamodules.scenes.render.tracing import Layer, RayCamera
from tsuiseki.datamodules.scenes.things.street_things import clutter_around
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

# Probability that textured clothes keep their own colours; cloth without a colour of its own always gets one.
_OWN_COLOURS = 0.3
# Mean range over red, green and blue below which cloth has no colour of its own, grey levels.
_GREY = 12.0


class Standing(Thing):
    """Somebody rendered who stands in a scene.

    Attributes:
        sprite: seen from about as high as the scene's camera looks.
        spot: ``(2,)`` metres, on the ground.
        base: metres over the ground of what the feet stand on.
    """

    def __init__(
        self, sprite: Sprite, spot: FloatArray, solids: Solids, outfit: Outfit | None = None, base: float = 0.0
    ) -> None:
        super().__init__(solids, outfit)
        self.sprite, self.spot, self.base = sprite, spot, base

    def trace(self, camera: RayCamera, samples: int) -> Layer | None:
        """Where the person is on a grid of ``samples`` by ``samples`` rays a pixel, with the sprite on that window.

        None where the person is not wholly before the camera or does not meet the picture.
        """
        ends, depth = self._ends(camera)
        if not (np.isfinite(ends).all() and (depth > 0.5).all()):
            return None
        ends = ends * samples
        upright, projected = self.sprite.head - self.sprite.feet, ends[1] - ends[0]
        scale = float(np.linalg.norm(projected) / np.linalg.norm(upright))
        sprite = smaller(self.sprite, scale) if scale < 1 else self.sprite
        affine = _similarity(sprite.feet, sprite.head, ends[0], ends[1])
        h, w = sprite.label.shape
        corners = np.array([[0, 0], [w, 0], [0, h], [w, h]]) @ affine[:, :2].T + affine[:, 2]
        left, top = np.floor(corners.min(axis=0)).astype(int)
        right, bottom = np.ceil(corners.max(axis=0)).astype(int)
        width, height = camera.width * samples, camera.height * samples
        if right <= 0 or bottom <= 0 or left >= width or top >= height or max(right - left, bottom - top) > 4 * height:
            return None
        affine[:, 2] -= [left, top]
        affine[:, 2] += affine[:, :2].sum(axis=1) / 2 - 0.5
        albedo, normal, label = (
            cv2.warpAffine(part, affine, (right - left, bottom - top), flags=cv2.INTER_NEAREST)
            for part in (sprite.albedo, sprite.normal.astype(np.int16), sprite.label)
        )
        drawn_sprite = replace(
            sprite, albedo=albedo.astype(np.uint8), normal=normal.astype(np.int8), label=label.astype(np.uint8)
        )
        middle = np.array([*self.spot, self.base + (self.sprite.middle or 0.5 * self.sprite.height)])
        away = np.float32(np.linalg.norm(middle - camera.position))
        distance = np.where(drawn_sprite.label > 0, away, np.float32(np.inf)).astype(np.float32)
        if not (drawn_sprite.label > 0).any():
            return None
        return Layer(int(left), int(top), distance, -(drawn_sprite.label == Worn.BESIDE).astype(np.int16), drawn_sprite)

    def steady_sides(self, camera: RayCamera) -> FloatArray:
        """``(2,)`` pixels: the left and right side of the steady box in the picture, see `Sprite`."""
        ends, _ = self._ends(camera)
        affine = _similarity(self.sprite.feet, self.sprite.head, ends[0], ends[1])
        row = (self.sprite.feet[1] + self.sprite.head[1]) / 2
        sides = np.array([[self.sprite.steady[0], row], [self.sprite.steady[1], row]])
        return np.asarray(sides @ affine[0, :2] + affine[0, 2])

    def _ends(self, camera: RayCamera) -> tuple[FloatArray, FloatArray]:
        """Where feet and head of the `Sprite` are seen, ``(2, 2)`` pixels, and their depths ``(2,)``."""
        ends = np.array([[*self.spot, self.base + self.sprite.middle]] * 2)
        if self.sprite.middle:
            away = away_from(camera, self.spot)
            ends[:, :2] += 0.5 * self.sprite.height * np.array([[-away[1], away[0]], [away[1], -away[0]]])
        else:
            ends[1, 2] += self.sprite.height
        return camera.project(ends)

    def shade(self, layer: Layer, visible: BoolArray, camera: RayCamera, samples: int, light: Light) -> Float32:
        del samples
        away, sprite = away_from(camera, self.spot), layer.picture
        axes = np.array([[away[0], -away[1], 0], [away[1], away[0], 0], [0, 0, 1]], dtype=np.float32)
        normal = sprite.normal[visible].astype(np.float32) / np.float32(127) @ axes.T
        albedo = np.square(sprite.albedo[visible].astype(np.float32) / np.float32(255))
        facing = np.maximum(normal @ light.direction, 0)[:, None]
        up = (np.float32(0.5) + np.float32(0.5) * normal[:, 2])[:, None]
        return np.asarray(albedo * (facing * light.sun + up * (light.sky - light.ground) + light.ground))


def dressed(rng: np.random.Generator, sprite: Sprite) -> Sprite:
    """The sprite in other colours, and mirrored every other time."""
    outfit = Outfit(rng)
    albedo = sprite.albedo.copy()
    colours = (outfit.hair, outfit.upper, outfit.lower, outfit.shoes, outfit.bag_colour, outfit.bag_colour)
    for label, colour in zip(list(Worn)[1:], colours, strict=True):
        at = sprite.label == label
        if not at.any():
            continue
        cloth = albedo[at].astype(np.float32)
        grey = np.ptp(cloth, axis=1).mean() < _GREY
        if not grey and rng.random() < _OWN_COLOURS:
            albedo[at] = np.clip(cloth * np.exp(rng.normal(0, 0.2)), 0, 255).astype(np.uint8)
            continue
        bright = cloth.mean(axis=1, keepdims=True)
        relative = np.clip(bright / max(float(bright.mean()), 1.0), 0, 2.5) ** np.float32(rng.uniform(0.5, 1.1))
        albedo[at] = np.clip(relative * np.array(colour, dtype=np.float32) * 255, 0, 255).astype(np.uint8)
    at = sprite.label == Worn.SKIN
    albedo[at] = np.clip(albedo[at] * np.float32(np.exp(rng.normal(0, 0.12))), 0, 255).astype(np.uint8)
    if rng.random() < 0.5:
        return replace(sprite, albedo=albedo)
    width = sprite.label.shape[1]
    normal = sprite.normal[:, ::-1].copy()
    normal[..., 1] *= -1
    feet, head = (np.array([width, 0.0]) + np.array([-1.0, 1.0]) * place for place in (sprite.feet, sprite.head))
    albedo, labels = np.ascontiguousarray(albedo[:, ::-1]), np.ascontiguousarray(sprite.label[:, ::-1])
    if sprite.middle:
        # The left end is that on the left again.
        feet, head = head, feet
    pose = None if sprite.pose is None else mirrored(sprite.pose)
    return replace(
        sprite, albedo=albedo, normal=normal, label=labels, feet=feet, head=head, steady=width - sprite.steady[::-1],
        heading=-sprite.heading, pose=pose,
    )  # fmt: skip


def away_from(camera: AnyCamera | RayCamera, spot: FloatArray) -> FloatArray:
    """``(2,)`` unit vector on the ground from below the camera to a ``spot``."""
    away = spot - camera.position[:2]
    return np.asarray(away / max(float(np.linalg.norm(away)), 1e-6))


def tilt_of(camera: RayCamera, spot: FloatArray) -> float:
    """How far down, in radians, a camera looks at a person at ``spot``."""
    return float(np.arctan2(camera.position[2] - 0.9, max(float(np.linalg.norm(spot - camera.position[:2])), 0.1)))


def _similarity(a: FloatArray, b: FloatArray, to_a: FloatArray, to_b: FloatArray) -> FloatArray:
    """``(2, 3)`` rotation, scaling and shift that takes two points to two others."""
    ratio = complex(*(to_b - to_a)) / complex(*(b - a))
    turn = np.array([[ratio.real, -ratio.imag], [ratio.imag, ratio.real]])
    return np.column_stack([turn, to_a - turn @ a])


# Lowest pictured thing, metres.
_LOWEST = 0.6
# Highest pictured thing, about a sign on its post, metres.
_HIGHEST = 3.0
# Pixels of its height that are kept, as of a rendered person.
_TALL = 256
# A flat picture is lit as if it leant back a little: 127 times away from the camera, left, up.
_FACING = (-107, 0, 68)


def pictured_things(
    rng: np.random.Generator, photographs: Photographs, camera: AnyCamera, count: int, occupied: FloatArray,
    largest: float,
) -> list[Thing]:  # fmt: skip
    """Up to ``count`` photographed things, clear of the ``occupied`` places ``(N, 2)``; see `clutter_around`."""

    def upright(rng: np.random.Generator, spot: FloatArray) -> Thing:
        # In somewhat other colours and proportions.
        picture = photographs.thing(rng)
        if rng.random() < 0.5:
            picture = picture[:, ::-1]
        rows, columns = picture.shape[:2]
        tall = min(rows, _TALL)
        wide = max(round(columns * tall / rows * float(np.exp(rng.normal(0, 0.2)))), 2)
        small = np.asarray(cv2.resize(picture, (wide, tall), interpolation=cv2.INTER_AREA))
        gain = np.exp(rng.normal(0, 0.25)) * np.exp(rng.normal(0, 0.08, 3))
        height = float(np.exp(rng.uniform(np.log(_LOWEST), np.log(_HIGHEST))))
        coloured = np.dstack([np.clip(small[..., :3] * gain, 0, 255).astype(np.uint8), small[..., 3]])
        return flat_thing(coloured, camera, spot, height)

    return clutter_around(rng, camera, count, occupied, largest, upright)


def flat_thing(picture: ImageArray, camera: AnyCamera, spot: FloatArray, height: float) -> Standing:
    """A cut-out ``picture`` ``(h, w, 4)`` uint8 RGBA that stands at ``spot`` ``(2,)``, ``height`` metres tall."""
    tall, wide = picture.shape[:2]
    label = np.where(picture[..., 3] >= OPAQUE, Worn.EXTRA, 0).astype(np.uint8)
    albedo = np.where(label[..., None] > 0, picture[..., :3], 0).astype(np.uint8)
    normal = np.broadcast_to(np.array(_FACING, np.int8), albedo.shape)
    feet, head, sides = np.array([wide / 2, tall]), np.array([wide / 2, 0.0]), np.array([0.0, wide])
    sprite = Sprite(albedo, normal, label, feet, head, height, 0.0, sides)
    # A thin upright box before the camera throws the shadow.
    away = spot - camera.position[:2]
    across = float(np.arctan2(away[1], away[0])) - np.pi / 2
    half = np.array([[0.5 * height * wide / tall, 0.05, 0.5 * height]])
    board = boxes(np.array([[*spot, half[0, 2]]]), half, np.array([across]), [Surface(MIDDLE[0])])
    return Standing(sprite, board.start[0, :2].astype(np.float64), board)
