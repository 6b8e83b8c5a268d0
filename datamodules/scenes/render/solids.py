"""What is drawn: cone-spheres and boxes, each a round cone or a cube under an affine map, with its surface.

A cone-sphere is the convex hull of two spheres. Mapping the ray into the solid's own axes, where the cone is round
or the cube has unit size, keeps the distance along the ray, so one closed form serves flattened trunks too.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.projective import Camera
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]

UP, FORWARD = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])

Pattern = IntEnum("Pattern", "PLAIN ACROSS ALONG CHECKS SPECKLE CLOUDS BRICKS WINDOWS LEAVES", start=0)
"""What a surface shows of its second colour; ACROSS and ALONG are stripes."""
Detail = IntEnum("Detail", "NONE HEAD TRUNK PELVIS", start=0)
"""What `shading.paint` adds to the pattern."""
Colour: TypeAlias = tuple[float, float, float]


def as_colour(values: FloatArray) -> Colour:
    """Three numbers as a `Colour`."""
    red, green, blue = values.tolist()
    return red, green, blue


@dataclass(frozen=True)
class Solids:
    """K solids with their surfaces, as arrays.

    Attributes:
        start: ``(K, 3)`` world point at the origin of the solid's axes: the first sphere's or the box's centre.
        to_local: ``(K, 3, 3)`` turns world directions into the solid's axes.
        length: ``(K,)`` between the spheres' centres along the local z axis, in local units; 0 for boxes.
        radius: ``(K, 2)`` of the two spheres in local units; 1 for boxes.
        box: ``(K,)`` bool, True for the cube [-1, 1]^3.
        scale: ``(K, 3)`` metres per local unit.
        colour: ``(K, 3)`` reflectance in linear light, [0, 1].
        second: ``(K, 3)`` the pattern's other colour.
        pattern: ``(K,)`` a `Pattern`
        period: ``(K,)`` of the pattern, metres.
        relief: ``(K,)`` strength of the random variation of brightness.
        detail: ``(K,)`` a `Detail`.
        phase: ``(K,)`` shifts pattern and variation.
    """

    start: Float32
    to_local: Float32
    length: Float32
    radius: Float32
    box: NDArray[np.bool_]
    scale: Float32
    colour: Float32
    second: Float32
    pattern: Int32
    period: Float32
    relief: Float32
    detail: Int32
    phase: Float32

    def __len__(self) -> int:
        return len(self.length)

    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Axes ``(K, 3, 3)`` in the world, as columns, and both ends ``(K, 2, 3)`` of each solid along the last."""
        axes = np.linalg.inv(self.to_local.astype(np.float64))
        last = np.stack([np.zeros_like(axes[:, :, 2]), axes[:, :, 2] * self.length[:, None]], axis=1)
        return axes, self.start[:, None].astype(np.float64) + last

    def select(self, which: NDArray[np.bool_] | Int32) -> Solids:
        """The solids at a mask or at indices."""
        return Solids(*(getattr(self, f.name)[which] for f in fields(self)))


def join(groups: list[Solids]) -> Solids:
    """All solids of several groups."""
    return Solids(*(np.concatenate([getattr(g, f.name) for g in groups]) for f in fields(Solids)))


class Surface(NamedTuple):
    """What a solid looks like; colours are sRGB in [0, 1], the other fields those of `Solids`."""

    colour: Colour
    second: Colour | None = None
    pattern: int = Pattern.PLAIN
    period: float = 0.1
    relief: float = 0.1
    detail: int = Detail.NONE
    phase: float = 0.0


def _solids(shape: tuple[FloatArray, ...], box: bool, scale: FloatArray, surfaces: Sequence[Surface]) -> Solids:
    """The solids of a ``shape``: start, to_local, length, radius. Light has a gamma of 2, whose inverse is a root."""
    columns = zip(*(s if s.second else s._replace(second=s.colour) for s in surfaces), strict=True)
    kinds = (np.float32, np.float32, np.int32, np.float32, np.float32, np.int32, np.float32)
    colour, second, *others = (np.array(column, dtype=kind) for column, kind in zip(columns, kinds, strict=True))
    colours = [np.square(each.reshape(-1, 3)) for each in (colour, second)]
    geometry = [each.astype(np.float32) for each in shape]
    return Solids(*[*geometry, np.full(len(scale), box), scale.astype(np.float32), *colours, *others])


def cone_spheres(
    start: FloatArray, end: FloatArray, radius: FloatArray, front: FloatArray, flat: FloatArray,
    surfaces: Sequence[Surface],
) -> Solids:  # fmt: skip
    """Solids between ``start`` and ``end`` ``(K, 3)`` with sphere radii ``radius`` ``(K, 2)``, metres.

    ``flat`` ``(K,)`` scales each solid along ``front`` ``(K, 3)``, which becomes its local y axis.
    """
    along = end - start
    length = np.sqrt(np.einsum("ij,ij->i", along, along))
    # A sphere inside the other one leaves just that other one.
    inside = length <= np.abs(radius[:, 0] - radius[:, 1]) + 1e-6
    larger = radius.max(axis=1)
    centre = np.where((inside & (radius[:, 1] > radius[:, 0]))[:, None], end, start)
    radius = np.where(inside[:, None], larger[:, None], radius)
    z = np.where(length[:, None] > 1e-9, along / np.maximum(length, 1e-9)[:, None], [0.0, 0.0, 1.0])
    y = front - np.einsum("ij,ij->i", front, z)[:, None] * z
    size = np.sqrt(np.einsum("ij,ij->i", y, y))
    fallback = np.cross(z, np.roll(z, 1, axis=1) + np.array([0.3, 0.1, 0.2]))
    y = np.where((size > 1e-3)[:, None], y, fallback)
    y = y / np.sqrt(np.einsum("ij,ij->i", y, y))[:, None]
    x = np.cross(y, z)
    scale = np.ones((len(start), 3))
    scale[:, 1] = flat
    to_local = np.stack([x, y / flat[:, None], z], axis=1)
    return _solids((centre, to_local, np.where(inside, 0.0, length), radius), False, scale, surfaces)


