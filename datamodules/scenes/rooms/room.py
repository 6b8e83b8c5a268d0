"""A textured room seen from inside: floor, walls and furniture, drawn once for each fixed camera."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.render.raster import RayCamera, ray_grid
from tsuiseki.datamodules.scenes.render.scene import Picture, Thing, compose, empty_picture, shadows
from tsuiseki.datamodules.scenes.render.shading import Light, noise_at, pattern_value
from tsuiseki.datamodules.scenes.render.solids import (
    BRICKS,
    CHECKS,
    CLOUDS,
    PLAIN,
    STRIPES_ACROSS,
    STRIPES_ALONG,
    Float32,
    Surfaces,
    boxes,
)

HALF_SIZE = (6.5, 6.5)
HEIGHT = 3.4
FLOOR, CEILING = 4, 5

# Colours (sRGB), pattern and its period in metres of the walls x+, x-, y+, y-, of the floor and of the ceiling.
SURFACES: tuple[tuple[tuple[float, float, float], tuple[float, float, float], int, float], ...] = (
    ((0.72, 0.70, 0.64), (0.58, 0.60, 0.62), CLOUDS, 1.6),
    ((0.62, 0.66, 0.70), (0.76, 0.74, 0.70), STRIPES_ALONG, 0.9),
    ((0.70, 0.62, 0.54), (0.50, 0.42, 0.36), BRICKS, 0.35),
    ((0.66, 0.70, 0.62), (0.56, 0.58, 0.52), STRIPES_ACROSS, 1.1),
    ((0.60, 0.52, 0.42), (0.48, 0.40, 0.32), CHECKS, 1.2),
    ((0.85, 0.85, 0.84), (0.80, 0.80, 0.80), PLAIN, 1.0),
)
GRAIN = 0.25


@dataclass(frozen=True)
class Room:
    """What a fixed camera sees of the empty room.

    Attributes:
        picture: with the furniture in it.
        direct: ``(H, W, 3)`` the part of the light on the floor that a shadow takes away, linear.
    """

    picture: Picture
    direct: Float32


def draw_room(camera: RayCamera, light: Light, furniture: list[Thing], samples: int) -> Room:
    """The empty room around the world's origin, with ``samples`` by ``samples`` rays a pixel."""
    width, height = camera.width * samples, camera.height * samples
    rays = ray_grid(camera, samples, 0, 0, width, height).reshape(3, -1)
    distance, face = _walls(rays, camera.position.astype(np.float32))
    points = camera.position.astype(np.float32)[:, None] + rays * distance
    albedo = _albedo(points, face)
    upward = (face == FLOOR).astype(np.float32)
    normals = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float32)
    ambient = 0.5 * (1 + normals[face, 2:]) * light.sky + 0.5 * (1 - normals[face, 2:]) * light.ground
    facing = np.maximum(normals @ light.direction, 0)[face][:, None] * light.sun
    colour = _by_pixel(albedo * (ambient + facing), camera, samples)
    direct = _by_pixel(albedo * facing * upward[:, None], camera, samples)
    shade = shadows(furniture, camera, light.direction, softness=2.0)
    picture, _ = compose(empty_picture(colour - direct * shade[:, :, None], samples), furniture, camera, light)
    # Shadows of what moves must not darken furniture, nor the floor where it is dark already.
    return Room(picture, direct * (picture.open_ground * (1 - shade))[:, :, None])


def random_furniture(rng: np.random.Generator, pieces: int = 7) -> list[Thing]:
    """Boxes along the walls, in several colours and patterns."""
    angle = rng.permutation(pieces) * (2 * np.pi / pieces) + rng.uniform(-0.2, 0.2, pieces)
    size = np.stack([rng.uniform(0.25, 0.7, pieces), rng.uniform(0.2, 0.4, pieces), rng.uniform(0.3, 1.0, pieces)], 1)
    reach = np.minimum(5.9 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle))), 7.0)
    centre = np.stack([reach * np.cos(angle), reach * np.sin(angle), size[:, 2]], axis=1)
    surfaces = Surfaces()
    for _ in range(pieces):
        first, second = rng.uniform(0.2, 0.85, (2, 3))
        pattern = int(rng.choice([PLAIN, STRIPES_ACROSS, STRIPES_ALONG, CHECKS, CLOUDS]))
        colours = [(float(c[0]), float(c[1]), float(c[2])) for c in (first, second)]
        surfaces.add(colours[0], colours[1], pattern, float(rng.uniform(0.2, 0.6)), 0.05, phase=float(rng.random()))
    return [Thing(boxes(centre, size, angle + np.pi / 2, surfaces))]


def _walls(rays: Float32, origin: Float32) -> tuple[Float32, np.ndarray[tuple[int, ...], np.dtype[np.int64]]]:
    """Distances ``(N,)`` to the walls along rays ``(3, N)`` from inside, and which wall it is."""
    planes = np.array([HALF_SIZE[0], -HALF_SIZE[0], HALF_SIZE[1], -HALF_SIZE[1], 0.0, HEIGHT], dtype=np.float32)
    axis = [0, 0, 1, 1, 2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (planes - origin[axis])[:, None] / rays[axis]
    reach = np.where(reach > 1e-6, reach, np.float32(np.inf))
    face = reach.argmin(axis=0)
    return reach.min(axis=0), face


def _albedo(points: Float32, face: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> Float32:
    """Linear reflectances ``(N, 3)`` of points ``(3, N)`` on the walls."""
    colour = np.empty((points.shape[1], 3), dtype=np.float32)
    for code, (first, second, pattern, period) in enumerate(SURFACES):
        at = face == code
        if not at.any():
            continue
        x, y, z = points[:, at]
        u, v = (x, y) if code in (FLOOR, CEILING) else (y, z) if code < 2 else (x, z)
        ones = np.ones(len(u), dtype=np.float32)
        mix = 0 * ones if pattern == PLAIN else pattern_value(pattern, u, v, period * ones, 0.3 * ones)
        base = np.square(np.array([first, second], dtype=np.float32))
        grain = 1 + np.float32(GRAIN) * (noise_at(u * 60, v * 60) + noise_at(u * 13 + 91, v * 13) - 1)
        colour[at] = (base[0] + mix[:, None] * (base[1] - base[0])) * grain[:, None]
    return colour


def _by_pixel(fine: Float32, camera: RayCamera, samples: int) -> Float32:
    """Means over each pixel's subpixels of ``(H * W * samples^2, 3)`` values."""
    image = fine.astype(np.float32).reshape(camera.height * samples, camera.width * samples, 3)
    return np.asarray(cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA))
