"""From one model of a wide lens to another, by least squares of the distance in pixels over the image.

Besides Scaramuzza's polynomial there are two models:

* the equidistant model of Kannala and Brandt, ``r = theta + k1 theta^3 + ... + k4 theta^9`` (OpenCV's fisheye, and
  Kalibr's pinhole with equidistant distortion);
* Mei's unified model, ``(x, y) / (z + xi)`` of a point on the unit sphere, with two radial and two tangential
  coefficients (Kalibr's omni).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from scipy.optimize import least_squares

from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens
from tsuiseki.tracking.types import BoolArray, FloatArray

# Degree of F that others are fitted by; OCamCalib's usual 4 leaves whole pixels near the rim of some lenses.
DEGREE = 8
# Degree of the inverse polynomial.
INVERSE_DEGREE = 14
# Pixels along the longer side of the grid on which two lenses are compared, and angles to the axis.
GRID = 60
# Directions about the axis.
RING = 24
# Angle to the axis beyond which no point of another model is compared, radians.
WIDEST = 2.6


@dataclass(frozen=True)
class EquidistantLens:
    """Kannala and Brandt's lens.

    Attributes:
        width: of the image, pixels.
        height: of the image, pixels.
        focal: ``(2,)`` pixels.
        principal_point: ``(2,)`` pixels.
        distortion: ``(4,)`` k1 to k4.
        skew: pixels.
    """

    width: int
    height: int
    focal: FloatArray
    principal_point: FloatArray
    distortion: FloatArray
    skew: float = 0.0

    # Focal length, in those of the other lens, and numbers of its own with which a fit begins.
    START: ClassVar[tuple[float, ...]] = (1.0,)

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels ``(N, 2)`` of ``(N, 3)`` points in the camera's axes; NaN past the polynomial's turning back."""
        across = np.hypot(points[:, 0], points[:, 1])
        theta = np.arctan2(across, points[:, 2])
        square = theta**2
        k1, k2, k3, k4 = self.distortion
        radius = theta * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
        grid = np.linspace(0, np.pi, 2048)
        slope = 1 + grid**2 * (3 * k1 + grid**2 * (5 * k2 + grid**2 * (7 * k3 + grid**2 * 9 * k4)))
        limit = grid[int(np.argmax(slope <= 0))] if (slope <= 0).any() else np.pi
        unit = points[:, :2] / np.maximum(across, 1e-300)[:, None]
        return self._pixels(unit * radius[:, None], theta > limit)

    def _pixels(self, ideal: FloatArray, hidden: BoolArray) -> FloatArray:
        """``(N, 2)`` pixels of ``(N, 2)`` points of the lens of focal length 1, NaN where they are hidden."""
        pixels = ideal * self.focal + self.principal_point
        pixels[:, 0] += self.skew * ideal[:, 1]
        pixels[hidden] = np.nan
        return np.asarray(pixels)

    @classmethod
    def fitted(cls, lens: OmnidirectionalLens) -> tuple[Self, FloatArray]:
        """The nearest to ``lens``, and the ``(N,)`` distances over the image, pixels."""
        pixels, rays = image_rays(lens)

        def errors(x: FloatArray) -> FloatArray:
            return np.asarray(np.nan_to_num(cls._of(lens, x).project(rays) - pixels, nan=1e3).ravel())

        focal, *extra = cls.START
        start = np.array([focal, focal, *lens.centre / lens.direct[0], *extra, 0, 0, 0, 0], dtype=np.float64)
        fit = least_squares(errors, start, x_scale="jac", max_nfev=500)
        return cls._of(lens, fit.x), np.hypot(*fit.fun.reshape(-1, 2).T)

    @classmethod
    def _of(cls, lens: OmnidirectionalLens, x: FloatArray) -> Self:
        """From numbers that are fitted: focal length and principal point in those of ``lens``, own ones, distortion."""
        scale, extra = lens.direct[0], [float(value) for value in x[4:-4]]
        return cls(lens.width, lens.height, x[:2] * scale, x[2:4] * scale, x[-4:], 0.0, *extra)


@dataclass(frozen=True)
class UnifiedLens(EquidistantLens):
    """Mei's lens, with a distortion k1, k2, p1, p2.

    Attributes:
        xi: of the mirror.
    """

    xi: float = 1.0

    START: ClassVar[tuple[float, ...]] = (2.0, 1.0)

    def project(self, points: FloatArray) -> FloatArray:
        """Pixels ``(N, 2)`` of ``(N, 3)`` points in the camera's axes; NaN where the model has no image."""
        unit = points / np.linalg.norm(points, axis=1, keepdims=True)
        depth = unit[:, 2] + self.xi
        # Beyond this two rays meet in one pixel.
        hidden = depth <= (0 if self.xi < 1 else self.xi - 1 / self.xi)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = (unit[:, :2] / depth[:, None]).T
        k1, k2, p1, p2 = self.distortion
        square = x * x + y * y
        # Where the radius turns back, its slope 1 + 3 k1 r^2 + 5 k2 r^4 has its first root.
        turns = np.roots([5 * k2, 3 * k1, 1.0])
        hidden |= square > min((root.real for root in turns if root.imag == 0 and root.real > 0), default=np.inf)
        radial = 1 + square * (k1 + square * k2)
        u = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
        v = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
        return self._pixels(np.stack([u, v], axis=1), hidden)


