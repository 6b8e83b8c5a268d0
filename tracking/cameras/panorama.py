"""Views around the vertical through a camera, in which everybody stands upright: cylinders, and a view straight down.

On a vertical cylinder of radius ``scale`` pixels about the camera, a point at azimuth a, horizontal distance d and
height z above the camera has the column ``-scale a`` and the row ``-scale z / d``. So a person d metres away is drawn
upright and ``scale / d`` pixels a metre, in height and width alike, wherever it stands around the camera: as by an
ordinary camera, seen from above. Right under the camera the cylinder has no rows; there the view is a plane below.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray

# What lies so near to the seam behind the view's middle, radians, counts as behind the camera.
SEAM = 0.25


@dataclass(frozen=True)
class CylinderView:
    """A part of the cylinder as a camera.

    Attributes:
        position: ``(3,)`` of the optical centre in the world, metres.
        middle: azimuth of the middle column, radians counter-clockwise from the world's x axis.
        scale: radius of the cylinder, pixels.
        horizon: row of what is as high as the camera, pixels.
        width: pixels.
        height: pixels.
    """

    position: FloatArray
    middle: float
    scale: float
    horizon: float
    width: int
    height: int

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels ``(N, 2)`` and horizontal distances ``(N,)`` of world points ``(N, 3)``; see `SEAM`."""
        away = points - self.position
        distance = np.hypot(away[:, 0], away[:, 1])
        right = (self.middle - np.arctan2(away[:, 1], away[:, 0]) + np.pi) % (2 * np.pi) - np.pi
        with np.errstate(divide="ignore", invalid="ignore"):
            row = self.horizon - self.scale * away[:, 2] / distance
        inside = np.abs(right) < np.pi - SEAM
        return np.column_stack([self.width / 2 + self.scale * right, row]), np.where(inside, distance, -1.0)

    def rays(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Unit world directions ``(N, 3)`` of pixels ``(N, 2)``, in the floating type of ``pixels``."""
        azimuth = self.middle - (pixels[:, 0] - self.width / 2) / self.scale
        directions = np.stack([np.cos(azimuth), np.sin(azimuth), (self.horizon - pixels[:, 1]) / self.scale], axis=1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return np.asarray(directions, dtype=pixels.dtype)


@dataclass(frozen=True)
class DownwardView:
    """A pinhole view straight down; its top is at azimuth ``turn``.

    Attributes:
        position: ``(3,)`` of the optical centre in the world, metres.
        turn: azimuth of the upward direction of the image, radians.
        scale: focal length, pixels.
        width: pixels.
        height: pixels.
    """

    position: FloatArray
    turn: float
    scale: float
    width: int
    height: int

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels ``(N, 2)`` and depths ``(N,)`` of world points ``(N, 3)``."""
        away = points - self.position
        up, right = self._axes(away.dtype)
        depth = -away[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = np.stack([away[:, :2] @ right, -(away[:, :2] @ up)], axis=1) * (self.scale / depth)[:, None]
        return flat + np.array([self.width, self.height]) / 2, depth

    def rays(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Unit world directions ``(N, 3)`` of pixels ``(N, 2)``, in the floating type of ``pixels``."""
        up, right = self._axes(pixels.dtype)
        across, down = (pixels - np.array([self.width, self.height], dtype=pixels.dtype) / 2).T / self.scale
        flat = across[:, None] * right - down[:, None] * up
        directions = np.concatenate([flat, -np.ones((len(pixels), 1), dtype=pixels.dtype)], axis=1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return np.asarray(directions, dtype=pixels.dtype)

    def _axes(self, kind: Any) -> tuple[NDArray[Any], NDArray[Any]]:
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        return np.array([cos, sin], dtype=kind), np.array([sin, -cos], dtype=kind)
