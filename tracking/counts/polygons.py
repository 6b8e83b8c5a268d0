"""Polygons in a plane: whether their borders cross, which points they hold, how far points are from the border."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Cosine of the angle between the normals of two edges that face each other: within 41 degrees.
FACING = -0.75


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
        np.minimum(least, (_ways_to_edge(points, a, b) ** 2).sum(axis=0), out=least)
    return np.asarray(np.sqrt(least))


def width_across(points: FloatArray, corners: FloatArray) -> FloatArray:
    """``(N,)`` how wide a polygon is at ``(N, 2)`` points inside, across from the nearest edge to one that faces it.

    It is infinite where no edge faces the nearest.
    """
    count = len(points)
    ends = np.roll(corners, -1, axis=0)
    normals = np.sign(area(corners)) * np.column_stack([corners[:, 1] - ends[:, 1], ends[:, 0] - corners[:, 0]])
    normals /= np.hypot(*normals.T)[:, None]
    nearest, least, opposite = np.zeros(count, dtype=np.int64), np.full(count, np.inf), np.full(count, np.inf)
    for edge, (a, b) in enumerate(zip(corners, ends, strict=True)):
        squared = (_ways_to_edge(points, a, b) ** 2).sum(axis=0)
        nearest[squared < least] = edge
        np.minimum(least, squared, out=least)
    inward = normals[nearest]
    for edge, (a, b) in enumerate(zip(corners, ends, strict=True)):
        way = -_ways_to_edge(points, a, b)
        faces = (inward @ normals[edge] < FACING) & ((inward.T * way).sum(axis=0) > 0)
        np.minimum(opposite, np.where(faces, (way**2).sum(axis=0), np.inf), out=opposite)
    return np.asarray(np.sqrt(least) + np.sqrt(opposite))


def border_meetings(
    starts: FloatArray, ends: FloatArray, corners: FloatArray
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Where straight ways between points ``(S, 2)`` meet the border of a polygon, in the order of the ways.

    Returns:
        ``(M,)`` which way, the share ``(M,)`` of it that lies before, and ``(M,)`` whether it leads inside.
    """
    ways, shares, inward = [np.empty(0, np.int64)], [np.empty(0)], [np.empty(0, np.bool_)]
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        before, after = _cross(b - a, starts - a), _cross(b - a, ends - a)
        sides = _cross(ends - starts, a - starts) > 0, _cross(ends - starts, b - starts) > 0
        met = np.flatnonzero(((before > 0) != (after > 0)) & (sides[0] != sides[1]))
        ways.append(met)
        shares.append(before[met] / (before[met] - after[met]))
        inward.append((after[met] > 0) == (area(corners) > 0))
    way, share, leads = np.concatenate(ways), np.concatenate(shares), np.concatenate(inward)
    order = np.lexsort([share, way])
    return way[order], share[order], leads[order]


def _ways_to_edge(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """``(2, N)`` the way to each of ``(N, 2)`` points from the nearest point of an edge."""
    edge, x, y = b - a, points[:, 0] - a[0], points[:, 1] - a[1]
    share = np.clip((x * edge[0] + y * edge[1]) / (edge @ edge), 0, 1)
    return np.stack([x - share * edge[0], y - share * edge[1]])


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
