"""Textured rooms seen from inside: floor, walls and furniture, drawn once for each fixed camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.render.scene import Picture, Thing, by_pixel, compose, empty_picture, shadows
from tsuiseki.datamodules.scenes.render.shading import Light, noise_at, pattern_value
from tsuiseki.datamodules.scenes.render.solids import (
    Colour,
    Float32,
    Pattern,
    RayCamera,
    Surface,
    as_colour,
    boxes,
    ray_grid,
)
from tsuiseki.tracking.types import FloatArray

Corner = tuple[float, float, float]
FLOORS = (Pattern.PLAIN, Pattern.CHECKS, Pattern.ACROSS, Pattern.ALONG, Pattern.CLOUDS, Pattern.SPECKLE)
WALLS = (Pattern.PLAIN, Pattern.PLAIN, Pattern.CLOUDS, Pattern.ALONG, Pattern.BRICKS)
# Rows of the picture that are drawn at a time, so that memory stays small.
BAND = 64


@dataclass(frozen=True)
class Shell:
    """The room's box between two corners, metres, with surfaces x-, x+, y-, y+, floor, ceiling, and their grain."""

    low: Corner
    high: Corner
    surfaces: tuple[Surface, ...]
    grain: float


HALL = Shell(
    (-6.5, -6.5, 0.0),
    (6.5, 6.5, 3.4),
    (
        Surface((0.62, 0.66, 0.70), (0.76, 0.74, 0.70), Pattern.ALONG, 0.9),
        Surface((0.72, 0.70, 0.64), (0.58, 0.60, 0.62), Pattern.CLOUDS, 1.6),
        Surface((0.66, 0.70, 0.62), (0.56, 0.58, 0.52), Pattern.ACROSS, 1.1),
        Surface((0.70, 0.62, 0.54), (0.50, 0.42, 0.36), Pattern.BRICKS, 0.35),
        Surface((0.60, 0.52, 0.42), (0.48, 0.40, 0.32), Pattern.CHECKS, 1.2),
        Surface((0.85, 0.85, 0.84), (0.80, 0.80, 0.80), Pattern.PLAIN, 1.0),
    ),
    0.25,
)
"""The room of the sphere paper's clips, about the world's origin."""


def random_shell(rng: np.random.Generator, size: FloatArray) -> Shell:
    """Walls in light muted colours, a floor of any kind, a light ceiling."""
    wall = _muted(rng, 0.45, 0.85)
    sides = []
    for _ in range(4):
        first = wall if rng.random() < 0.7 else _muted(rng, 0.25, 0.85)
        sides.append(Surface(first, _beside(rng, first), int(rng.choice(WALLS)), float(rng.uniform(0.4, 1.5))))
    first = _muted(rng, 0.2, 0.75)
    floor = Surface(first, _beside(rng, first), int(rng.choice(FLOORS)), float(rng.uniform(0.3, 1.6)))
    ceiling = Surface((0.85, 0.85, 0.84), (0.8, 0.8, 0.8), Pattern.PLAIN, 1.0)
    return Shell((0.0, 0.0, 0.0), tuple(size.tolist()), (*sides, floor, ceiling), float(rng.uniform(0.05, 0.3)))


def _muted(rng: np.random.Generator, low: float, high: float) -> Colour:
    return as_colour(np.clip(rng.uniform(low, high) + rng.normal(0, 0.05, 3), 0.03, 0.95))


def _beside(rng: np.random.Generator, colour: Colour) -> Colour:
    return as_colour(np.clip(np.array(colour) * rng.uniform(0.6, 1.3) + rng.normal(0, 0.03, 3), 0.03, 0.95))


def random_furniture(rng: np.random.Generator, size: FloatArray, pieces: int) -> tuple[list[Thing], FloatArray]:
    """Desks, shelves and boxes along the walls and some in the room, and ``(M, 3)`` where they stand and how far."""
    things, rows = [], []
    for _ in range(pieces):
        half = np.array([rng.uniform(0.25, 0.8), rng.uniform(0.2, 0.4), rng.uniform(0.2, 0.6)])
        if rng.random() < 0.15:
            half[2] = rng.uniform(0.7, 1.0)
        side, along = int(rng.integers(4)), rng.uniform(0.1, 0.9)
        off = 0.05 + half[1] if rng.random() < 0.75 else rng.uniform(1.0, 1.6)
        yaw = (0.0 if side >= 2 else np.pi / 2) + rng.normal(0, 0.04)
        spot = np.array([along * size[0], along * size[1]])
        if side < 2:
            spot[0] = off if side == 0 else size[0] - off
        else:
            spot[1] = off if side == 2 else size[1] - off
        first = _muted(rng, 0.1, 0.9) if rng.random() < 0.6 else as_colour(rng.uniform(0.1, 0.85, 3))
        pattern = int(rng.choice([Pattern.PLAIN, Pattern.PLAIN, Pattern.CLOUDS, Pattern.ALONG, Pattern.CHECKS]))
        second, period = _beside(rng, first), float(rng.uniform(0.1, 0.5))
        surface = Surface(first, second, pattern, period, 0.05, phase=float(rng.random()))
        centre = np.array([[spot[0], spot[1], half[2]]])
        things.append(Thing(boxes(centre, half[None], np.array([yaw]), [surface])))
        rows.append([*spot, float(np.hypot(half[0], half[1]))])
    return things, np.array(rows, dtype=np.float64).reshape(-1, 3)


