"""What stands about besides people: poles, signs, bins, cars, benches, bushes, trees, buildings, odd columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from tsuiseki.datamodules.scenes.people.outfit import DARK, LIGHT, MIDDLE, any_colour, colour_of
from tsuiseki.datamodules.scenes.render.composing import Thing
from tsuiseki.datamodules.scenes.render.solids import Parts, Pattern, Solids, Surface, across, along, pattern_of
from tsuiseki.datamodules.scenes.render.tracing import extents
from tsuiseki.datamodules.scenes.things.town import Maker, front, grout_of, made, random_thing
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray


def pole(rng: np.random.Generator, parts: Parts) -> None:
    """A lamp post, a sign post, a bollard; some carry a sign or a lamp."""
    height, radius = rng.uniform(0.8, 7.0), rng.uniform(0.03, 0.12)
    colour = colour_of(rng, DARK + MIDDLE + LIGHT[:2])
    pattern = Pattern.ACROSS if rng.random() < 0.15 else Pattern.PLAIN
    surface = Surface(colour, any_colour(rng), pattern, float(rng.uniform(0.2, 0.8)), 0.05)
    top = parts.at(up=height)
    parts.cone(parts.at(), top, (radius, radius * rng.uniform(0.5, 1.0)), surface)
    if height > 4 and rng.random() < 0.5:
        arm = np.array([np.cos(parts.yaw), np.sin(parts.yaw), 0.15]) * rng.uniform(0.4, 1.5)
        parts.cone(top, top + arm, (radius * 0.6, radius), Surface(colour, relief=0.05))
    if rng.random() < 0.45:
        _panel(rng, parts, height)


def _panel(rng: np.random.Generator, parts: Parts, height: float) -> None:
    half = np.array([rng.uniform(0.15, 0.5), 0.02, rng.uniform(0.15, 0.45)])
    z = max(height - half[2] - rng.uniform(0, 0.3) * height, half[2])
    first, second = any_colour(rng), any_colour(rng)
    pattern = pattern_of(rng, Pattern.PLAIN, Pattern.ACROSS, Pattern.SPECKLE)
    parts.box(parts.at(up=z), half, Surface(first, second, pattern, float(rng.uniform(0.1, 0.5)), 0.04))


def crate(rng: np.random.Generator, parts: Parts) -> None:
    """A box, a bin, a cabinet, a stack of two."""
    half = rng.uniform([0.15, 0.15, 0.15], [0.7, 0.7, 0.9])
    patterns = (Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS, Pattern.CLOUDS, Pattern.WINDOWS)
    first, second, pattern = any_colour(rng), any_colour(rng), pattern_of(rng, Pattern.PLAIN, *patterns)
    parts.box(parts.at(up=half[2]), half, Surface(first, second, pattern, float(rng.uniform(0.1, 0.6)), 0.06))
    if rng.random() < 0.5:
        upper = half * rng.uniform(0.4, 1.05, 3)
        parts.box(parts.at(up=2 * half[2] + upper[2]), upper, Surface(any_colour(rng), relief=0.06))


def bench(rng: np.random.Generator, parts: Parts) -> None:
    """A seat, a back and two feet; without the back a table."""
    width = rng.uniform(0.6, 1.2)
    wood, feet = (Surface(colour_of(rng, palette), relief=0.08) for palette in (MIDDLE + DARK, DARK))
    parts.box(parts.at(up=0.45), [width, 0.22, 0.03], wood)
    parts.box(parts.at(0.0, -0.2, 0.65), [width, 0.02, 0.2], wood)
    for s in (-1, 1):
        parts.box(parts.at(s * 0.8 * width, 0.0, 0.22), [0.04, 0.2, 0.22], feet)


def car(rng: np.random.Generator, parts: Parts) -> None:
    """A parked car or van: body, cabin with dark windows, wheels, lights."""
    van = rng.random() < 0.25
    length, width, body = rng.uniform(1.7, 2.3), rng.uniform(0.8, 0.95), rng.uniform(0.28, 0.4)
    cabin = rng.uniform(0.45, 0.7) if van else rng.uniform(0.25, 0.33)
    paint, back = Surface(any_colour(rng), relief=0.03), -0.1 * length
    top, reach = 0.25 + 2 * body, 0.95 if van else 0.55
    parts.box(parts.at(up=0.25 + body), [length, width, body], paint)
    windows = [reach * length, 0.92 * width, 0.6 * cabin]
    parts.box(parts.at(back, 0.0, top + 0.6 * cabin), windows, Surface((0.08, 0.09, 0.11), relief=0.05))
    parts.box(parts.at(back, 0.0, top + 1.6 * cabin), [reach * length * 0.92, 0.85 * width, 0.4 * cabin], paint)
    for s in (-1, 1):
        for t in (-1, 1):
            hub = parts.at(s * 0.62 * length, t * 0.9 * width, 0.3)
            tyre = Surface((0.07, 0.07, 0.07), relief=0.05)
            parts.cone(hub, hub + 0.08 * t * across(parts.yaw), (0.3, 0.28), tyre)


def bush(rng: np.random.Generator, parts: Parts) -> None:
    """A bush or, on a trunk, a tree."""
    tree = rng.random() < 0.45
    size, low = rng.uniform(0.25, 0.9), 0.0
    green = colour_of(rng, ((0.20, 0.32, 0.13), (0.32, 0.42, 0.18), (0.38, 0.36, 0.18), (0.45, 0.30, 0.16)))
    second = (green[0] * 0.35, green[1] * 0.4, green[2] * 0.35)
    if tree:
        low, size = rng.uniform(1.5, 3.0), rng.uniform(0.7, 1.6)
        bark = Surface((0.27, 0.21, 0.16), (0.15, 0.12, 0.1), Pattern.SPECKLE, 0.3, 0.2)
        parts.cone(parts.at(), parts.at(up=low + size), (rng.uniform(0.07, 0.2), 0.06), bark)
    for _ in range(int(rng.integers(4, 10))):
        middle = parts.at(up=low + size * rng.uniform(0.3, 1.3)) + rng.normal(0, 0.45 * size, 3) * [1, 1, 0.3]
        radius, period = size * rng.uniform(0.3, 0.65), float(rng.uniform(0.6, 2.5))
        leaves = Surface(green, second, Pattern.LEAVES, period, 0.02, phase=float(rng.uniform(0, 100)))
        parts.cone(middle, middle + rng.normal(0, 0.3 * size, 3), (radius, radius * 0.8), leaves)


def column(rng: np.random.Generator, parts: Parts) -> None:
    """Upright pieces in colours that clothes have, as tall as people and yet none: bags, hydrants, parasols, cones."""
    height, z = rng.uniform(0.5, 2.2), 0.0
    pieces, rows = int(rng.integers(1, 5)), []
    for k in range(pieces):
        step = height / pieces * rng.uniform(0.6, 1.2)
        lower, upper = rng.uniform(0.05, 0.32, 2).tolist()
        lean = rng.normal(0, 0.05, 3) * [1, 1, 0]
        first, second = any_colour(rng), any_colour(rng)
        pattern = pattern_of(rng, Pattern.PLAIN, Pattern.PLAIN, Pattern.ACROSS, Pattern.SPECKLE)
        end = parts.at(up=z + step) + lean * k
        rows.append((parts.at(up=z), end, (lower, upper), Surface(first, second, pattern, 0.2, 0.1)))
        z += step
    flat = float(rng.uniform(0.5, 1.0))
    for row in rows:
        parts.cone(*row, flat)
    if rng.random() < 0.2:
        _panel(rng, parts, z + 0.3)


def tripod(rng: np.random.Generator, parts: Parts) -> None:
    """Thin legs or a rack: many slanted bars, as limbs are."""
    colour = colour_of(rng, DARK + LIGHT[:2])
    high, count = rng.uniform(0.8, 1.8), int(rng.integers(2, 5))
    top = parts.at(up=high)
    for k in range(count):
        foot = parts.at() + rng.uniform(0.2, 0.6) * along(parts.yaw + 2 * np.pi * k / count)
        parts.cone(foot, top, (0.02, 0.03), Surface(colour, relief=0.05))
    head = Surface(any_colour(rng), relief=0.1)
    end = parts.at(up=high + rng.uniform(0.05, 0.4))
    parts.cone(top, end, (rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.1)), head)


def building(rng: np.random.Generator, parts: Parts) -> None:
    """A block with rows of windows, a plinth and perhaps a door."""
    half = rng.uniform([5, 3, 2.0], [22, 9, 6])
    wall = colour_of(rng, MIDDLE + LIGHT[:3] + ((0.55, 0.38, 0.28), (0.62, 0.48, 0.36)))
    lit, storey = float(rng.uniform(0.5, 2.2)), float(rng.uniform(1.2, 3.2))
    windows = Surface(
        wall, (0.16 * lit, 0.18 * lit, 0.22 * lit), Pattern.WINDOWS, storey, 0.03, phase=float(rng.uniform(0, 1))
    )
    pattern = Pattern.BRICKS if rng.random() < 0.6 else Pattern.PLAIN
    base = Surface(wall, grout_of(wall), pattern, float(rng.uniform(0.1, 0.3)), 0.03)
    plinth = rng.uniform(0.3, 1.0)
    parts.box(parts.at(up=half[2]), half, windows)
    parts.box(parts.at(up=plinth), [half[0] + 0.05, half[1] + 0.05, plinth], base)


# How often each thing is drawn, as a share.
SMALL: Mapping[Maker, float] = {
    pole: 0.26, crate: 0.16, bench: 0.07, car: 0.13, bush: 0.14, column: 0.16, tripod: 0.08,
}  # fmt: skip
small_thing = partial(random_thing, kinds=SMALL)
"""Draws one thing, standing at a place."""


def apparent_heights(camera: PinholeCamera, spots: FloatArray) -> FloatArray:
    """Pixels ``(N,)`` between foot and head of a person of 1.7 m at ``spots`` ``(N, 2)``; 0 where that is not seen."""
    foot = np.concatenate([spots, np.zeros((len(spots), 1))], axis=1)
    low, depth = camera.project(np.nan_to_num(foot, nan=-1e6))
    high, above = camera.project(np.nan_to_num(foot + np.array([0, 0, 1.7]), nan=-1e6))
    size = np.linalg.norm(low - high, axis=1)
    return np.where((depth > 1.0) & (above > 1.0) & np.isfinite(size), size, 0.0)


def random_camera(
    rng: np.random.Generator, width: int, height: int, camera_height: tuple[float, float]
) -> PinholeCamera:
    """A surveillance camera over the origin that looks along +y, more or less down."""
    up = float(rng.uniform(*camera_height))
    tilt = float(rng.uniform(0.03, 0.25) + rng.uniform(0, 0.085) * up)
    focal = width * float(np.exp(rng.uniform(np.log(0.65), np.log(2.2))))
    forward = np.array([0.0, np.cos(tilt), -np.sin(tilt)])
    position = np.array([0.0, 0.0, up])
    return PinholeCamera.look_at(position, position + forward, focal, width, height, float(rng.normal(0, 0.025)))


def reach_of(solids: Solids, spot: FloatArray) -> float:
    """Metres from ``spot`` ``(2,)`` to the outermost point of ``solids``, roughly."""
    away = np.linalg.norm(solids.start[:, :2] - spot, axis=1)
    size = np.where(solids.box, solids.scale[:, :2].max(axis=1), solids.radius.max(axis=1))
    return float((away + size).max())


def clutter_around(
    rng: np.random.Generator,
    camera: AnyCamera,
    count: int,
    occupied: FloatArray,
    largest: float,
    make: Callable[[np.random.Generator, FloatArray], Thing] = small_thing,
) -> list[Thing]:
    """Up to ``count`` things at random places in view.

    They keep clear of the ``occupied`` places ``(N, 2)``, and none covers more of the image than ``largest``.
    ``make`` gives one that stands at a place.
    """
    size = np.array([camera.width, camera.height])
    feet = rng.uniform([-0.05, 0.0], [1.05, 1.3], (4 * count + 8, 2)) * size
    spots = camera.ground(feet)[:, :2]
    spots = spots[np.isfinite(spots).all(axis=1) & (np.linalg.norm(spots, axis=1) < 60)]
    things: list[Thing] = []
    for spot in spots:
        if len(things) == count:
            break
        thing = make(rng, spot)
        clear = len(occupied) == 0 or np.linalg.norm(occupied - spot, axis=1).min() > 0.4 + reach_of(thing.solids, spot)
        rects = extents(thing.solids, camera)
        if clear and np.isfinite(rects).all():
            low, high = np.clip(rects[:, :2].min(axis=0), 0, size), np.clip(rects[:, 2:].max(axis=0), 0, size)
            if np.prod(high - low) / np.prod(size) < largest:
                things.append(thing)
    return things


def buildings_behind(rng: np.random.Generator, count: int, distance: float) -> list[Thing]:
    """Buildings at more than ``distance`` metres from the origin, along +y."""
    places = (np.array([rng.uniform(-30, 30), distance + rng.uniform(16, 45)]) for _ in range(count))
    return [made(rng, building, place, float(rng.normal(0, 0.25))) for place in places]


def fronts_behind(rng: np.random.Generator, count: int, occupied: FloatArray, reach: float) -> list[Thing]:
    """Up to ``count`` walls of a town along +y, behind most of the ``occupied`` places ``(N, 2)`` and clear of them.

    ``reach`` is how far those lie, metres.
    """
    things = []
    for _ in range(count):
        distance = reach * float(rng.uniform(0.75, 1.8))
        place = np.array([rng.uniform(-0.7, 0.7) * distance, distance])
        angle = float(rng.normal(0, 0.35)) if rng.random() < 0.75 else float(rng.uniform(0, np.pi))
        aside, ahead = (np.abs((occupied - place) @ axis(angle)[:2]) for axis in (along, across))
        if not ((ahead < 0.7) & (aside < 8.0)).any():
            things.append(made(rng, front, place, angle))
    return things
