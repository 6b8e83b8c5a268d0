"""What stands about besides people: poles, signs, bins, cars, benches, bushes, trees, buildings, odd columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from tsuiseki.datamodules.scenes.people.outfit import DARK, LIGHT, MIDDLE, any_colour, colour_of
from tsuiseki.datamodules.scenes.render.scene import Thing
from tsuiseki.datamodules.scenes.render.solids import (
    UP,
    Parts,
    Pattern,
    RayCamera,
    Solids,
    Surface,
    above,
    across,
    along,
    extents,
)
from tsuiseki.datamodules.scenes.things.town import Maker, front, random_thing
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray


def pole(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A lamp post, a sign post, a bollard; some carry a sign or a lamp."""
    height, radius = rng.uniform(0.8, 7.0), rng.uniform(0.03, 0.12)
    colour = colour_of(rng, DARK + MIDDLE + LIGHT[:2])
    pattern = Pattern.ACROSS if rng.random() < 0.15 else Pattern.PLAIN
    surface = Surface(colour, any_colour(rng), pattern, float(rng.uniform(0.2, 0.8)), 0.05)
    parts, top = Parts(), above(position, height)
    parts.cone(above(position), top, (radius, radius * rng.uniform(0.5, 1.0)), surface)
    if height > 4 and rng.random() < 0.5:
        arm = np.array([np.cos(yaw), np.sin(yaw), 0.15]) * rng.uniform(0.4, 1.5)
        parts.cone(top, top + arm, (radius * 0.6, radius), Surface(colour, relief=0.05))
    if rng.random() < 0.45:
        _panel(rng, parts, position, yaw, height)
    return parts.solids()


def _panel(rng: np.random.Generator, parts: Parts, position: FloatArray, yaw: float, height: float) -> None:
    half = np.array([rng.uniform(0.15, 0.5), 0.02, rng.uniform(0.15, 0.45)])
    z = max(height - half[2] - rng.uniform(0, 0.3) * height, half[2])
    first, second = any_colour(rng), any_colour(rng)
    pattern = int(rng.choice([Pattern.PLAIN, Pattern.ACROSS, Pattern.SPECKLE]))
    parts.box(above(position, z), half, yaw, Surface(first, second, pattern, float(rng.uniform(0.1, 0.5)), 0.04))


