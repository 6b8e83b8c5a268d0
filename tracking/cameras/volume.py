"""Where in space cameras can see a ball together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

SMALLEST_RADIUS = 2.5
"""In pixels, of a ball that can be searched for."""
# Largest radius of a ball, share of the image height.
LARGEST_SHARE = 0.25
# How far about the cameras places are searched, metres.
FARTHEST = 15.0


def in_view(camera: PinholeCamera, points: FloatArray) -> BoolArray:
    """``(N,)`` whether ``camera`` has the ``(N, 3)`` points before it and within its image."""
    pixels, depth = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
    return np.asarray(inside & (depth > 0))


def common_volume(cameras: Sequence[PinholeCamera], radius: float) -> FloatArray:
    """``(2, 3)`` corners of a box, above z = 0, with all places where two cameras see the ball well.

    Well means a radius of at least two and a half pixels and at most a quarter of the image height.

    Raises:
        RequestError: there is no such place.
    """
    places = np.stack([camera.position for camera in cameras])
    low, high = places.min(axis=0) - FARTHEST, places.max(axis=0) + FARTHEST
    low[2], high[2] = 0.0, min(high[2], places[:, 2].max() + 3.0)
    axes = [np.linspace(a, b, 40) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    visible = _visible_well(cameras, radius, grid)
    good = grid[visible >= 2]
    if len(good) == 0:
        raise RequestError(
            f"expected cameras that can see a ball of {radius:g} m together above z = 0, found no such place; "
            "check the camera file and the radius, or give `volume`"
        )
    step = np.array([axis[1] - axis[0] for axis in axes])
    return np.stack([np.maximum(good.min(axis=0) - step / 2, low), np.minimum(good.max(axis=0) + step / 2, high)])


def check_volume(volume: FloatArray, cameras: Sequence[PinholeCamera], radius: float) -> None:
    """Refuse a volume in which nowhere two cameras see the ball well.

    Args:
        volume: ``(2, 3)`` corners, metres.
        cameras: that search it.
        radius: of the ball, metres.

    Raises:
        RequestError: there is no such place in it.
    """
    axes = np.linspace(volume[0], volume[1], 20).T
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if (_visible_well(cameras, radius, grid) < 2).all():
        raise RequestError(
            f"`volume`: expected places where two cameras see a ball of {radius:g} m with a radius of "
            f"{SMALLEST_RADIUS:g} pixels to a quarter of the image height, got none; check it, or give `start`"
        )


def _visible_well(cameras: Sequence[PinholeCamera], radius: float, points: FloatArray) -> IntArray:
    """``(N,)`` how many cameras see a ball well at each of the ``(N, 3)`` points."""
    visible = np.zeros(len(points), dtype=np.int64)
    for camera in cameras:
        depth = np.maximum(camera.to_camera(points)[:, 2], 1e-9)
        size = camera.focal.mean() * radius / depth
        visible += in_view(camera, points) & (size >= SMALLEST_RADIUS) & (size <= camera.height * LARGEST_SHARE)
    return visible
