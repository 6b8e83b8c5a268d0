"""Photographs of things, cut out, that stand about where people could: signs, bins, vehicles, plants, instruments.

Drawn things have the surfaces of drawings; a photographed one is as rich as a person, and is none.
"""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.figures.mesh import EXTRA
from tsuiseki.datamodules.scenes.figures.rendering import Sprite
from tsuiseki.datamodules.scenes.figures.standing import Standing
from tsuiseki.datamodules.scenes.people.look import MIDDLE
from tsuiseki.datamodules.scenes.render.photographs import OPAQUE, Photographs
from tsuiseki.datamodules.scenes.render.scene import Thing
from tsuiseki.datamodules.scenes.render.solids import Solids, Surfaces, boxes
from tsuiseki.datamodules.scenes.street.staging import clutter_around
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray

# Metres: about a person's height and less, up to that of a sign on its post.
_LOWEST, _HIGHEST = 0.6, 3.0
# Pixels of its height that are kept, as of a rendered person.
_TALL = 256
# A flat picture is lit as if it leant back a little: 127 times away from the camera, left, up.
_FACING = (-107, 0, 68)


def pictured_things(
    rng: np.random.Generator,
    photographs: Photographs,
    camera: PinholeCamera,
    count: int,
    taken: FloatArray,
    largest: float,
) -> list[Thing]:
    """Up to ``count`` photographed things, clear of the places ``taken`` ``(N, 2)``; see `clutter_around`."""
    made: list[tuple[Solids, Sprite]] = []

    def upright(rng: np.random.Generator, spot: FloatArray) -> Solids:
        sprite = _as_sprite(rng, photographs.thing(rng))
        made.append((_board(sprite, spot, camera), sprite))
        return made[-1][0]

    placed = clutter_around(rng, camera, count, taken, largest, upright)
    sprites = {id(solids): sprite for solids, sprite in made}
    return [
        Thing(thing.solids, cutout=Standing(sprites[id(thing.solids)], thing.solids.start[0, :2].astype(np.float64)))
        for thing in placed
    ]


def _as_sprite(rng: np.random.Generator, picture: ImageArray) -> Sprite:
    """A cut-out ``(h, w, 4)`` uint8 RGBA as what stands on the ground, in somewhat other colours and proportions."""
    if rng.random() < 0.5:
        picture = picture[:, ::-1]
    rows, columns = picture.shape[:2]
    tall = min(rows, _TALL)
    wide = max(round(columns * tall / rows * float(np.exp(rng.normal(0, 0.2)))), 2)
    small = np.asarray(cv2.resize(picture, (wide, tall), interpolation=cv2.INTER_AREA))
    label = np.where(small[..., 3] >= OPAQUE, EXTRA, 0).astype(np.uint8)
    gain = np.exp(rng.normal(0, 0.25)) * np.exp(rng.normal(0, 0.08, 3))
    albedo = np.where(label[..., None] > 0, np.clip(small[..., :3] * gain, 0, 255), 0).astype(np.uint8)
    normal = np.broadcast_to(np.array(_FACING, np.int8), albedo.shape)
    height = float(np.exp(rng.uniform(np.log(_LOWEST), np.log(_HIGHEST))))
    middle, sides = wide / 2, np.array([0.0, wide])
    return Sprite(albedo, normal, label, np.array([middle, tall]), np.array([middle, 0.0]), height, 0.0, sides)


def _board(sprite: Sprite, spot: FloatArray, camera: PinholeCamera) -> Solids:
    """The thin upright box before the camera that throws the shadow of ``sprite``."""
    rows, columns = sprite.label.shape
    away = spot - camera.position[:2]
    across = float(np.arctan2(away[1], away[0])) - np.pi / 2
    surfaces = Surfaces()
    surfaces.add(MIDDLE[0])
    half = np.array([[0.5 * sprite.height * columns / rows, 0.05, 0.5 * sprite.height]])
    return boxes(np.array([[*spot, half[0, 2]]]), half, np.array([across]), surfaces)