def boxes(centre: FloatArray, half: FloatArray, yaw: FloatArray, surfaces: Sequence[Surface]) -> Solids:
    """Upright boxes: ``centre`` ``(K, 3)``, half sizes ``half`` ``(K, 3)``, metres, turned by ``yaw`` ``(K,)``."""
    count, cos, sin = len(centre), np.cos(yaw), np.sin(yaw)
    axes = np.tile(np.eye(3), (count, 1, 1))
    axes[:, :2, :2] = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], 1)
    return _solids((centre, axes / half[:, :, None], np.zeros(count), np.ones((count, 2))), True, half, surfaces)


class Parts:
    """Solids that are put together one after another."""

    def __init__(self) -> None:
        # What makes solids of rows, and one row; without a maker the row is solids.
        self._rows: list[tuple[Callable[..., Solids] | None, Any]] = []

    def cone(
        self, start: FloatArray, end: FloatArray, radii: tuple[float, float], surface: Surface, flat: float = 1.0,
        front: FloatArray = FORWARD,
    ) -> None:  # fmt: skip
        """Add what lies between two spheres; see `cone_spheres`."""
        self._rows.append((cone_spheres, (start, end, radii, front, flat, surface)))

    def box(self, centre: FloatArray, half: Sequence[float] | FloatArray, yaw: float, surface: Surface) -> None:
        """Add an upright box; see `boxes`."""
        self._rows.append((boxes, (centre, half, yaw, surface)))

    def add(self, solids: Solids) -> None:
        """Add solids as they are."""
        self._rows.append((None, solids))

    def solids(self) -> Solids:
        """All of them, in the order in which they were added."""
        groups: list[Solids] = []
        for make, rows in itertools.groupby(self._rows, key=operator.itemgetter(0)):
            if make is None:
                groups += [solids for _, solids in rows]
            else:
                *columns, surfaces = zip(*(row for _, row in rows), strict=True)
                groups.append(make(*(np.array(column, dtype=np.float64) for column in columns), surfaces))
        return join(groups) if len(groups) > 1 else groups[0]


def along(yaw: float) -> FloatArray:
    """``(3,)`` level unit vector towards ``yaw``, radians."""
    return np.array([np.cos(yaw), np.sin(yaw), 0.0])


def across(yaw: float) -> FloatArray:
    """``(3,)`` level unit vector to the left of ``yaw``."""
    return np.array([-np.sin(yaw), np.cos(yaw), 0.0])


def above(position: FloatArray, z: float = 0.0) -> FloatArray:
    """``(3,)``, ``z`` metres over ``position`` ``(2,)``."""
    return np.array([position[0], position[1], z])


def intersect(directions: Float32, origin: Float32, length: float, radii: tuple[float, float]) -> Float32:
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
    spans = [(a, max(a, 0), max(a, 0, min(a + n, whole))) for a, n, whole in zip(corner, size, shape, strict=False)]
    return tuple(slice(low, high) for _, low, high in spans), tuple(slice(low - a, high - a) for a, low, high in spans)


@dataclass(frozen=True)
class Layer:
    """One thing as the camera sees it alone, on a window of the grid of subpixels; the window may leave the image.

    Attributes:
        left: column of the window's first subpixel; negative left of the image.
        top: row of it.
        distance: ``(h, w)`` metres along the ray, infinite where the thing is not.
        solid: ``(h, w)`` index of the solid that is seen there; -1 for what stands beside a person.
    """

    left: int
    top: int
    distance: Float32
    solid: NDArray[np.int16]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """``(h, w)`` the silhouette, with what stands beside."""
        return np.isfinite(self.distance)

    @property
    def own(self) -> NDArray[np.bool_]:
        """``(h, w)`` the silhouette that a box goes round."""
        return self.mask & (self.solid >= 0)

    def inside(self, shape: tuple[int, ...]) -> tuple[Window, Window]:
        """See `overlap`."""
        return overlap(shape, (self.top, self.left), self.distance.shape)


def extents(solids: Solids, camera: RayCamera) -> FloatArray:
    """``(K, 4)`` pixels x1, y1, x2, y2 that surely hold each solid; NaN where it is not wholly before the camera."""
    axes, ends = solids.ends()
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
    distance = np.full((bottom - top, right - left), np.inf, dtype=np.float32)
    solid = np.zeros(distance.shape, dtype=np.int16)
    origins = np.einsum("kij,kj->ki", solids.to_local, camera.position.astype(np.float32) - solids.start)
    for k, (x1, y1, x2, y2) in zip(np.flatnonzero(visible), windows - np.array([left, top, left, top]), strict=True):
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


def tight(mask: NDArray[np.bool_]) -> IntArray:
    """``(4,)`` x1, y1, x2, y2 of the smallest window that holds all of ``mask`` ``(h, w)``."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])


def silhouette_box(layer: Layer, samples: int) -> FloatArray:
    """``(4,)`` pixels: the extent of the silhouette, beyond the image too."""
    box = tight(layer.own) + np.array([layer.left, layer.top] * 2)
    return np.asarray(box / samples)
