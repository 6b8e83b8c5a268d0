"""Draws triangles: which one, and where on it, is seen in each pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray

# Triangles are tested together on squares of pixels of these sides.
_SIDES = (1, 2, 3, 4, 6, 9, 14, 24, 48, 96, 200, 400)


@dataclass(frozen=True)
class Fragments:
    """Pixels that triangles cover, several of one pixel too.

    Attributes:
        pixel: ``(n,)`` row times width plus column.
        triangle: ``(n,)`` which.
        where: ``(n, 3)`` barycentric coordinates of the pixel's centre, corrected for perspective.
        depth: ``(n,)`` of that point.
    """

    pixel: IntArray
    triangle: IntArray
    where: FloatArray
    depth: FloatArray

    def chosen(self, kept: IntArray) -> Fragments:
        """Those of the indices, or of the mask, ``kept``."""
        return Fragments(self.pixel[kept], self.triangle[kept], self.where[kept], self.depth[kept])


def rasterise(corners: FloatArray, depth: FloatArray, width: int, height: int) -> Fragments:
    """All pixels whose centres lie in triangles.

    Args:
        corners: ``(T, 3, 2)`` pixels.
        depth: ``(T, 3)`` along the camera's axis; triangles that reach behind it are left out.
        width: of the picture.
        height: likewise.
    """
    # Minima over an axis of three are slow; so are stacks of small arrays.
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    least, most = np.minimum(np.minimum(first, second), third), np.maximum(np.maximum(first, second), third)
    low = np.maximum(np.ceil(least - 0.5), 0)
    high = np.minimum(np.floor(most - 0.5), [width - 1, height - 1])
    extent = high - low + 1
    side = np.maximum(extent[:, 0], extent[:, 1])
    there = (extent[:, 0] > 0) & (extent[:, 1] > 0) & (depth[:, 0] > 0) & (depth[:, 1] > 0) & (depth[:, 2] > 0)
    parts = [
        _on_squares(np.flatnonzero(there & (side > before) & (side <= k)), k, corners, depth, low, high, width)
        for before, k in zip((0, *_SIDES), _SIDES, strict=False)
    ]
    return Fragments(
        np.concatenate([p.pixel for p in parts]),
        np.concatenate([p.triangle for p in parts]),
        np.concatenate([p.where for p in parts]),
        np.concatenate([p.depth for p in parts]),
    )


def _on_squares(
    which: IntArray, side: int, corners: FloatArray, depth: FloatArray, low: FloatArray, high: FloatArray, width: int
) -> Fragments:
    x = low[which, 0][:, None] + np.tile(np.arange(side), side)
    y = low[which, 1][:, None] + np.repeat(np.arange(side), side)
    ax, bx, cx = (corners[which, k, 0][:, None] - (x + 0.5) for k in range(3))
    ay, by, cy = (corners[which, k, 1][:, None] - (y + 0.5) for k in range(3))
    of_a, of_b, of_c = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    area = of_a[:, :1] + of_b[:, :1] + of_c[:, :1]
    inside = np.where(area > 0, (of_a >= 0) & (of_b >= 0) & (of_c >= 0), (of_a <= 0) & (of_b <= 0) & (of_c <= 0))
    inside &= (x <= high[which, 0][:, None]) & (y <= high[which, 1][:, None]) & (np.abs(area) > 1e-12)
    row, column = np.nonzero(inside)
    triangle = which[row]
    total = area[row, 0]
    over = np.empty((len(row), 3))
    for k, part in enumerate((of_a, of_b, of_c)):
        over[:, k] = part[row, column] / total / depth[triangle, k]
    inverse = over[:, 0] + over[:, 1] + over[:, 2]
    pixel = (y[row, column] * width + x[row, column]).astype(np.int64)
    return Fragments(pixel, triangle, over / inverse[:, None], 1 / inverse)


def nearest(fragments: Fragments) -> Fragments:
    """The fragment in front of the others of each pixel, by pixel."""
    order = np.lexsort((fragments.depth, fragments.pixel))
    pixel = fragments.pixel[order]
    first = np.ones(len(pixel), dtype=np.bool_)
    first[1:] = pixel[1:] != pixel[:-1]
    return fragments.chosen(order[first])
