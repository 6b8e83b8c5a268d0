"""Where solids are seen: for each thing the distance and the solid that every subpixel's ray meets first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.render.solids import Float32, Solids, intersect, intersect_box
from tsuiseki.tracking.cameras.camera import Camera
from tsuiseki.tracking.types import BoolArray, FloatArray

NEAREST = 0.2


class RayCamera(Camera, Protocol):
    """What the renderer asks of a camera."""

    def rays(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Unit world directions ``(N, 3)`` of pixels ``(N, 2)``, in the floating type of ``pixels``."""
        ...


@dataclass(frozen=True)
class Layer:
    """One thing as the camera sees it alone, on a window of the grid of subpixels; the window may leave the image.

    Attributes:
        left: column of the window's first subpixel; negative left of the image.
        top: row of it.
        distance: ``(h, w)`` metres along the ray, infinite where the thing is not.
        solid: ``(h, w)`` index of the solid that is seen there.
    """

    left: int
    top: int
    distance: Float32
    solid: NDArray[np.int16]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """``(h, w)`` the silhouette."""
        return np.isfinite(self.distance)

    def inside(self, width: int, height: int) -> tuple[tuple[slice, slice], tuple[slice, slice]] | None:
        """Slices of the grid ``(height, width)`` and of the window where both lie, or None."""
        h, w = self.distance.shape
        x1, y1, x2, y2 = max(self.left, 0), max(self.top, 0), min(self.left + w, width), min(self.top + h, height)
        if x1 >= x2 or y1 >= y2:
            return None
        return (slice(y1, y2), slice(x1, x2)), (
            slice(y1 - self.top, y2 - self.top),
            slice(x1 - self.left, x2 - self.left),
        )


def extents(solids: Solids, camera: RayCamera) -> FloatArray:
    """``(K, 4)`` pixels x1, y1, x2, y2 that surely hold each solid; NaN where it is not wholly before the camera."""
    axes = np.linalg.inv(solids.to_local.astype(np.float64))
    ends = solids.start[:, None].astype(np.float64) + np.stack(
        [np.zeros_like(axes[:, :, 2]), axes[:, :, 2] * solids.length[:, None]], axis=1
    )
    count = len(solids)
    steps = np.concatenate([axes, -axes], axis=2).transpose(0, 2, 1)
    points = ends[:, :, None] + steps[:, None] * solids.radius[:, :, None, None]
    pixels, depth = camera.project(points.reshape(-1, 3))
    pixels = pixels.reshape(count, 2, 2, 3, 2)
    centre = pixels.mean(axis=(2, 3))
    half = np.sqrt((np.square(pixels[:, :, 0] - pixels[:, :, 1]) / 4).sum(axis=2))
    # The square root is exact for the affine part of the projection; the margin covers the rest of it.
    half = 1.1 * half + 1.0
    rects = np.concatenate([(centre - half).min(axis=1), (centre + half).max(axis=1)], axis=1)
    hidden: BoolArray = np.any(depth.reshape(count, -1) < NEAREST, axis=1)
    if solids.box.any():
        which = np.flatnonzero(solids.box)
        corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        corners = solids.start[which, None] + np.einsum("kij,cj->kci", axes[which], corner)
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
    seen = np.isfinite(rects).all(axis=1)
    if not seen.any():
        return None
    margin = np.array([width, height] * 2) * beyond
    low, high = -margin, margin + np.array([width, height] * 2)
    windows = np.clip(np.floor(rects[seen] * samples), low, high).astype(np.int64) + np.array([0, 0, 1, 1])
    left, top = windows[:, :2].min(axis=0)
    right, bottom = windows[:, 2:].max(axis=0)
    if right <= 0 or bottom <= 0 or left >= width or top >= height:
        return None
    rays = ray_grid(camera, samples, left, top, right, bottom)
    distance = np.full((bottom - top, right - left), np.inf, dtype=np.float32)
    solid = np.zeros(distance.shape, dtype=np.int16)
    origins = np.einsum("kij,kj->ki", solids.to_local, camera.position.astype(np.float32) - solids.start)
    for k, (x1, y1, x2, y2) in zip(np.flatnonzero(seen), windows - np.array([left, top, left, top]), strict=True):
        part = rays[:, y1:y2, x1:x2]
        if part.size == 0:
            continue
        local = solids.to_local[k] @ part.reshape(3, -1)
        if solids.box[k]:
            t = intersect_box(local, origins[k])
        else:
            radii = (float(solids.radius[k, 0]), float(solids.radius[k, 1]))
            t = intersect(local, origins[k], float(solids.length[k]), radii)
        t = t.reshape(part.shape[1:])
        window = distance[y1:y2, x1:x2]
        closer = t < window
        np.copyto(window, t, where=closer)
        np.copyto(solid[y1:y2, x1:x2], np.int16(k), where=closer)
    return Layer(int(left), int(top), distance, solid) if np.isfinite(distance).any() else None


def ray_grid(camera: RayCamera, samples: int, left: int, top: int, right: int, bottom: int) -> Float32:
    """Directions ``(3, h, w)`` of the centres of the subpixels of a window."""
    x = (np.arange(left, right, dtype=np.float32) + np.float32(0.5)) / np.float32(samples)
    y = (np.arange(top, bottom, dtype=np.float32) + np.float32(0.5)) / np.float32(samples)
    pixels = np.empty((2, len(y), len(x)), dtype=np.float32)
    pixels[0], pixels[1] = x[None, :], y[:, None]
    return np.ascontiguousarray(camera.rays(pixels.reshape(2, -1).T).T).reshape(3, len(y), len(x))


def silhouette_box(layer: Layer, samples: int) -> FloatArray:
    """``(4,)`` pixels: the extent of the silhouette, beyond the image too."""
    mask = layer.mask
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    x, y = columns + layer.left, rows + layer.top
    return np.array([x[0], y[0], x[-1] + 1, y[-1] + 1], dtype=np.float64) / samples
