"""Brown's lens distortion as OpenCV writes it: five coefficients k1, k2, p1, p2, k3 on normalised image coordinates.

Normalised coordinates are x/z and y/z in the camera's axes, before focal length and principal point.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray


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
    """The ideal radius up to which the radial polynomial grows; infinite when it always does."""
    return _turning_point(*(float(coefficients[k]) for k in (0, 1, 4)))


# Asked at every projection; the roots of the few lenses of a run cost more than the projection of 500 points.
@lru_cache(maxsize=64)
def _turning_point(k1: float, k2: float, k3: float) -> float:
    # d/dr of r (1 + k1 r^2 + k2 r^4 + k3 r^6), as a polynomial in r^2.
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    real = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    return float(np.sqrt(real.min())) if len(real) else float("inf")


def _displaced(points: FloatArray, coefficients: FloatArray) -> FloatArray:
    k1, k2, p1, p2, k3 = coefficients
    x, y = points[:, 0], points[:, 1]
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def _jacobian(points: FloatArray, coefficients: FloatArray) -> FloatArray:
    k1, k2, p1, p2, k3 = coefficients
    x, y = points[:, 0], points[:, 1]
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    slope = 2 * (k1 + square * (2 * k2 + square * 3 * k3))
    mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
    xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
    yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return np.stack([np.stack([xx, mixed], -1), np.stack([mixed, yy], -1)], axis=1)
