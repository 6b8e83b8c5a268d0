"""A textured, skinned mesh: what bodies, clothes, hair and bags are made of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

SKIN, HAIR, UPPER, LOWER, SHOES, EXTRA = 1, 2, 3, 4, 5, 6


@dataclass(frozen=True)
class Mesh:
    """Triangles with a texture.

    Attributes:
        vertices: ``(N, 3)`` metres in the body's axes: forward, left, up.
        triangles: ``(T, 3)`` indices of vertices.
        uv: ``(T, 3, 2)`` texture coordinates of the corners, in [0, 1], from the lower left.
        weights: ``(N, B)`` how much each bone moves each vertex; rows sum to 1.
        labels: ``(T,)`` what a triangle belongs to: `SKIN`, `HAIR`, `UPPER`, `LOWER`, `SHOES` or `EXTRA`.
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
    of_triangle = np.cross(b - a, c - a)
    total = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(of_triangle[:, k], 3), minlength=len(vertices)) for k in range(3)],
        axis=1,
    )
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))


def compact(mesh: Mesh) -> Mesh:
    """The mesh without vertices that no triangle has."""
    used, triangles = np.unique(mesh.triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    return replace(mesh, vertices=mesh.vertices[used], weights=mesh.weights[used], triangles=triangles)


def triangles_of_quads(quads: IntArray) -> IntArray:
    """``(2 F, 3)`` halves of the quads ``(F, 4)``, both halves of one after the other."""
    return np.asarray(quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))


def ellipsoid(centre: FloatArray, radii: FloatArray, power: float = 1.0) -> tuple[FloatArray, IntArray]:
    """Vertices and triangles of an ellipsoid; ``power`` below 1 makes it boxy."""
    rings, sectors = 13, 20
    around = np.linspace(0, 2 * np.pi, sectors, endpoint=False)
    up = np.linspace(-np.pi / 2, np.pi / 2, rings)
    unit = np.stack(
        [
            np.outer(np.cos(up), np.cos(around)),
            np.outer(np.cos(up), np.sin(around)),
            np.outer(np.sin(up), np.ones(sectors)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    boxy = np.sign(unit) * np.abs(unit) ** power
    row, column = np.divmod(np.arange((rings - 1) * sectors), sectors)
    after = (column + 1) % sectors
    quads = np.stack(
        [row * sectors + column, row * sectors + after, (row + 1) * sectors + after, (row + 1) * sectors + column],
        axis=1,
    )
    return centre + boxy * radii, triangles_of_quads(quads)
