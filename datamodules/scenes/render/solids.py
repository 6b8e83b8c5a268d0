"""What is drawn: cone-spheres and boxes, each a round cone or a cube under an affine map, with its surface.

A cone-sphere is the convex hull of two spheres.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import Columns, FloatArray

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]

# Unit vector away from the ground.
UP = np.array([0.0, 0.0, 1.0])
# Unit vector of the x axis, where a yaw of 0 points.
FORWARD = np.array([1.0, 0.0, 0.0])
# ``(8, 3)`` of a box with half sides of 1.
CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])

Pattern = IntEnum("Pattern", "PLAIN ACROSS ALONG CHECKS SPECKLE CLOUDS BRICKS WINDOWS LEAVES", start=0)
"""What a surface shows of its second colour; ACROSS and ALONG are stripes."""
Detail = IntEnum("Detail", "NONE HEAD TRUNK PELVIS", start=0)
"""What `shading.paint` adds to the pattern."""
Colour: TypeAlias = tuple[float, float, float]
Pair: TypeAlias = tuple[float, float]


def as_colour(values: FloatArray) -> Colour:
    """Three numbers as a `Colour`."""
    red, green, blue = values.tolist()
    return red, green, blue


def pair(values: FloatArray | Float32) -> Pair:
    """Two numbers as a `Pair`."""
    first, second = values.tolist()
    return first, second


def pattern_of(rng: np.random.Generator, *among: int) -> int:
    """A pattern of ``among``, each as likely."""
    return int(rng.choice(among))


@dataclass(frozen=True)
class Solids(Columns):
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

    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Axes ``(K, 3, 3)`` in the world, as columns, and both ends ``(K, 2, 3)`` of each solid along the last."""
        axes = np.linalg.inv(self.to_local.astype(np.float64))
        last = np.stack([np.zeros_like(axes[:, :, 2]), axes[:, :, 2] * self.length[:, None]], axis=1)
        return axes, self.start[:, None].astype(np.float64) + last


def join(groups: list[Solids]) -> Solids:
    """The solids of ``groups`` one after the other."""
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
    colours = [np.square(values.reshape(-1, 3)) for values in (colour, second)]
    geometry = [values.astype(np.float32) for values in shape]
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
    """Solids that are put together one after another, in the axes of a thing on the ground.

    Args:
        position: ``(2,)`` metres, where the thing stands.
        yaw: where it faces, radians; its boxes do.
        lift: metres over the ground from which heights count.
    """

    def __init__(self, position: FloatArray = FORWARD[1:], yaw: float = 0.0, lift: float = 0.0) -> None:
        self.base, self.yaw = np.array([position[0], position[1], lift]), yaw
        # What makes solids of rows, and one row.
        self._rows: list[tuple[Callable[..., Solids], Any]] = []

    def at(self, ahead: float = 0.0, left: float = 0.0, up: float = 0.0) -> FloatArray:
        """``(3,)`` world point of the thing's axes, metres."""
        return self.base + ahead * along(self.yaw) + left * across(self.yaw) + up * UP

    def beside(self, ahead: float, left: float = 0.0) -> Parts:
        """Parts that stand so far from here, and belong to the same thing."""
        parts = Parts(self.at(ahead, left), self.yaw)
        parts._rows = self._rows
        return parts

    def cone(
        self, start: FloatArray, end: FloatArray, radii: Pair, surface: Surface, flat: float = 1.0,
        front: FloatArray = FORWARD,
    ) -> None:  # fmt: skip
        """Add what lies between two spheres; see `cone_spheres`."""
        self._rows.append((cone_spheres, (start, end, radii, front, flat, surface)))

    def box(self, centre: FloatArray, half: Sequence[float] | FloatArray, surface: Surface) -> None:
        """Add an upright box; see `boxes`."""
        self._rows.append((boxes, (centre, half, self.yaw, surface)))

    def solids(self) -> Solids:
        """All of them, in the order in which they were added."""
        groups: list[Solids] = []
        for make, rows in itertools.groupby(self._rows, key=operator.itemgetter(0)):
            *columns, surfaces = zip(*(row for _, row in rows), strict=True)
            groups.append(make(*(np.array(column, dtype=np.float64) for column in columns), surfaces))
        return join(groups)


def along(yaw: float) -> FloatArray:
    """``(3,)`` level unit vector towards ``yaw``, radians."""
    return np.array([np.cos(yaw), np.sin(yaw), 0.0])


def across(yaw: float) -> FloatArray:
    """``(3,)`` level unit vector to the left of ``yaw``."""
    return np.array([-np.sin(yaw), np.cos(yaw), 0.0])
