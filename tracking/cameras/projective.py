"""The pinhole camera: points of the world to pixels and back to rays.

The world is in metres with z up and the ground at z = 0. A camera looks along its own +z, with x to the right and y
down. Pixels are continuous and 0-based: the first pixel covers [0, 1) and its centre lies at 0.5.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.distortion import distort, undistort
from tsuiseki.tracking.geometry import on_level
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class PinholeCamera:
    """Intrinsics and pose of a camera.

    Attributes:
        width: of the image, pixels.
        height: of the image, pixels.
        focal: ``(2,)`` focal lengths along x and y, pixels.
        principal_point: ``(2,)`` where the optical axis meets the image, pixels.
        rotation: ``(3, 3)`` turns directions of the world into directions of the camera.
        position: ``(3,)`` of the optical centre in the world, metres.
        distortion: ``(5,)`` k1, k2, p1, p2, k3 as OpenCV orders them, ``(8,)`` with k4, k5, k6 or ``(12,)`` with s1 to
            s4 besides (`tracking.cameras.distortion`); all zero for an ideal lens.
    """

    width: int
    height: int
    focal: FloatArray
    principal_point: FloatArray
    rotation: FloatArray
    position: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))

    def __post_init__(self) -> None:
        lens = np.shape(self.distortion) if np.shape(self.distortion) in ((8,), (12,)) else (5,)
        shapes = {"focal": (2,), "principal_point": (2,), "rotation": (3, 3), "position": (3,), "distortion": lens}
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"expected {name} of shape {shape} with finite values, got {value.tolist()}")
            object.__setattr__(self, name, value)
        if self.width < 1 or self.height < 1 or (self.focal <= 0).any():
            raise ValueError(
                "expected a positive image size and focal length, "
                f"got {self.width}x{self.height} and {self.focal.tolist()}"
            )
        if not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(self.rotation) < 0:
            raise ValueError(f"expected a rotation matrix, got {self.rotation.tolist()}")

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
        """``(3, 4)`` projection matrix of the ideal lens: homogeneous world points to homogeneous pixels."""
        intrinsics = np.diag([self.focal[0], self.focal[1], 1.0])
        intrinsics[:2, 2] = self.principal_point
        return np.asarray(intrinsics @ self.rotation @ np.column_stack([np.eye(3), -self.position]))

    def to_camera(self, points: FloatArray) -> FloatArray:
        """``(N, 3)`` world points in the camera's axes: right, down, along the optical axis; metres."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.position) @ self.rotation.T)

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
        """Directions ``(N, 3)`` in the world, of unit length, in which ``(N, 2)`` pixels look.

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

    def ground(self, pixels: FloatArray, height: float = 0.0) -> FloatArray:
        """Where the rays of ``(N, 2)`` pixels meet the plane z = ``height``: ``(N, 3)``, NaN where they do not."""
        return on_level(self.position, self.rays(np.asarray(pixels, dtype=np.float64)), height)
