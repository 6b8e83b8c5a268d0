"""How a camera sees solids: rays that meet round cones and cubes, and the windows of the picture they do so in.

Mapping the ray into a solid's own axes, where the cone is round or the cube has unit size, keeps the distance along the
ray, so one closed form serves flattened trunks too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.render.solids import CORNERS, Float32, Pair, Solids, pair
from tsuiseki.tracking.cameras.projective import Camera
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


def intersect(directions: Float32, origin: Float32, length: float, radii: Pair) -> Float32:
    """Distances ``(N,)`` at which rays enter a cone-sphere, infinite where they miss it.

    Args:
        directions: ``(3, N)`` in the solid's axes, of any length.
        origin: ``(3,)`` of all rays, in the solid's axes, outside the solid.
        length: between the two spheres' centres, 0 and ``length`` on the z axis.
        radii: of the spheres; neither lies inside the other unless ``length`` is 0 and both are equal.

    The cone touches the spheres at s = (r0 - r1) / length along their normals, so on it
    rho sqrt(1 - s^2) + z s = r0. The solid lies inside the cone: a ray that misses the cone misses it, and one that
    enters the cone beyond a circle of contact can only enter the solid through that end's sphere.
    """
    slope = (radii[0] - radii[1]) / length if length > 0 else 0.0
    shrink = np.float32(1 - slope**2)
    dx, dy, dz = directions
    ox, oy, oz = (np.float32(v) for v in origin)
    k0, slope32 = np.float32(radii[0] - oz * slope), np.float32(slope)
    k1 = -slope32 * dz
    across = dx * dx + dy * dy
    a = shrink * across - k1 * k1
    b = shrink * (ox * dx + oy * dy) - k0 * k1
    c = shrink * (ox * ox + oy * oy) - k0 * k0
    inner = b * b - a * c
    hit = inner >= 0
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (-b - np.sqrt(np.maximum(inner, 0))) / a
        z = oz + t * dz
    low, high = np.float32(radii[0] * slope), np.float32(length + radii[1] * slope)
    # Rays steeper than the cone that come from its wide side meet that side's sphere first.
    steep = (a <= 0) & (slope32 * dz > 0)
    z = np.where(steep, low - 1 if slope > 0 else high + 1, z)
    upper = z > high
    cap = ~((z >= low) & (z <= high))
    shift = oz - np.where(upper, np.float32(length), np.float32(0))
    r = np.where(upper, np.float32(radii[1]), np.float32(radii[0]))
    sa = across + dz * dz
    sb = ox * dx + oy * dy + shift * dz
    sc = ox * ox + oy * oy + shift * shift - r * r
    sphere = sb * sb - sa * sc
    hit &= ~cap | (sphere >= 0)
    t = np.where(cap, (-sb - np.sqrt(np.maximum(sphere, 0))) / sa, t)
    return np.where(hit & (t > 0), t, np.float32(np.inf))


def intersect_box(directions: Float32, origin: Float32) -> Float32:
    """Distances ``(N,)`` at which rays enter the cube [-1, 1]^3, infinite where they miss it; see `intersect`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (-1 - origin[:, None]) / directions
        last = (1 - origin[:, None]) / directions
    near = np.minimum(first, last).max(axis=0)
    far = np.maximum(first, last).min(axis=0)
    return np.where((near <= far) & (near > 0), near, np.float32(np.inf))


def inner_normals(local: Float32, solids: Solids, k: int) -> Float32:
    """Normals ``(3, N)`` of any length in the axes of solid ``k`` at its surface points ``local`` ``(3, N)``.

    The transposed `to_local` turns them into the world.
    """
    size = np.abs(local)
    if solids.box[k]:
        return np.where(size >= size.max(axis=0), local, np.float32(0))
    # The sphere that touches the cone here, of all those that sweep it, has its centre this far along the axis.
    length, radius = float(solids.length[k]), solids.radius[k]
    slope = float(radius[0] - radius[1]) / length if length > 0 else 0.0
    ratio = np.float32(slope / max(1 - slope**2, 1e-6) ** 0.5)
    inner = local.copy()
    inner[2] -= np.clip(local[2] - ratio * np.sqrt(local[0] ** 2 + local[1] ** 2), 0, np.float32(length))
    return inner


# Depth below which a solid does not lie wholly before the camera, metres.
NEAREST = 0.2


