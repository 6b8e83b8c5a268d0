"""The ground as a map drawn once, from which every frame of a moving camera is cut by a homography."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.drone.flight import ground_to_pixels
from tsuiseki.datamodules.scenes.render.ground import Ground, ground_colour
from tsuiseki.datamodules.scenes.render.scene import Thing, shadows
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray

# Largest side of the map in widths of a frame, and pixels of a frame between two points of the grid of distances.
LARGEST = 2.4
GRID = 40


@dataclass(frozen=True)
class GroundMap:
    """A picture of the ground from straight above, with coarser copies of it.

    Attributes:
        levels: ``(H, W, 3)`` uint8, each half the size of the one before; light after gamma 2.
        corner: ``(2,)`` metres of the first pixel's outer corner.
        cell: metres of a pixel of the first level.
    """

    levels: tuple[ImageArray, ...]
    corner: FloatArray
    cell: float


def map_ground(ground: Ground, cameras: list[PinholeCamera], light: Light) -> GroundMap:
    """The map of all that ``cameras`` see under ``light``."""
    low, high, finest = _seen(cameras)
    side = float((high - low).max())
    cell = max(finest, side / (LARGEST * cameras[0].width))
    columns, rows = np.ceil((high - low) / cell).astype(int)
    x = (low[0] + (np.arange(columns) + 0.5) * cell).astype(np.float32)
    y = (low[1] + (np.arange(rows) + 0.5) * cell).astype(np.float32)
    bright = light.direction[2] * light.sun + light.sky
    picture = np.empty((rows, columns, 3), dtype=np.uint8)
    # In bands that stay in the cache: the colour of the ground takes a dozen arrays of this size.
    for top in range(0, rows, 64):
        part = y[top : top + 64]
        xs, ys = np.broadcast_arrays(x[None, :], part[:, None])
        colour = np.clip(ground_colour(ground, xs, ys, np.full(xs.shape, cell, dtype=np.float32)), 0, 1)
        picture[top : top + 64] = np.clip(255 * colour * np.sqrt(bright) + 0.5, 0, 255)
    levels = [picture]
    while min(levels[-1].shape[:2]) > 64 and len(levels) < 5:
        small = levels[-1].shape[1] // 2, levels[-1].shape[0] // 2
        levels.append(np.asarray(cv2.resize(levels[-1], small, interpolation=cv2.INTER_AREA), dtype=np.uint8))
    return GroundMap(tuple(levels), low, cell)


def _seen(cameras: list[PinholeCamera]) -> tuple[FloatArray, FloatArray, float]:
    """Corners of the ground in view, metres, and the finest metres a pixel."""
    points, finest = [], np.inf
    for camera in cameras:
        edge = np.array([[x, y] for x in (0, camera.width) for y in (0, camera.height)], dtype=np.float64)
        points.append(camera.ground(edge)[:, :2])
        finest = min(finest, float(camera.position[2] / camera.focal[0]))
    found = np.concatenate(points)
    found = found[np.isfinite(found).all(axis=1)]
    return found.min(axis=0) - 1.0, found.max(axis=0) + 1.0, finest


def look_down(ground: GroundMap, camera: PinholeCamera) -> ImageArray:
    """The frame of ``camera`` with nothing but ground: ``(H, W, 3)`` uint8, light after gamma 2.

    Where a pixel covers several of the map, a coarser level is used, so that nothing flickers.
    """
    size = camera.width, camera.height
    wanted = np.log2(np.maximum(_footprints(camera) / ground.cell, 1.0))
    first = int(np.clip(np.floor(wanted.min()), 0, len(ground.levels) - 1))
    last = int(np.clip(np.ceil(wanted.max() - 0.25), first, len(ground.levels) - 1))
    frame = _cut(ground, first, camera)
    for level in range(first + 1, last + 1):
        share = np.clip(wanted - (level - 1), 0, 1).astype(np.float32)
        weight = cv2.resize(share, size, interpolation=cv2.INTER_LINEAR)
        used = np.flatnonzero(weight.max(axis=1) > 0)
        if not len(used):
            continue
        rows = slice(int(used[0]), int(used[-1]) + 1)
        coarse = _cut(ground, level, camera, rows)
        part = weight[rows]
        # cv2.blendLinear takes weights that it normalises itself.
        frame[rows] = cv2.blendLinear(coarse, np.ascontiguousarray(frame[rows]), part, 1 - part)
    return frame


def _cut(ground: GroundMap, level: int, camera: PinholeCamera, rows: slice | None = None) -> ImageArray:
    cell = ground.cell * 2**level
    # Pixel centres lie at .5, while OpenCV has them at whole numbers.
    to_metres = np.array([[cell, 0, ground.corner[0] + cell / 2], [0, cell, ground.corner[1] + cell / 2], [0, 0, 1]])
    top, bottom = (0, camera.height) if rows is None else (rows.start, rows.stop)
    shift = np.array([[1, 0, -0.5], [0, 1, -0.5 - top], [0, 0, 1.0]])
    matrix = shift @ ground_to_pixels(camera) @ to_metres
    return np.asarray(
        cv2.warpPerspective(
            ground.levels[level],
            matrix,
            (camera.width, bottom - top),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        dtype=np.uint8,
    )


def _footprints(camera: PinholeCamera) -> FloatArray:
    """Metres of the ground that a pixel covers along its longer side, on a coarse grid."""
    columns, rows = camera.width // GRID + 1, camera.height // GRID + 1
    x, y = np.meshgrid(np.linspace(0, camera.width, columns), np.linspace(0, camera.height, rows))
    rays = camera.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    down = np.maximum(-rays[:, 2], 0.02)
    distance = camera.position[2] / down
    return np.asarray(distance / camera.focal[0] / np.sqrt(down)).reshape(rows, columns)


def dark_ground(things: list[Thing], camera: PinholeCamera, light: Light, softness: float) -> Float32:
    """``(H, W)`` factor in [0, 1] that the shadows of ``things`` leave of the light on the ground of a frame."""
    up = light.direction[2] * light.sun
    share = np.float32((up / np.maximum(up + light.sky, 1e-6)).mean())
    sun = shadows(things, camera, light.direction, softness)
    under = shadows(things, camera, np.array([0, 0, 1], dtype=np.float32), 2.0 + softness)
    return np.asarray((1 - share * sun) * (1 - np.float32(0.3) * under))
