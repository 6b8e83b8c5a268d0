"""Things in the round from several sides, so that a tracker learns what turns away from it.

Most are of no class: a few limbs and boxes of any colours and patterns. Others stand about in streets and towns.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.datamodules.scenes.people.outfit import any_colour
from tsuiseki.datamodules.scenes.people.person import view_from
from tsuiseki.datamodules.scenes.render.composing import drawn_alone
from tsuiseki.datamodules.scenes.render.shading import random_light
from tsuiseki.datamodules.scenes.render.solids import Parts, Pattern, Surface, along
from tsuiseki.datamodules.scenes.things.street_things import SMALL
from tsuiseki.datamodules.scenes.things.town import THINGS, Maker, made
from tsuiseki.tracking.types import FloatArray, ImageArray

# Share of the things that are of no class.
_NO_CLASS = 0.7
# Rays a side of a pixel.
_SAMPLES = 2
# Metres between the camera and the thing.
_DISTANCE = 12.0
_MAKERS: tuple[Maker, ...] = (*THINGS, *SMALL)


def random_spread(rng: np.random.Generator) -> float:
    """Standard deviation of how far a thing turns between two pictures, radians: mostly little, at times all round."""
    return float(np.exp(rng.uniform(np.log(0.1), np.log(1.2))))


def from_some_sides(rng: np.random.Generator, views: int, side: int) -> list[ImageArray]:
    """One thing seen while it turns: ``views`` cut-outs ``(h, w, 4)`` uint8 RGBA, about ``side`` large."""
    make = of_no_class if rng.random() < _NO_CLASS else _MAKERS[int(rng.integers(len(_MAKERS)))]
    seed, light = int(rng.integers(2**31)), random_light(rng)
    tilts = np.clip(rng.uniform(0.0, 1.0) + rng.normal(0, 0.12, views), 0.0, 1.4)
    yaws = rng.uniform(0, 2 * np.pi) + rng.normal(0, random_spread(rng), views)
    drawn = []
    for tilt, yaw in zip(tilts.tolist(), yaws.tolist(), strict=True):
        thing = made(np.random.default_rng(seed), make, np.zeros(2), yaw)
        _, ends = thing.solids.ends()
        height = max(float(ends[..., 2].max()), 0.5)
        wide = 2 * float(np.linalg.norm(ends[..., :2], axis=-1).max())
        camera = view_from(tilt, side * height / max(height, wide), height, _DISTANCE)
        drawn.append(drawn_alone(thing, camera, _SAMPLES, light))
    return drawn


def of_no_class(rng: np.random.Generator, parts: Parts) -> None:
    """Two to six limbs and boxes that hang together, about a metre and a half large."""
    joints = [parts.at(up=0.75)]
    for _ in range(int(rng.integers(2, 7))):
        start = joints[int(rng.integers(len(joints)))]
        if rng.random() < 0.3:
            parts.box(start + _step(rng, parts, 0.1), np.exp(rng.uniform(np.log(0.06), np.log(0.4), 3)), _surface(rng))
            continue
        end = start + _step(rng, parts, 0.45)
        end[2] = np.clip(end[2], 0.1, 1.6)
        thick = np.exp(rng.uniform(np.log(0.05), np.log(0.3), 2))
        radii = float(thick[0]), float(thick[1])
        parts.cone(start, end, radii, _surface(rng), float(rng.uniform(0.4, 1.0)), along(parts.yaw))
        joints.append(end)


def _step(rng: np.random.Generator, parts: Parts, size: float) -> FloatArray:
    """``(3,)`` any way in the thing's own axes, metres."""
    ahead, left, up = rng.normal(0, size, 3).tolist()
    return np.asarray(parts.at(ahead, left, up) - parts.base)


def _surface(rng: np.random.Generator) -> Surface:
    """Any colours, and often a pattern of the second one."""
    pattern = int(rng.choice([*Pattern])) if rng.random() < 0.6 else Pattern.PLAIN
    period, phase = float(np.exp(rng.uniform(np.log(0.05), np.log(0.6)))), float(rng.uniform(0, 6))
    return Surface(any_colour(rng), any_colour(rng), pattern, period, float(rng.uniform(0.03, 0.3)), phase=phase)