def hall_furniture(rng: np.random.Generator) -> list[Thing]:
    """Boxes along the walls of `HALL`, in several colours and patterns."""
    pieces = 7
    angle = rng.permutation(pieces) * (2 * np.pi / pieces) + rng.uniform(-0.2, 0.2, pieces)
    size = np.stack([rng.uniform(0.25, 0.7, pieces), rng.uniform(0.2, 0.4, pieces), rng.uniform(0.3, 1.0, pieces)], 1)
    reach = np.minimum(5.9 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle))), 7.0)
    centre = np.stack([reach * np.cos(angle), reach * np.sin(angle), size[:, 2]], axis=1)
    surfaces = []
    for _ in range(pieces):
        first, second = (as_colour(colour) for colour in rng.uniform(0.2, 0.85, (2, 3)))
        pattern = int(rng.choice([Pattern.PLAIN, Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS, Pattern.CLOUDS]))
        period, phase = float(rng.uniform(0.2, 0.6)), float(rng.random())
        surfaces.append(Surface(first, second, pattern, period, 0.05, phase=phase))
    return [Thing(boxes(centre, size, angle + np.pi / 2, surfaces))]


def draw_hall(camera: RayCamera, light: Light, furniture: list[Thing], samples: int) -> tuple[Picture, Float32]:
    """`HALL` as `draw_shell` draws a room."""
    rays = ray_grid(camera, samples, 0, 0, camera.width * samples, camera.height * samples)
    albedo, ambient, facing, floor = _lit(HALL, camera, rays, light)
    colour, direct = by_pixel(albedo * (ambient + facing), samples), by_pixel(albedo * facing * floor, samples)
    return _furnished(colour, direct, camera, light, furniture, samples)


def draw_shell(
    shell: Shell, camera: RayCamera, light: Light, furniture: list[Thing], samples: int
) -> tuple[Picture, Float32]:
    """The empty room, and ``(H, W, 3)`` the light on the floor that a shadow would take away, linear."""
    bands = []
    for top in range(0, camera.height, BAND):
        bottom = min(top + BAND, camera.height)
        rays = ray_grid(camera, samples, 0, top * samples, camera.width * samples, bottom * samples)
        albedo, ambient, facing, floor = _lit(shell, camera, rays, light)
        lamps = albedo * facing
        bands.append([by_pixel(v, samples) for v in (albedo * ambient + lamps, lamps * floor)])
    colour, direct = (np.concatenate(part) for part in zip(*bands, strict=True))
    return _furnished(colour, direct, camera, light, furniture, samples)


def _furnished(
    colour: Float32, direct: Float32, camera: RayCamera, light: Light, furniture: list[Thing], samples: int
) -> tuple[Picture, Float32]:
    """The room with furniture; shadows of what moves must not darken furniture, nor the floor where it is dark."""
    shade = shadows(furniture, camera, light.direction, softness=2.0)
    picture, _ = compose(empty_picture(colour - direct * shade[:, :, None], samples), furniture, camera, light)
    return picture, direct * (picture.open_ground * (1 - shade))[:, :, None]


def _lit(shell: Shell, camera: RayCamera, grid: Float32, light: Light) -> tuple[Float32, ...]:
    """What the rays of a grid ``(3, h, w)`` meet: reflectance, black for NaN, light from all about, light of lamps.

    Each is ``(h, w, 3)``; last is ``(h, w, 1)`` whether it is the floor.
    """
    origin, rays = camera.position.astype(np.float32), grid.reshape(3, -1)
    planes = np.array([end for ends in zip(shell.low, shell.high, strict=True) for end in ends], dtype=np.float32)
    axis = [0, 0, 1, 1, 2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (planes - origin[axis])[:, None] / rays[axis]
    reach = np.where(reach > 1e-6, reach, np.float32(np.inf))
    face = reach.argmin(axis=0)
    hit = np.isfinite(rays[0])
    points = origin[:, None] + np.where(hit, rays, 0) * np.where(hit, reach.min(axis=0), 0)
    albedo = _albedo(shell, points, face)
    albedo[~hit] = 0
    normals = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float32)
    ambient = 0.5 * (1 + normals[:, 2:]) * light.sky + 0.5 * (1 - normals[:, 2:]) * light.ground
    facing = np.maximum(normals @ light.direction, 0)[:, None] * light.sun
    met = albedo, ambient[face], facing[face], (face == 4)[:, None].astype(np.float32)
    return tuple(each.reshape(*grid.shape[1:], -1) for each in met)


def _albedo(shell: Shell, points: Float32, face: NDArray[np.int64]) -> Float32:
    """Linear reflectances ``(N, 3)`` of points ``(3, N)`` on the walls."""
    colour = np.empty((points.shape[1], 3), dtype=np.float32)
    for code, surface in enumerate(shell.surfaces):
        at = face == code
        if not at.any():
            continue
        x, y, z = points[:, at]
        u, v = (x, y) if code >= 4 else (y, z) if code < 2 else (x, z)
        ones = np.ones(len(u), dtype=np.float32)
        plain = surface.pattern == Pattern.PLAIN
        mix = 0 * ones if plain else pattern_value(surface.pattern, u, v, surface.period * ones, 0.3 * ones)
        base = np.square(np.array(surface[:2], dtype=np.float32))
        grain = 1 + np.float32(shell.grain) * (noise_at(u * 60, v * 60) + noise_at(u * 13 + 91, v * 13) - 1)
        colour[at] = (base[0] + mix[:, None] * (base[1] - base[0])) * grain[:, None]
    return colour
