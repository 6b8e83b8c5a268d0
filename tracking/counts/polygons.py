"""Polygons in a plane: whether their borders cross, which points they hold, how far points are from the border."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray


def crosses_itself(corners: FloatArray) -> bool:
    """Whether two edges of a polygon ``(N, 2)`` meet other than at a corner between them, or it has no area."""
    count = len(corners)
    if abs(area(corners)) < 1e-12:
        return True
    meet = _meetings(corners, corners)
    k = np.arange(count)
    meet[k, k] = meet[k, (k + 1) % count] = meet[(k + 1) % count, k] = False
    return bool(meet.any())


def edges_cross(corners: FloatArray, other_corners: FloatArray) -> bool:
    """Whether the borders of two polygons cross; borders that only touch do not."""
    return bool(_meetings(corners, other_corners, touching=False).any())


def area(corners: FloatArray) -> float:
    """Signed area of a polygon ``(N, 2)``."""
    following = np.roll(corners, -1, axis=0)
    return float(0.5 * np.sum(_cross(corners, following)))


def inside(points: FloatArray, corners: FloatArray) -> BoolArray:
    """``(N,)`` which of ``(N, 2)`` points lie in a polygon, by the even-odd rule."""
    x, y = points.T
    odd = np.zeros(len(points), dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(corners.tolist(), np.roll(corners, -1, axis=0).tolist(), strict=True):
        if ay != by:
            odd ^= ((ay > y) != (by > y)) & (x < (bx - ax) / (by - ay) * (y - ay) + ax)
    return odd


def distance_to_border(points: FloatArray, corners: FloatArray) -> FloatArray:
    """``(N,)`` distance of ``(N, 2)`` points from the border of a polygon."""
    least = np.full(len(points), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, x, y = b - a, points[:, 0] - a[0], points[:, 1] - a[1]
        share = np.clip((x * edge[0] + y * edge[1]) / (edge @ edge), 0, 1)
        np.minimum(least, (x - share * edge[0]) ** 2 + (y - share * edge[1]) ** 2, out=least)
    return np.asarray(np.sqrt(least))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _meetings(corners: FloatArray, other_corners: FloatArray, touching: bool = True) -> BoolArray:
    """``(N, M)`` which edges of two polygons meet."""
    a, b = corners[:, None], np.roll(corners, -1, axis=0)[:, None]
    c, d = other_corners[None], np.roll(other_corners, -1, axis=0)[None]
    first, second = _cross(b - a, c - a) * _cross(b - a, d - a), _cross(d - c, a - c) * _cross(d - c, b - c)
    if not touching:
        return np.asarray((first < 0) & (second < 0))
    low, high = np.maximum(np.minimum(a, b), np.minimum(c, d)), np.minimum(np.maximum(a, b), np.maximum(c, d))
    return np.asarray((first <= 0) & (second <= 0) & (low <= high).all(axis=-1))
