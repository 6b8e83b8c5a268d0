"""What stands about and is nobody: poles, signs, bins, cars, benches, bushes, trees, buildings, odd columns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tsuiseki.datamodules.scenes.people.look import DARK, LIGHT, MIDDLE, any_colour, colour_of
from tsuiseki.datamodules.scenes.render.scene import Thing
from tsuiseki.datamodules.scenes.render.solids import (
    BRICKS,
    CHECKS,
    CLOUDS,
    LEAVES,
    PLAIN,
    SPECKLE,
    STRIPES_ACROSS,
    STRIPES_ALONG,
    UP,
    WINDOWS,
    RayCamera,
    Solids,
    Surfaces,
    above,
    boxes,
    extents,
    join,
    rounds,
)
from tsuiseki.datamodules.scenes.things.town import front
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray


def pole(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A lamp post, a sign post, a bollard; some carry a sign or a lamp."""
    height, radius = rng.uniform(0.8, 7.0), rng.uniform(0.03, 0.12)
    surfaces = Surfaces()
    colour = colour_of(rng, DARK + MIDDLE + LIGHT[:2])
    pattern = STRIPES_ACROSS if rng.random() < 0.15 else PLAIN
    surfaces.add(colour, any_colour(rng), pattern, float(rng.uniform(0.2, 0.8)), 0.05)
    rows = [(above(position), above(position, height), radius, radius * rng.uniform(0.5, 1.0))]
    if height > 4 and rng.random() < 0.5:
        arm = np.array([np.cos(yaw), np.sin(yaw), 0.15]) * rng.uniform(0.4, 1.5)
        surfaces.add(colour, relief=0.05)
        rows.append((rows[0][1], rows[0][1] + arm, radius * 0.6, radius))
    solids = rounds(rows, surfaces)
    return join([solids, _panel(rng, position, yaw, height)]) if rng.random() < 0.45 else solids


def _panel(rng: np.random.Generator, position: FloatArray, yaw: float, height: float) -> Solids:
    half = np.array([rng.uniform(0.15, 0.5), 0.02, rng.uniform(0.15, 0.45)])
    z = max(height - half[2] - rng.uniform(0, 0.3) * height, half[2])
    surfaces = Surfaces()
    surfaces.add(
        any_colour(rng), any_colour(rng), int(rng.choice([PLAIN, STRIPES_ACROSS, SPECKLE])),
        float(rng.uniform(0.1, 0.5)), 0.04,
    )  # fmt: skip
    return boxes(above(position, z)[None], half[None], np.array([yaw]), surfaces)


