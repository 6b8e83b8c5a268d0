"""A textured, skinned mesh: what bodies, clothes, hair and bags are made of."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import Columns, FloatArray, ImageArray, IntArray

Worn = IntEnum("Worn", "SKIN HAIR UPPER LOWER SHOES EXTRA BESIDE")
"""What a triangle belongs to; EXTRA is carried, or a hat; BESIDE is ridden or pushed, and outside the person's box."""


@dataclass(frozen=True)
class Mesh:
    """Triangles with a texture.

    Attributes:
        vertices: ``(N, 3)`` metres in the body's axes: forward, left, up.
        triangles: ``(T, 3)`` indices of vertices.
        uv: ``(T, 3, 2)`` texture coordinates of the corners, in [0, 1], from the lower left.
        weights: ``(N, B)`` how much each bone moves each vertex; rows sum to 1.
        labels: ``(T,)`` a `Worn` each.
        texture: ``(h, w, 4)`` uint8 RGBA.
        cutout: the texture's alpha says where there is something.
    """

    vertices: FloatArray
    triangles: IntArray
    uv: FloatArray
    weights: FloatArray
    labels: NDArray[np.uint8]
    texture: ImageArray
    cutout: bool = False


def vertex_normals(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """``(N, 3)`` unit normals: means over the triangles about each vertex, weighted by area."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    shares = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    total = np.stack([np.bincount(triangles.ravel(), share, minlength=len(vertices)) for share in shares.T], axis=1)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))


def triangles_of_quads(quads: IntArray) -> IntArray:
    """``(2 F, 3)`` halves of the quads ``(F, 4)``, both halves of one after the other."""
    return np.asarray(quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))


def ellipsoid(centre: FloatArray, radii: FloatArray, power: float = 1.0) -> tuple[FloatArray, IntArray]:
    """Vertices and triangles of an ellipsoid; ``power`` below 1 makes it boxy."""
    rings, sectors = 13, 20
    around = np.linspace(0, 2 * np.pi, sectors, endpoint=False)
    up = np.linspace(-np.pi / 2, np.pi / 2, rings)
    out = np.cos(up)
    axes = [np.outer(out, np.cos(around)), np.outer(out, np.sin(around)), np.outer(np.sin(up), np.ones(sectors))]
    unit = np.stack(axes, axis=-1).reshape(-1, 3)
    boxy = np.sign(unit) * np.abs(unit) ** power
    row, column = np.divmod(np.arange((rings - 1) * sectors), sectors)
    low, high, next_column = row * sectors, (row + 1) * sectors, (column + 1) % sectors
    quads = np.stack([low + column, low + next_column, high + next_column, high + column], axis=1)
    return centre + boxy * radii, triangles_of_quads(quads)


# Triangles are tested together on squares of pixels of these sides.
_SIDES = (1, 2, 3, 4, 6, 9, 14, 24, 48, 96, 200, 400)


@dataclass(frozen=True)
class Fragments(Columns):
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


def joined(parts: list[Fragments]) -> Fragments:
    """All fragments of several lists."""
    return Fragments(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Fragments)))


def rasterise(corners: FloatArray, depth: FloatArray, width: int, height: int) -> Fragments:
    """All pixels whose centres lie in triangles.

    Args:
        corners: ``(T, 3, 2)`` pixels.
        depth: ``(T, 3)`` along the camera's axis; triangles that reach behind it are left out.
        width: of the picture.
        height: of the picture, pixels.
    """
    # Minima over an axis of three are slow; so are stacks of small arrays.
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    least, largest = np.minimum(np.minimum(first, second), third), np.maximum(np.maximum(first, second), third)
    low = np.maximum(np.ceil(least - 0.5), 0)
    high = np.minimum(np.floor(largest - 0.5), [width - 1, height - 1])
    extent = high - low + 1
    side = np.maximum(extent[:, 0], extent[:, 1])
    there = (extent[:, 0] > 0) & (extent[:, 1] > 0) & (depth[:, 0] > 0) & (depth[:, 1] > 0) & (depth[:, 2] > 0)
    parts = []
    for smaller_side, k in zip((0, *_SIDES), _SIDES, strict=False):
        which = np.flatnonzero(there & (side > smaller_side) & (side <= k))
        x = low[which, 0][:, None] + np.tile(np.arange(k), k)
        y = low[which, 1][:, None] + np.repeat(np.arange(k), k)
        ax, bx, cx = (corners[which, n, 0][:, None] - (x + 0.5) for n in range(3))
        ay, by, cy = (corners[which, n, 1][:, None] - (y + 0.5) for n in range(3))
        of_a, of_b, of_c = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
        area = of_a[:, :1] + of_b[:, :1] + of_c[:, :1]
        inside = np.where(area > 0, (of_a >= 0) & (of_b >= 0) & (of_c >= 0), (of_a <= 0) & (of_b <= 0) & (of_c <= 0))
        inside &= (x <= high[which, 0][:, None]) & (y <= high[which, 1][:, None]) & (np.abs(area) > 1e-12)
        row, column = np.nonzero(inside)
        triangle = which[row]
        total = area[row, 0]
        over = np.empty((len(row), 3))
        for n, part in enumerate((of_a, of_b, of_c)):
            over[:, n] = part[row, column] / total / depth[triangle, n]
        inverse = over[:, 0] + over[:, 1] + over[:, 2]
        pixel = (y[row, column] * width + x[row, column]).astype(np.int64)
        parts.append(Fragments(pixel, triangle, over / inverse[:, None], 1 / inverse))
    return joined(parts)


def nearest(fragments: Fragments) -> Fragments:
    """The fragment in front of the others of each pixel, by pixel."""
    order = np.lexsort((fragments.depth, fragments.pixel))
    return fragments.select(order[np.unique(fragments.pixel[order], return_index=True)[1]])