class RayCamera(Camera, Protocol):
    """What the renderer asks of a camera."""

    def rays(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Unit world directions ``(N, 3)`` of pixels ``(N, 2)``, in the floating type of ``pixels``."""
        ...


Window = tuple[slice, ...]
"""Rows and columns."""


def overlap(shape: tuple[int, ...], corner: tuple[int, int], size: tuple[int, ...]) -> tuple[Window, Window]:
    """What of an image of ``shape`` a part of ``size`` covers from row and column ``corner`` on, and what of the part.

    Both are empty where the part lies outside.
    """
    spans = [(a, max(a, 0), max(a, 0, min(a + n, length))) for a, n, length in zip(corner, size, shape, strict=False)]
    return tuple(slice(low, high) for _, low, high in spans), tuple(slice(low - a, high - a) for a, low, high in spans)


@dataclass(frozen=True)
class Layer:
    """One thing as the camera sees it alone, on a window of the grid of subpixels; the window may leave the image.

    Attributes:
        left: column of the window's first subpixel; negative left of the image.
        top: row of it.
        distance: ``(h, w)`` metres along the ray, infinite where the thing is not.
        solid: ``(h, w)`` index of the solid that is seen there; -1 for what stands beside a person.
        picture: what is seen of a thing that shows a picture.
    """

    left: int
    top: int
    distance: Float32
    solid: NDArray[np.int16]
    picture: Any = None

    @property
    def mask(self) -> NDArray[np.bool_]:
        """``(h, w)`` the silhouette, with what stands beside."""
        return np.isfinite(self.distance)

    @property
    def own(self) -> NDArray[np.bool_]:
        """``(h, w)`` the silhouette that a box goes round."""
        return self.mask & (self.solid >= 0)


def extents(solids: Solids, camera: RayCamera) -> FloatArray:
    """``(K, 4)`` pixels x1, y1, x2, y2 that surely hold each solid; NaN where it is not wholly before the camera."""
    axes, ends = solids.ends()
    count = len(solids)
    steps = np.concatenate([axes, -axes], axis=2).transpose(0, 2, 1)
    points = ends[:, :, None] + steps[:, None] * solids.radius[:, :, None, None]
    pixels, depth = camera.project(points.reshape(-1, 3))
    pixels = pixels.reshape(count, 2, 2, 3, 2)
    centre = pixels.mean(axis=(2, 3))
    # The square root is exact for the affine part of the projection; the margin covers the rest of it.
    half = 1.1 * np.sqrt((np.square(pixels[:, :, 0] - pixels[:, :, 1]) / 4).sum(axis=2)) + 1.0
    rects = np.concatenate([(centre - half).min(axis=1), (centre + half).max(axis=1)], axis=1)
    hidden: BoolArray = np.any(depth.reshape(count, -1) < NEAREST, axis=1)
    if solids.box.any():
        which = np.flatnonzero(solids.box)
        corners = solids.start[which, None] + np.einsum("kij,cj->kci", axes[which], CORNERS)
        flat, far = camera.project(corners.reshape(-1, 3))
        flat = flat.reshape(len(which), 8, 2)
        rects[which] = np.concatenate([flat.min(axis=1) - 1, flat.max(axis=1) + 1], axis=1)
        hidden[which] = (far.reshape(-1, 8) < NEAREST).any(axis=1)
    rects[hidden] = np.nan
    return rects


def trace(solids: Solids, camera: RayCamera, samples: int, beyond: float = 1.0) -> Layer | None:
    """The thing made of ``solids`` on a grid of ``samples`` by ``samples`` rays a pixel, or None where it is not seen.

    The window reaches at most ``beyond`` image sizes past each border.
    """
    width, height = camera.width * samples, camera.height * samples
    rects = extents(solids, camera)
    visible = np.isfinite(rects).all(axis=1)
    if not visible.any():
        return None
    margin = np.array([width, height] * 2) * beyond
    low, high = -margin, margin + np.array([width, height] * 2)
    windows = np.clip(np.floor(rects[visible] * samples), low, high).astype(np.int64) + np.array([0, 0, 1, 1])
    left, top = windows[:, :2].min(axis=0)
    right, bottom = windows[:, 2:].max(axis=0)
    if right <= 0 or bottom <= 0 or left >= width or top >= height:
        return None
    rays = ray_grid(camera, samples, left, top, right, bottom)
    distance = np.full(rays.shape[1:], np.inf, dtype=np.float32)
    solid = np.zeros(distance.shape, dtype=np.int16)
    origins = np.einsum("kij,kj->ki", solids.to_local, camera.position.astype(np.float32) - solids.start)
    for k, (x1, y1, x2, y2) in zip(np.flatnonzero(visible), windows - np.array([left, top, left, top]), strict=True):
        window = distance[y1:y2, x1:x2]
        if window.size == 0:
            continue
        local = solids.to_local[k] @ rays[:, y1:y2, x1:x2].reshape(3, -1)
        if solids.box[k]:
            t = intersect_box(local, origins[k])
        else:
            t = intersect(local, origins[k], float(solids.length[k]), pair(solids.radius[k]))
        closer = t.reshape(window.shape) < window
        np.copyto(window, t.reshape(window.shape), where=closer)
        np.copyto(solid[y1:y2, x1:x2], np.int16(k), where=closer)
    return Layer(int(left), int(top), distance, solid) if np.isfinite(distance).any() else None


def ray_grid(camera: RayCamera, samples: int, left: int, top: int, right: int, bottom: int) -> Float32:
    """Directions ``(3, h, w)`` of the centres of the subpixels of a window."""
    x = (np.arange(left, right, dtype=np.float32) + np.float32(0.5)) / np.float32(samples)
    y = (np.arange(top, bottom, dtype=np.float32) + np.float32(0.5)) / np.float32(samples)
    pixels = np.empty((2, len(y), len(x)), dtype=np.float32)
    pixels[0], pixels[1] = x[None, :], y[:, None]
    return np.ascontiguousarray(camera.rays(pixels.reshape(2, -1).T).T).reshape(3, len(y), len(x))


def tight(mask: NDArray[np.bool_]) -> IntArray:
    """``(4,)`` x1, y1, x2, y2 of the smallest window that holds all of ``mask`` ``(h, w)``."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])


def silhouette_box(layer: Layer, samples: int) -> FloatArray:
    """``(4,)`` pixels: the extent of the silhouette, beyond the image too."""
    return np.asarray((tight(layer.own) + np.array([layer.left, layer.top] * 2)) / samples)
