"""Lens distortion as OpenCV writes it, on normalised image coordinates: x/z and y/z in the camera's axes.

Five coefficients are Brown's k1, k2, p1, p2, k3; eight have the rational model's k4, k5, k6 besides, the polynomial
that the radial one is divided by; twelve the thin prism's s1, s2, s3, s4.
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
