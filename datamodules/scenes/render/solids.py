"""What is drawn: cone-spheres and boxes, each a round cone or a cube under an affine map, with its surface.

A cone-sphere is the convex hull of two spheres. Mapping the ray into the solid's own axes, where the cone is round
or the cube has unit size, keeps the distance along the ray, so one closed form serves flattened trunks too.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]

PLAIN, STRIPES_ACROSS, STRIPES_ALONG, CHECKS, SPECKLE, CLOUDS, BRICKS, WINDOWS, LEAVES = range(9)
NO_DETAIL, HEAD, TRUNK, PELVIS = range(4)


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
        pattern: ``(K,)`` one of PLAIN, STRIPES_ACROSS, ...
        period: ``(K,)`` of the pattern, metres.
        relief: ``(K,)`` strength of the random variation of brightness.
        detail: ``(K,)`` NO_DETAIL, or what `paint` adds to the pattern.
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

    def select(self, which: NDArray[np.bool_] | Int32) -> Solids:
        """The solids at a mask or at indices."""
        return Solids(*(getattr(self, f.name)[which] for f in fields(self)))


def join(groups: list[Solids]) -> Solids:
    """All solids of several groups."""
    return Solids(*(np.concatenate([getattr(g, f.name) for g in groups]) for f in fields(Solids)))


@dataclass
class Surfaces:
    """Rows of solids' surfaces while they are put together."""

    colour: list[tuple[float, float, float]] = field(default_factory=list)
    second: list[tuple[float, float, float]] = field(default_factory=list)
    pattern: list[int] = field(default_factory=list)
    period: list[float] = field(default_factory=list)
    relief: list[float] = field(default_factory=list)
    detail: list[int] = field(default_factory=list)
    phase: list[float] = field(default_factory=list)

    def add(
        self,
        colour: tuple[float, float, float],
        second: tuple[float, float, float] | None = None,
        pattern: int = PLAIN,
        period: float = 0.1,
        relief: float = 0.1,
        detail: int = NO_DETAIL,
        phase: float = 0.0,
    ) -> None:
        """One more row; colours are sRGB in [0, 1]."""
        self.colour.append(colour)
        self.second.append(colour if second is None else second)
        self.pattern.append(pattern)
        self.period.append(period)
        self.relief.append(relief)
        self.detail.append(detail)
        self.phase.append(phase)

    def arrays(self) -> tuple[Float32, Float32, Int32, Float32, Float32, Int32, Float32]:
        """The rows as `Solids` wants them, colours in linear light (gamma 2, whose inverse is a square root)."""
        return (
            np.square(np.array(self.colour, dtype=np.float32).reshape(-1, 3)),
            np.square(np.array(self.second, dtype=np.float32).reshape(-1, 3)),
            np.array(self.pattern, dtype=np.int32),
            np.array(self.period, dtype=np.float32),
            np.array(self.relief, dtype=np.float32),
            np.array(self.detail, dtype=np.int32),
            np.array(self.phase, dtype=np.float32),
        )


def cone_spheres(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    radius: NDArray[np.float64],
    front: NDArray[np.float64],
    flat: NDArray[np.float64],
    surfaces: Surfaces,
) -> Solids:
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
    return Solids(
        centre.astype(np.float32),
        np.stack([x, y / flat[:, None], z], axis=1).astype(np.float32),
        np.where(inside, 0.0, length).astype(np.float32),
        radius.astype(np.float32),
        np.zeros(len(start), dtype=np.bool_),
        scale.astype(np.float32),
        *surfaces.arrays(),
    )


def boxes(
    centre: NDArray[np.float64], half: NDArray[np.float64], yaw: NDArray[np.float64], surfaces: Surfaces
) -> Solids:
    """Upright boxes: ``centre`` ``(K, 3)``, half sizes ``half`` ``(K, 3)``, metres, turned by ``yaw`` ``(K,)``."""
    cos, sin, none, one = np.cos(yaw), np.sin(yaw), np.zeros(len(yaw)), np.ones(len(yaw))
    axes = np.stack(
        [np.stack([cos, sin, none], -1), np.stack([-sin, cos, none], -1), np.stack([none, none, one], -1)], 1
    )
    count = len(centre)
    return Solids(
        centre.astype(np.float32),
        (axes / half[:, :, None]).astype(np.float32),
        np.zeros(count, dtype=np.float32),
        np.ones((count, 2), dtype=np.float32),
        np.ones(count, dtype=np.bool_),
        half.astype(np.float32),
        *surfaces.arrays(),
    )


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
