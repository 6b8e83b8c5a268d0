"""The pinhole camera: points of the world to pixels and back to rays.

The world is in metres with z up and the ground at z = 0. A camera looks along its own +z, with x to the right and y
down. Pixels are continuous and 0-based: the first pixel covers [0, 1) and its centre lies at 0.5.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.geometry import on_level
from tsuiseki.tracking.types import FloatArray


class PosedCamera:
    """What a camera with any lens does by its pose in the world.

    Attributes:
        rotation: ``(3, 3)`` turns directions of the world into directions of the camera.
        position: ``(3,)`` of the optical centre in the world, metres.
    """

    rotation: FloatArray
    position: FloatArray

    def _check(self, **shapes: tuple[int, ...]) -> None:
        """Make arrays of fields that have these shapes; raises ValueError for others, and for no rotation."""
        for name, shape in {"rotation": (3, 3), "position": (3,), **shapes}.items():
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"expected {name} of shape {shape} with finite values, got {value.tolist()}")
            object.__setattr__(self, name, value)
        if not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(self.rotation) < 0:
            raise ValueError(f"expected a rotation matrix, got {self.rotation.tolist()}")

    def to_camera(self, points: FloatArray) -> FloatArray:
        """``(N, 3)`` world points in the camera's axes: right, down, along the optical axis; metres."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.position) @ self.rotation.T)

    def rays(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Unit directions ``(N, 3)`` in the world of the rays of ``(N, 2)`` pixels, in their floating type."""
        raise NotImplementedError

    def ground(self, pixels: FloatArray, height: float = 0.0) -> FloatArray:
        """Where the rays of ``(N, 2)`` pixels meet the plane z = ``height``: ``(N, 3)``, NaN where they do not."""
        return on_level(self.position, self.rays(np.asarray(pixels, dtype=np.float64)), height)


@dataclass(frozen=True)
class PinholeCamera(PosedCamera):
    """Intrinsics and pose of a camera; without a pose at the origin of the world, looking along its third axis.

    Attributes:
        width: of the image, pixels.
        height: of the image, pixels.
        focal: ``(2,)`` focal lengths along x and y, pixels.
        principal_point: ``(2,)`` where the optical axis meets the image, pixels.
        rotation: ``(3, 3)``, see `PosedCamera`.
        position: ``(3,)`` metres.
        distortion: ``(5,)`` k1, k2, p1, p2, k3 as OpenCV orders them, ``(8,)`` with k4, k5, k6 or ``(12,)`` with s1 to
            s4 besides; all zero for an ideal lens.
    """

    width: int
    height: int
    focal: FloatArray
    principal_point: FloatArray
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))

    def __post_init__(self) -> None:
        lens = np.shape(self.distortion) if np.shape(self.distortion) in ((8,), (12,)) else (5,)
        self._check(focal=(2,), principal_point=(2,), distortion=lens)
        if self.width < 1 or self.height < 1 or (self.focal <= 0).any():
            raise ValueError(
                "expected a positive image size and focal length, "
                f"got {self.width}x{self.height} and {self.focal.tolist()}"
            )

    @classmethod
    def look_at(
        cls, position: FloatArray, target: FloatArray, focal: float, width: int, height: int, roll: float = 0.0
    ) -> PinholeCamera:
        """A camera at ``position`` whose optical axis passes through ``target``, upright but for ``roll``.

        Args:
            position: ``(3,)`` metres.
            target: ``(3,)`` metres, another point.
            focal: pixels, the same along x and y.
            width: of the image, pixels; the axis meets its centre.
            height: of the image, pixels.
            roll: clockwise turn of the camera about its axis, radians.

        Raises:
            ValueError: ``target`` is ``position``.
        """
        position = np.asarray(position, dtype=np.float64)
        forward = np.asarray(target, dtype=np.float64) - position
        distance = np.linalg.norm(forward)
        if distance < 1e-9:
            raise ValueError(f"expected a target away from the camera's position {position.tolist()}")
        forward = forward / distance
        right = np.cross(forward, [0.0, 0.0, 1.0])
        # Looking straight up or down leaves the horizontal axis open; +x of the world is as good as any.
        right = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(right) < 1e-9 else right / np.linalg.norm(right)
        down = np.cross(forward, right)
        turn = np.array([[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
        return cls(
            width=width,
            height=height,
            focal=np.array([focal, focal], dtype=np.float64),
            principal_point=np.array([width / 2, height / 2]),
            rotation=turn @ np.stack([right, down, forward]),
            position=position,
        )

    @property
    def matrix(self) -> FloatArray:
        """``(3, 4)`` matrix M of the ideal lens, thesis eq. 4.1: homogeneous world points to homogeneous pixels."""
        intrinsics = np.diag([self.focal[0], self.focal[1], 1.0])
        intrinsics[:2, 2] = self.principal_point
        return np.asarray(intrinsics @ self.rotation @ np.column_stack([np.eye(3), -self.position]))

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels ``(N, 2)`` of ``(N, 3)`` points and their depths ``(N,)`` along the optical axis, metres.

        A point at or behind the camera has a depth of at most zero and NaN for its pixel, and so has one so far off
        the axis that the lens coefficients do not describe it.
        """
        local = self.to_camera(points)
        return self.project_local(local), local[:, 2]

    def project_local(self, points: FloatArray) -> FloatArray:
        """Pixels ``(N, 2)`` of ``(N, 3)`` points in the camera's axes, NaN as in `project`."""
        depth = points[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            ideal = points[:, :2] / depth[:, None]
            if self.distortion.any():
                ideal = distort(ideal, self.distortion)
            pixels = ideal * self.focal + self.principal_point
        pixels[depth <= 0] = np.nan
        return np.asarray(pixels)

    def normalised(self, pixels: FloatArray) -> FloatArray:
        """``(N, 2)`` pixels as x/z and y/z in the camera's axes, freed from distortion."""
        ideal = (np.asarray(pixels, dtype=np.float64) - self.principal_point) / self.focal
        return undistort(ideal, self.distortion) if self.distortion.any() else ideal

    def rays(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Directions ``(N, 3)`` in the world, of unit length, of the rays of ``(N, 2)`` pixels.

        The result has the floating type of ``pixels``: float32 is enough to draw.
        """
        pixels = np.asarray(pixels)
        kind = pixels.dtype if pixels.dtype == np.float32 else np.dtype(np.float64)
        local = np.ones((3, len(pixels)), dtype=kind)
        for axis in (0, 1):
            local[axis] = (pixels[:, axis] - kind.type(self.principal_point[axis])) / kind.type(self.focal[axis])
        if self.distortion.any():
            local[:2] = undistort(local[:2].T, self.distortion).T
        local /= np.sqrt(local[0] ** 2 + local[1] ** 2 + 1)
        return (self.rotation.T.astype(kind) @ local).T


class Camera(Protocol):
    """A camera with one optical centre.

    Attributes:
        width: of the image, pixels.
        height: of the image, pixels.
        position: ``(3,)`` of the optical centre in the world, metres.
    """

    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...

    @property
    def position(self) -> FloatArray: ...

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels ``(N, 2)`` and depths ``(N,)`` of world points ``(N, 3)``; a depth of 0 or less is not seen."""
        ...


def distort(points: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Where ideal ``(N, 2)`` points appear through the lens; NaN beyond the radius the coefficients describe.

    Past the first maximum of the radial polynomial a point would fold back into the image, where no lens puts it.
    """
    distorted = _displaced(points, coefficients)
    limit = largest_radius(coefficients)
    if np.isfinite(limit):
        distorted[np.einsum("ij,ij->i", points, points) > limit**2] = np.nan
    return distorted


def undistort(points: NDArray[Any], coefficients: FloatArray, iterations: int = 12) -> FloatArray:
    """The ideal ``(N, 2)`` points that `distort` takes to ``points``, by Newton's method; NaN where there is none."""
    target = np.asarray(points, dtype=np.float64)
    limit = largest_radius(coefficients)
    # Strong barrel distortion pushes the start outside the radius where the polynomial can be inverted.
    radius = np.sqrt(np.einsum("ij,ij->i", target, target))
    start = np.minimum(1.0, 0.7 * limit / np.maximum(radius, 1e-12)) if np.isfinite(limit) else np.ones(len(target))
    ideal = target * start[:, None]
    for _ in range(iterations):
        error = _displaced(ideal, coefficients) - target
        j = _jacobian(ideal, coefficients)
        determinant = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            step_x = (j[:, 1, 1] * error[:, 0] - j[:, 0, 1] * error[:, 1]) / determinant
            step_y = (j[:, 0, 0] * error[:, 1] - j[:, 1, 0] * error[:, 0]) / determinant
        ideal = ideal - np.stack([step_x, step_y], axis=-1)
    with np.errstate(invalid="ignore"):
        missed = ~(np.abs(distort(ideal, coefficients) - target).max(axis=1, initial=0.0) < 1e-9)
    ideal[missed] = np.nan
    return np.asarray(ideal)


def largest_radius(coefficients: FloatArray) -> float:
    """The ideal radius up to which the radial displacement grows; infinite when it always does."""
    radial = [*coefficients[[0, 1, 4]], *coefficients[5:8]]
    return _turning_point(*(float(k) for k in radial), *[0.0] * (6 - len(radial)))


# Asked at every projection; the roots of the few lenses of a run cost more than the projection of 500 points.
@lru_cache(maxsize=64)
def _turning_point(k1: float, k2: float, k3: float, k4: float, k5: float, k6: float) -> float:
    # d/dr of r N / D, N = 1 + k1 u + k2 u^2 + k3 u^3 and D likewise, is zero where this polynomial in u = r^2 is; where
    # D is zero the displacement is infinite.
    above, below = np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0])
    u = np.poly1d([2.0, 0.0])
    slope = (above + u * above.deriv()) * below - u * above * below.deriv()
    roots = np.concatenate([slope.roots, below.roots])
    real = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    return float(np.sqrt(real.min())) if len(real) else float("inf")


def _radial(square: FloatArray, coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The radial factor at squared radii ``(N,)``, and its derivative by the squared radius."""
    k1, k2, k3 = coefficients[[0, 1, 4]]
    factor = 1 + square * (k1 + square * (k2 + square * k3))
    slope = k1 + square * (2 * k2 + square * 3 * k3)
    if len(coefficients) > 5:
        k4, k5, k6 = coefficients[5:8]
        below = 1 + square * (k4 + square * (k5 + square * k6))
        falling = k4 + square * (2 * k5 + square * 3 * k6)
        factor, slope = factor / below, (slope * below - factor * falling) / below**2
    return factor, slope


def _displaced(points: FloatArray, coefficients: FloatArray) -> FloatArray:
    p1, p2 = coefficients[2:4]
    x, y = points[:, 0], points[:, 1]
    square = x * x + y * y
    radial, _ = _radial(square, coefficients)
    moved = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    if len(coefficients) > 8:
        s1, s2, s3, s4 = coefficients[8:12]
        moved[:, 0] += square * (s1 + square * s2)
        moved[:, 1] += square * (s3 + square * s4)
    return moved


def _jacobian(points: FloatArray, coefficients: FloatArray) -> FloatArray:
    p1, p2 = coefficients[2:4]
    x, y = points[:, 0], points[:, 1]
    square = x * x + y * y
    radial, slope = _radial(square, coefficients)
    mixed = 2 * (x * y * slope + p1 * x + p2 * y)
    j = np.empty((len(points), 2, 2))
    j[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    j[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    j[:, 0, 1] = j[:, 1, 0] = mixed
    if len(coefficients) > 8:
        s1, s2, s3, s4 = coefficients[8:12]
        for row, grows in enumerate((s1 + 2 * square * s2, s3 + 2 * square * s4)):
            j[:, row, 0] += 2 * x * grows
            j[:, row, 1] += 2 * y * grows
    return j
