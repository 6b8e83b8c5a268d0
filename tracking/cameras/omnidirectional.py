"""The omnidirectional camera of Scaramuzza, Martinelli and Siegwart (IROS 2006): one polynomial from pixel to ray.

Axes. A camera looks along its own +z, with x to the right and y down, as `PinholeCamera` does; pixels are continuous
and the first one's centre lies at 0.5. OCamCalib writes the same lens in other axes: its x runs along the rows of the
image (our y), its y along the columns (our x), points of the scene have z < 0 (our -z), and pixels are counted from
the first one's centre::

        ours                         OCamCalib
        +----> x (columns)           +----> y (columns)
        |                            |
        v                            v
        y (rows),  z into the scene  x (rows),  z out of the scene

`lens_files` converts at the border. With the sensor point ``(x, y) = stretch^-1 (pixel - centre)`` and
``rho = |(x, y)|``, the pixel's ray is ``(x, y, F(rho))``, where ``F`` is the direct polynomial, ``F(0) > 0``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.projective import PosedCamera
from tsuiseki.tracking.types import BoolArray, FloatArray

Resize: TypeAlias = Literal["cut", "widen"]
# Entries of the table that starts Newton's method.
ENTRIES = 8192
# Points that are worked on at a time: as many as fit the cache.
CHUNK = 16384
# Steps along the radius in which the polynomial is checked.
CHECKS = 4096


@dataclass(frozen=True)
class OmnidirectionalLens:
    """How rays of the camera's axes become pixels.

    Attributes:
        width: of the image, pixels.
        height: of the image, pixels.
        direct: ``(N,)`` coefficients of F, low to high; the first is above 0, the second is 0.
        centre: ``(2,)`` x, y where the optical axis meets the image, pixels.
        stretch: ``(2, 2)`` sensor points to pixels relative to the centre.
        inverse: ``(M,)`` OCamCalib's inverse polynomial, low to high, from the angle between the ray and the image
            plane (the angle to the axis less a right angle, radians) to rho; empty where there is none. Projection
            does not use it: it solves the direct one.
        field: largest angle between a ray and the optical axis, radians; None takes all that the image holds and the
            polynomial describes.
    """

    width: int
    height: int
    direct: FloatArray
    centre: FloatArray
    stretch: FloatArray = field(default_factory=lambda: np.eye(2))
    inverse: FloatArray = field(default_factory=lambda: np.empty(0))
    field: float | None = None

    def __post_init__(self) -> None:
        for name, shape in (("direct", None), ("inverse", None), ("centre", (2,)), ("stretch", (2, 2))):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if not np.isfinite(value).all() or (value.ndim != 1 if shape is None else value.shape != shape):
                raise ValueError(f"expected finite {name}{'' if shape is None else f' of shape {shape}'}, got {value}")
            object.__setattr__(self, name, value)
        if self.width < 1 or self.height < 1:
            raise ValueError(f"expected a positive image size, got {self.width}x{self.height}")
        if len(self.direct) < 1 or self.direct[0] <= 0 or (len(self.direct) > 1 and self.direct[1] != 0):
            raise ValueError(f"expected a direct polynomial that is above 0 and flat at 0, got {self.direct.tolist()}")
        if abs(np.linalg.det(self.stretch)) < 1e-6:
            raise ValueError(f"expected a stretch that can be inverted, got {self.stretch.tolist()}")
        if self.field is not None and not 0 < self.field < np.pi:
            raise ValueError(f"expected a field between 0 and pi radians, got {self.field}")
        if self.rim <= 0:
            raise ValueError("expected a direct polynomial whose rays turn away from the axis, got one that does not")

    @cached_property
    def rim(self) -> float:
        """The largest rho that is seen: of the field, the image's corners, or the polynomial's turning back."""
        corners = np.array([[x, y] for x in (0, self.width) for y in (0, self.height)], dtype=np.float64)
        reach = float(np.linalg.norm(self._sensor(corners), axis=1).max())
        rho = np.linspace(0, reach, CHECKS)
        angle = np.arctan2(rho, self.forward(rho))
        last = int(np.argmax(np.append(np.diff(angle) <= 0, True)))
        if self.field is not None and self.field < angle[last]:
            return float(np.interp(self.field, angle[: last + 1], rho[: last + 1]))
        return float(rho[last])

    def forward(self, rho: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """``F``: the ray's part along the axis, of the radius on the sensor, pixels."""
        return _horner(self.direct, rho)

    def rays(self, pixels: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Unit directions ``(N, 3)`` of ``(N, 2)`` pixels, in their floating type; NaN beyond the rim."""
        pixels = np.asarray(pixels)
        kind = np.dtype(np.float32) if pixels.dtype == np.float32 else np.dtype(np.float64)
        sensor = self._sensor(pixels.astype(kind, copy=False))
        x: Any = sensor[:, 0]
        y: Any = sensor[:, 1]
        rho = np.sqrt(x * x + y * y)
        z: Any = self.forward(rho).astype(kind, copy=False)
        length = np.sqrt(x * x + y * y + z * z)
        length[rho > self.rim * (1 + 1e-6)] = np.nan
        return np.asarray(np.stack([x, y, z], axis=-1) / length[:, None])

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels ``(N, 2)`` of ``(N, 3)`` points or directions in the camera's axes; NaN outside the field.

        The smallest root of ``F(rho) n = z rho`` with ``n = |(x, y)|``, by Newton's method from a table.
        """
        points = np.asarray(points, dtype=np.float64)
        pixels = np.empty((len(points), 2))
        for start in range(0, len(points), CHUNK):
            part = slice(start, start + CHUNK)
            x, y, z = points[part].T
            across = np.sqrt(x * x + y * y)
            with np.errstate(invalid="ignore", divide="ignore"):
                scale = self._radii(across, z) / across
            scale[(across == 0) & (z > 0)] = 0.0
            x, y = x * scale, y * scale
            for axis, (a, b) in enumerate(self.stretch):
                pixels[part, axis] = x * a + y * b + self.centre[axis]
        return pixels

    def project_by_inverse(self, points: FloatArray) -> FloatArray:
        """As `project`, by OCamCalib's inverse polynomial, which is only near the root.

        Raises:
            ValueError: the lens has no inverse polynomial.
        """
        if not len(self.inverse):
            raise ValueError("expected a lens with an inverse polynomial, got one without")
        points = np.asarray(points, dtype=np.float64)
        across = np.hypot(points[:, 0], points[:, 1])
        rho = _horner(self.inverse, np.arctan2(-points[:, 2], across))
        unit = points[:, :2] / np.maximum(across, 1e-300)[:, None]
        return np.asarray((unit * rho[:, None]) @ self.stretch.T + self.centre)

    def resized(self, width: int, height: int, how: Resize = "cut") -> OmnidirectionalLens:
        """The same lens over an image of another size, scaled evenly about the middle.

        A camera makes a broader image of the same sensor in one of two ways, which only the pictures tell. ``cut``: the
        old image covers the new one, so that a 640x480 calibration over 1280x720 is scaled by 2 and loses 120 rows
        above and below. ``widen``: the new one sees more at its sides, so that it is scaled by 1.5 and gains 160
        columns on the left and right.
        """
        factors = width / self.width, height / self.height
        scale = max(factors) if how == "cut" else min(factors)
        powers = scale ** (1.0 - np.arange(len(self.direct)))
        cut = (np.array([width, height]) - scale * np.array([self.width, self.height])) / 2
        return replace(
            self,
            width=width,
            height=height,
            direct=self.direct * powers,
            inverse=self.inverse * scale,
            centre=self.centre * scale + cut,
        )

    def within_rim(self, pixels: NDArray[np.floating[Any]]) -> BoolArray:
        """``(N,)`` whether ``(N, 2)`` pixels lie within the rim."""
        x, y = self._sensor(np.asarray(pixels, dtype=np.float64)).T
        return np.asarray(x * x + y * y <= self.rim**2)

    def _sensor(self, pixels: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """``(N, 2)`` sensor points of ``(N, 2)`` pixels, of one type."""
        back = np.linalg.inv(self.stretch).astype(pixels.dtype)
        return np.asarray((pixels - self.centre.astype(pixels.dtype)) @ back.T)

    def _radii(self, across: FloatArray, z: FloatArray) -> FloatArray:
        """``(N,)`` rho of rays with parts ``across`` and ``z``, NaN outside the field."""
        table = self._table
        turn = _turn(across, z) * ((ENTRIES - 1) / self._largest_turn)
        outside = ~(turn <= ENTRIES - 1)
        turn[outside] = 0
        entry = np.minimum(turn.astype(np.int32), ENTRIES - 2)
        start = table.take(entry)
        rho = start + (turn - entry) * (table.take(entry + 1) - start)
        value, slope = _horner_with_slope(self.direct, rho)
        rho -= (value * across - z * rho) / (slope * across - z)
        rho[outside] = np.nan
        return np.asarray(rho)

    @cached_property
    def _largest_turn(self) -> float:
        return float(_turn(np.array([self.rim]), self.forward(np.array([self.rim])))[0])

    @cached_property
    def _table(self) -> FloatArray:
        """``(ENTRIES,)`` rho at even steps of `_turn` up to the rim."""
        rho = np.linspace(0, self.rim, 4 * ENTRIES)
        turns = np.linspace(0, self._largest_turn, ENTRIES)
        return np.asarray(np.interp(turns, _turn(rho, self.forward(rho)), rho))


@dataclass(frozen=True)
class OmnidirectionalCamera(PosedCamera):
    """A lens with a pose in a world of metres, z up, the floor at z = 0.

    Attributes:
        lens: rays to pixels.
        rotation: ``(3, 3)`` turns directions of the world into directions of the camera.
        position: ``(3,)`` of the optical centre in the world, metres.
    """

    lens: OmnidirectionalLens
    rotation: FloatArray
    position: FloatArray

    def __post_init__(self) -> None:
        self._check()

    @property
    def width(self) -> int:
        """Of the image, pixels."""
        return self.lens.width

    @property
    def height(self) -> int:
        """Of the image, pixels."""
        return self.lens.height

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels ``(N, 2)`` of ``(N, 3)`` points and their distances ``(N,)``, metres.

        What lies outside the field has NaN for its pixel and a distance of 0.
        """
        local = self.to_camera(points)
        pixels = self.lens.project(local)
        distance = np.sqrt(np.einsum("ij,ij->i", local, local))
        distance[np.isnan(pixels[:, 0])] = 0.0
        return pixels, distance

    def rays(self, pixels: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Unit directions ``(N, 3)`` in the world of ``(N, 2)`` pixels, in their floating type; NaN beyond the rim."""
        local = self.lens.rays(pixels)
        return np.asarray(local @ self.rotation.astype(local.dtype))


def _turn(across: FloatArray, z: NDArray[np.floating[Any]]) -> FloatArray:
    """A stand-in for the angle to the axis that costs no arc tangent: 0 along it, 1 across, 2 against it; rising."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(1 - z / (across + np.abs(z)))


def _horner(coefficients: FloatArray, x: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """The polynomial with ``coefficients``, low to high, at ``x``, in the type of ``x``."""
    kind = x.dtype.type
    value = np.full(x.shape, kind(coefficients[-1]))
    for coefficient in coefficients[-2::-1]:
        value *= x
        value += kind(coefficient)
    return value


def _horner_with_slope(coefficients: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    value, slope = np.full(x.shape, coefficients[-1]), np.zeros(x.shape)
    for coefficient in coefficients[-2::-1]:
        slope *= x
        slope += value
        value *= x
        value += coefficient
    return value, slope