def crate(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A box, a bin, a cabinet, a stack of two."""
    half = rng.uniform([0.15, 0.15, 0.15], [0.7, 0.7, 0.9])
    patterns = [Pattern.PLAIN, Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS, Pattern.CLOUDS, Pattern.WINDOWS]
    first, second, pattern = any_colour(rng), any_colour(rng), int(rng.choice(patterns))
    parts = Parts()
    parts.box(above(position, half[2]), half, yaw, Surface(first, second, pattern, float(rng.uniform(0.1, 0.6)), 0.06))
    if rng.random() < 0.5:
        upper = half * rng.uniform(0.4, 1.05, 3)
        parts.box(above(position, 2 * half[2] + upper[2]), upper, yaw, Surface(any_colour(rng), relief=0.06))
    return parts.solids()


def bench(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A seat, a back and two feet; without the back a table."""
    width = rng.uniform(0.6, 1.2)
    wood, feet = (Surface(colour_of(rng, palette), relief=0.08) for palette in (MIDDLE + DARK, DARK))
    base, parts = above(position), Parts()
    parts.box(base + 0.45 * UP, [width, 0.22, 0.03], yaw, wood)
    parts.box(base + 0.65 * UP - 0.2 * across(yaw), [width, 0.02, 0.2], yaw, wood)
    for s in (-1, 1):
        parts.box(base + 0.22 * UP + s * 0.8 * width * along(yaw), [0.04, 0.2, 0.22], yaw, feet)
    return parts.solids()


def car(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A parked car or van: body, cabin with dark windows, wheels, lights."""
    van = rng.random() < 0.25
    length, width, body = rng.uniform(1.7, 2.3), rng.uniform(0.8, 0.95), rng.uniform(0.28, 0.4)
    cabin = rng.uniform(0.45, 0.7) if van else rng.uniform(0.25, 0.33)
    paint, base, parts = Surface(any_colour(rng), relief=0.03), above(position), Parts()
    back, top, reach = -0.1 * length * along(yaw), 0.25 + 2 * body, 0.95 if van else 0.55
    parts.box(base + (0.25 + body) * UP, [length, width, body], yaw, paint)
    windows = [reach * length, 0.92 * width, 0.6 * cabin]
    parts.box(base + (top + 0.6 * cabin) * UP + back, windows, yaw, Surface((0.08, 0.09, 0.11), relief=0.05))
    roof = [reach * length * 0.92, 0.85 * width, 0.4 * cabin]
    parts.box(base + (top + 1.6 * cabin) * UP + back, roof, yaw, paint)
    for s in (-1, 1):
        for t in (-1, 1):
            hub = base + s * 0.62 * length * along(yaw) + t * 0.9 * width * across(yaw) + 0.3 * UP
            parts.cone(hub, hub + 0.08 * t * across(yaw), (0.3, 0.28), Surface((0.07, 0.07, 0.07), relief=0.05))
    return parts.solids()


def bush(rng: np.random.Generator, position: FloatArray, _: float) -> Solids:
    """A bush or, on a trunk, a tree."""
    tree = rng.random() < 0.45
    size, low, parts = rng.uniform(0.25, 0.9), 0.0, Parts()
    green = colour_of(rng, ((0.20, 0.32, 0.13), (0.32, 0.42, 0.18), (0.38, 0.36, 0.18), (0.45, 0.30, 0.16)))
    second = (green[0] * 0.35, green[1] * 0.4, green[2] * 0.35)
    if tree:
        low, size = rng.uniform(1.5, 3.0), rng.uniform(0.7, 1.6)
        bark = Surface((0.27, 0.21, 0.16), (0.15, 0.12, 0.1), Pattern.SPECKLE, 0.3, 0.2)
        parts.cone(above(position), above(position, low + size), (rng.uniform(0.07, 0.2), 0.06), bark)
    for _ in range(int(rng.integers(4, 10))):
        middle = above(position, low + size * rng.uniform(0.3, 1.3)) + rng.normal(0, 0.45 * size, 3) * [1, 1, 0.3]
        radius = size * rng.uniform(0.3, 0.65)
        leaves = Surface(
            green, second, Pattern.LEAVES, float(rng.uniform(0.6, 2.5)), 0.02, phase=float(rng.uniform(0, 100))
        )
        parts.cone(middle, middle + rng.normal(0, 0.3 * size, 3), (radius, radius * 0.8), leaves)
    return parts.solids()


def column(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """Upright pieces in colours that clothes have, as tall as people and yet none: bags, hydrants, parasols, cones."""
    height, z = rng.uniform(0.5, 2.2), 0.0
    pieces, rows, parts = int(rng.integers(1, 5)), [], Parts()
    for k in range(pieces):
        step = height / pieces * rng.uniform(0.6, 1.2)
        radius = rng.uniform(0.05, 0.32, 2)
        lean = rng.normal(0, 0.05, 3) * [1, 1, 0]
        first, second = any_colour(rng), any_colour(rng)
        surface = Surface(
            first, second, int(rng.choice([Pattern.PLAIN, Pattern.PLAIN, Pattern.ACROSS, Pattern.SPECKLE])), 0.2, 0.1
        )
        end = above(position, z + step) + lean * k
        rows.append((above(position, z), end, (float(radius[0]), float(radius[1])), surface))
        z += step
    flat = float(rng.uniform(0.5, 1.0))
    for row in rows:
        parts.cone(*row, flat)
    if rng.random() < 0.2:
        _panel(rng, parts, position, yaw, z + 0.3)
    return parts.solids()


def tripod(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """Thin legs or a rack: many slanted bars, as limbs are."""
    colour, parts = colour_of(rng, DARK + LIGHT[:2]), Parts()
    top = above(position, rng.uniform(0.8, 1.8))
    count = int(rng.integers(2, 5))
    for k in range(count):
        angle = yaw + 2 * np.pi * k / count
        foot = above(position) + rng.uniform(0.2, 0.6) * np.array([np.cos(angle), np.sin(angle), 0])
        parts.cone(foot, top, (0.02, 0.03), Surface(colour, relief=0.05))
    head = Surface(any_colour(rng), relief=0.1)
    end = top + rng.uniform(0.05, 0.4) * UP
    parts.cone(top, end, (rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.1)), head)
    return parts.solids()


def building(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A block with rows of windows, a plinth and perhaps a door."""
    half = rng.uniform([5, 3, 2.0], [22, 9, 6])
    wall = colour_of(rng, MIDDLE + LIGHT[:3] + ((0.55, 0.38, 0.28), (0.62, 0.48, 0.36)))
    glass = tuple(float(v) for v in np.array([0.16, 0.18, 0.22]) * rng.uniform(0.5, 2.2))
    rows = float(rng.uniform(1.2, 3.2))
    front = Surface(wall, glass, Pattern.WINDOWS, rows, 0.03, phase=float(rng.uniform(0, 1)))  # type: ignore[arg-type]
    pattern = Pattern.BRICKS if rng.random() < 0.6 else Pattern.PLAIN
    grout = (0.8 * wall[0] + 0.1, 0.8 * wall[1] + 0.1, 0.8 * wall[2] + 0.1)
    base = Surface(wall, grout, pattern, float(rng.uniform(0.1, 0.3)), 0.03)
    plinth, parts = rng.uniform(0.3, 1.0), Parts()
    parts.box(above(position, half[2]), half, yaw, front)
    parts.box(above(position, plinth), [half[0] + 0.05, half[1] + 0.05, plinth], yaw, base)
    return parts.solids()


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


def covered_share(solids: Solids, camera: RayCamera) -> float:
    """Share of the image in the rectangle about ``solids``; infinite where they reach behind the camera."""
    rects = extents(solids, camera)
    if not np.isfinite(rects).all():
        return float("inf")
    size = np.array([camera.width, camera.height])
    low, high = np.clip(rects[:, :2].min(axis=0), 0, size), np.clip(rects[:, 2:].max(axis=0), 0, size)
    return float(np.prod(high - low) / np.prod(size))


def reach_of(solids: Solids, spot: FloatArray) -> float:
    """Metres from ``spot`` ``(2,)`` to the outermost point of ``solids``, roughly."""
    away = np.linalg.norm(solids.start[:, :2] - spot, axis=1)
    size = np.where(solids.box, solids.scale[:, :2].max(axis=1), solids.radius.max(axis=1))
    return float((away + size).max())


def clutter_around(
    rng: np.random.Generator,
    camera: AnyCamera,
    count: int,
    taken: FloatArray,
    largest: float,
    make: Callable[[np.random.Generator, FloatArray], Thing] = small_thing,
) -> list[Thing]:
    """Up to ``count`` things at random places in view.

    They keep clear of the places ``taken`` ``(N, 2)``, and none covers more of the image than ``largest``.
    ``make`` gives one that stands at a place.
    """
    feet = rng.uniform([-0.05, 0.0], [1.05, 1.3], (4 * count + 8, 2)) * [camera.width, camera.height]
    spots = camera.ground(feet)[:, :2]
    spots = spots[np.isfinite(spots).all(axis=1) & (np.linalg.norm(spots, axis=1) < 60)]
    things: list[Thing] = []
    for spot in spots:
        if len(things) == count:
            break
        thing = make(rng, spot)
        clear = len(taken) == 0 or np.linalg.norm(taken - spot, axis=1).min() > 0.4 + reach_of(thing.solids, spot)
        if clear and covered_share(thing.solids, camera) < largest:
            things.append(thing)
    return things


def buildings_behind(rng: np.random.Generator, count: int, distance: float) -> list[Thing]:
    """Buildings at more than ``distance`` metres from the origin, along +y."""
    places = (np.array([rng.uniform(-30, 30), distance + rng.uniform(16, 45)]) for _ in range(count))
    return [Thing(building(rng, place, float(rng.normal(0, 0.25)))) for place in places]


def fronts_behind(rng: np.random.Generator, count: int, taken: FloatArray, reach: float) -> list[Thing]:
    """Up to ``count`` walls of a town along +y, behind most of the places ``taken`` ``(N, 2)`` and clear of them.

    ``reach`` is how far those lie, metres.
    """
    things = []
    for _ in range(count):
        distance = reach * float(rng.uniform(0.75, 1.8))
        place = np.array([rng.uniform(-0.7, 0.7) * distance, distance])
        angle = float(rng.normal(0, 0.35)) if rng.random() < 0.75 else float(rng.uniform(0, np.pi))
        along = np.array([np.cos(angle), np.sin(angle)])
        offset = taken - place
        beside = np.abs(offset @ [-along[1], along[0]])
        if not ((beside < 0.7) & (np.abs(offset @ along) < 8.0)).any():
            things.append(Thing(front(rng, place, angle)))
    return things