def crate(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A box, a bin, a cabinet, a stack of two."""
    half = rng.uniform([0.15, 0.15, 0.15], [0.7, 0.7, 0.9])
    surfaces = Surfaces()
    patterns = [PLAIN, STRIPES_ACROSS, STRIPES_ALONG, CHECKS, CLOUDS, WINDOWS]
    surfaces.add(any_colour(rng), any_colour(rng), int(rng.choice(patterns)), float(rng.uniform(0.1, 0.6)), 0.06)
    centres, halves = [above(position, half[2])], [half]
    if rng.random() < 0.5:
        upper = half * rng.uniform(0.4, 1.05, 3)
        surfaces.add(any_colour(rng), relief=0.06)
        centres.append(above(position, 2 * half[2] + upper[2]))
        halves.append(upper)
    return boxes(np.array(centres), np.array(halves), np.full(len(centres), yaw), surfaces)


def bench(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A seat, a back and two feet; without the back a table."""
    width, along = rng.uniform(0.6, 1.2), np.array([np.cos(yaw), np.sin(yaw), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    colour, feet = colour_of(rng, MIDDLE + DARK), colour_of(rng, DARK)
    base = above(position)
    rows = [
        (base + 0.45 * UP, [width, 0.22, 0.03], colour),
        (base + 0.65 * UP - 0.2 * across, [width, 0.02, 0.2], colour),
    ]
    rows += [(base + 0.22 * UP + s * 0.8 * width * along, [0.04, 0.2, 0.22], feet) for s in (-1, 1)]
    surfaces = Surfaces()
    for row in rows:
        surfaces.add(row[2], relief=0.08)
    return boxes(np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.full(4, yaw), surfaces)


def car(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A parked car or van: body, cabin with dark windows, wheels, lights."""
    van = rng.random() < 0.25
    length, width, body = rng.uniform(1.7, 2.3), rng.uniform(0.8, 0.95), rng.uniform(0.28, 0.4)
    cabin = rng.uniform(0.45, 0.7) if van else rng.uniform(0.25, 0.33)
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    paint, base = any_colour(rng), above(position)
    surfaces = Surfaces()
    surfaces.add(paint, relief=0.03)
    surfaces.add((0.08, 0.09, 0.11), relief=0.05)
    surfaces.add(paint, relief=0.03)
    back = -0.1 * length * along
    top = 0.25 + 2 * body
    centres = [
        base + (0.25 + body) * UP,
        base + (top + 0.6 * cabin) * UP + back,
        base + (top + 1.6 * cabin) * UP + back,
    ]
    reach = 0.95 if van else 0.55
    halves = [
        [length, width, body],
        [reach * length, 0.92 * width, 0.6 * cabin],
        [reach * length * 0.92, 0.85 * width, 0.4 * cabin],
    ]
    hull = boxes(np.array(centres), np.array(halves), np.full(3, yaw), surfaces)
    wheels = Surfaces()
    rows = []
    for s in (-1, 1):
        for t in (-1, 1):
            hub = base + s * 0.62 * length * along + t * 0.9 * width * across + 0.3 * UP
            rows.append((hub, hub + 0.08 * t * across, 0.3, 0.28))
            wheels.add((0.07, 0.07, 0.07), relief=0.05)
    return join([hull, rounds(rows, wheels)])


def bush(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A bush or, on a trunk, a tree."""
    del yaw
    tree = rng.random() < 0.45
    size, low = rng.uniform(0.25, 0.9), 0.0
    rows: list[tuple[FloatArray, FloatArray, float, float]] = []
    surfaces = Surfaces()
    green = colour_of(rng, ((0.20, 0.32, 0.13), (0.32, 0.42, 0.18), (0.38, 0.36, 0.18), (0.45, 0.30, 0.16)))
    second = (green[0] * 0.35, green[1] * 0.4, green[2] * 0.35)
    if tree:
        low, size = rng.uniform(1.5, 3.0), rng.uniform(0.7, 1.6)
        surfaces.add((0.27, 0.21, 0.16), (0.15, 0.12, 0.1), SPECKLE, 0.3, 0.2)
        rows.append((above(position), above(position, low + size), rng.uniform(0.07, 0.2), 0.06))
    for _ in range(int(rng.integers(4, 10))):
        middle = above(position, low + size * rng.uniform(0.3, 1.3)) + rng.normal(0, 0.45 * size, 3) * [1, 1, 0.3]
        radius = size * rng.uniform(0.3, 0.65)
        surfaces.add(green, second, LEAVES, float(rng.uniform(0.6, 2.5)), 0.02, phase=float(rng.uniform(0, 100)))
        rows.append((middle, middle + rng.normal(0, 0.3 * size, 3), radius, radius * 0.8))
    return rounds(rows, surfaces)


def column(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """Upright pieces in colours that clothes have, as tall as people and yet none: bags, hydrants, parasols, cones."""
    rows: list[tuple[FloatArray, FloatArray, float, float]] = []
    surfaces = Surfaces()
    height, z = rng.uniform(0.5, 2.2), 0.0
    pieces = int(rng.integers(1, 5))
    for k in range(pieces):
        step = height / pieces * rng.uniform(0.6, 1.2)
        radius = rng.uniform(0.05, 0.32, 2)
        lean = rng.normal(0, 0.05, 3) * [1, 1, 0]
        surfaces.add(
            any_colour(rng), any_colour(rng), int(rng.choice([PLAIN, PLAIN, STRIPES_ACROSS, SPECKLE])), 0.2, 0.1
        )
        rows.append((above(position, z), above(position, z + step) + lean * k, float(radius[0]), float(radius[1])))
        z += step
    solids = rounds(rows, surfaces, float(rng.uniform(0.5, 1.0)))
    return join([solids, _panel(rng, position, yaw, z + 0.3)]) if rng.random() < 0.2 else solids


def tripod(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """Thin legs or a rack: many slanted bars, as limbs are."""
    surfaces = Surfaces()
    colour = colour_of(rng, DARK + LIGHT[:2])
    top = above(position, rng.uniform(0.8, 1.8))
    count = int(rng.integers(2, 5))
    rows = []
    for k in range(count):
        angle = yaw + 2 * np.pi * k / count
        foot = above(position) + rng.uniform(0.2, 0.6) * np.array([np.cos(angle), np.sin(angle), 0])
        surfaces.add(colour, relief=0.05)
        rows.append((foot, top, 0.02, 0.03))
    surfaces.add(any_colour(rng), relief=0.1)
    rows.append((top, top + rng.uniform(0.05, 0.4) * UP, rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.1)))
    return rounds(rows, surfaces)


def building(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A block with rows of windows, a plinth and perhaps a door."""
    half = rng.uniform([5, 3, 2.0], [22, 9, 6])
    surfaces = Surfaces()
    wall = colour_of(rng, MIDDLE + LIGHT[:3] + ((0.55, 0.38, 0.28), (0.62, 0.48, 0.36)))
    glass = tuple(float(v) for v in np.array([0.16, 0.18, 0.22]) * rng.uniform(0.5, 2.2))
    surfaces.add(wall, glass, WINDOWS, float(rng.uniform(1.2, 3.2)), 0.03, phase=float(rng.uniform(0, 1)))  # type: ignore[arg-type]
    pattern = BRICKS if rng.random() < 0.6 else PLAIN
    grout = (0.8 * wall[0] + 0.1, 0.8 * wall[1] + 0.1, 0.8 * wall[2] + 0.1)
    surfaces.add(wall, grout, pattern, float(rng.uniform(0.1, 0.3)), 0.03)
    plinth = rng.uniform(0.3, 1.0)
    centres = np.array([above(position, half[2]), above(position, plinth)])
    halves = np.array([half, half + np.array([0.05, 0.05, 0])])
    halves[1, 2] = plinth
    return boxes(centres, halves, np.full(2, yaw), surfaces)


SMALL = (pole, crate, bench, car, bush, column, tripod)
SHARES = (0.26, 0.16, 0.07, 0.13, 0.14, 0.16, 0.08)


def random_clutter(rng: np.random.Generator, position: FloatArray) -> Solids:
    """One thing that is nobody, standing at ``position`` ``(2,)``."""
    make = SMALL[int(rng.choice(len(SMALL), p=SHARES))]
    return make(rng, position, float(rng.uniform(0, 2 * np.pi)))


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
    camera: PinholeCamera,
    count: int,
    taken: FloatArray,
    largest: float,
    make: Callable[[np.random.Generator, FloatArray], Solids] = random_clutter,
) -> list[Thing]:
    """Up to ``count`` things that are nobody at random places in view.

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
        solids = make(rng, spot)
        clear = len(taken) == 0 or np.linalg.norm(taken - spot, axis=1).min() > 0.4 + reach_of(solids, spot)
        if clear and covered_share(solids, camera) < largest:
            things.append(Thing(solids))
    return things


def buildings_behind(rng: np.random.Generator, count: int, distance: float) -> list[Thing]:
    """Buildings at more than ``distance`` metres from the origin, along +y."""
    things = []
    for _ in range(count):
        place = np.array([rng.uniform(-30, 30), distance + rng.uniform(16, 45)])
        things.append(Thing(building(rng, place, float(rng.normal(0, 0.25)))))
    return things


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