def fit_omnidirectional(lens: EquidistantLens, degree: int = DEGREE) -> OmnidirectionalLens:
    """Scaramuzza's lens nearest to another, with its inverse polynomial.

    F is fitted to the cotangents of the angles, which it is linear in, and then to the pixels.
    """
    # Unit directions evenly over the field.
    grid = np.meshgrid(np.linspace(0.01, WIDEST, GRID), np.linspace(0, 2 * np.pi, RING, endpoint=False))
    theta, turn = grid[0].ravel(), grid[1].ravel()
    points = np.stack([np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn), np.cos(theta)], axis=1)
    pixels = lens.project(points)
    inside = np.isfinite(pixels).all(axis=1) & (pixels >= 0).all(axis=1)
    inside &= (pixels <= [lens.width, lens.height]).all(axis=1)
    angles = np.arccos(points[:, 2])
    widest = angles[inside].max()
    beyond = angles[angles > widest + 1e-9]
    # A circle that ends inside the picture has an end; elsewhere the picture is one.
    ends = len(beyond) and np.isnan(pixels[np.isclose(angles, beyond.min()), 0]).all()
    points, pixels = points[inside], pixels[inside]
    centre = lens.project(np.array([[0.0, 0.0, 1.0]]))[0]
    rho = np.linalg.norm(pixels - centre, axis=1)
    across = np.hypot(points[:, 0], points[:, 1])
    powers = np.array([0, *range(2, degree + 1)])
    unit = rho.max()
    # F(rho) sin = rho cos, written so that rows near the axis do not blow up.
    matrix = (rho[:, None] / unit) ** powers * across[:, None]
    solved = np.linalg.lstsq(matrix, rho / unit * points[:, 2], rcond=None)[0]

    def of(x: FloatArray) -> OmnidirectionalLens:
        direct = np.zeros(degree + 1)
        direct[powers] = x[: len(powers)] * unit ** (1.0 - powers)
        stretch = np.array([[1.0, x[-3]], [x[-2], x[-1]]])
        return OmnidirectionalLens(lens.width, lens.height, direct, x[-5:-3] * unit, stretch)

    def errors(x: FloatArray) -> FloatArray:
        # Rays instead of pixels: F may turn back on the way to the minimum, where no pixel would belong to a ray.
        tried = of(x)
        sensor = (pixels - tried.centre) @ np.linalg.inv(tried.stretch).T
        radius = np.hypot(*sensor.T)
        rays = np.column_stack([sensor, tried.forward(radius)])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return np.asarray((unit * np.cross(rays, points)).ravel())

    start = np.array([*solved, *centre / unit, 0.0, 0.0, 1.0])
    fitted = of(least_squares(errors, start, method="lm", x_scale="jac", max_nfev=2000).x)
    return fit_inverse(replace(fitted, field=float(widest)) if ends else fitted)


def fit_inverse(lens: OmnidirectionalLens) -> OmnidirectionalLens:
    """``lens`` with the inverse polynomial nearest to its exact inverse."""
    rho = np.linspace(0, lens.rim, 2000)
    angle = -np.arctan2(lens.forward(rho), rho)
    fitted = np.polynomial.Polynomial.fit(angle, rho, INVERSE_DEGREE).convert()
    return replace(lens, inverse=np.asarray(fitted.coef, dtype=np.float64))


def image_rays(lens: OmnidirectionalLens) -> tuple[FloatArray, FloatArray]:
    """A grid of pixels ``(N, 2)`` over the image within the rim, and their unit rays ``(N, 3)``."""
    step = max(lens.width, lens.height) / GRID
    x, y = np.meshgrid(np.arange(step / 2, lens.width, step), np.arange(step / 2, lens.height, step))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    rays = lens.rays(pixels)
    within = np.isfinite(rays[:, 0])
    return pixels[within], rays[within]


def inverse_error(lens: OmnidirectionalLens) -> float:
    """How far the inverse polynomial is from the exact root at most, over every pixel of the image; pixels."""
    x, y = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    pixels = np.column_stack([x.ravel(), y.ravel()])
    # It is worst in the corners, which a grid would miss.
    pixels = pixels[lens.within_rim(pixels)]
    return float(
        np.nanmax(np.hypot(*(lens.project_by_inverse(np.asarray(lens.rays(pixels), dtype=np.float64)) - pixels).T))
    )


def distances(lens: OmnidirectionalLens, second: OmnidirectionalLens | EquidistantLens) -> FloatArray:
    """``(N,)`` pixels between where two lenses put the same rays, over what both see of the image."""
    pixels, rays = image_rays(lens)
    away = np.hypot(*(second.project(rays) - pixels).T)
    return np.asarray(away[np.isfinite(away)])
