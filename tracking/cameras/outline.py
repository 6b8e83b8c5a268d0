"""The outline of a sphere in a camera.

Rays that touch a sphere form a cone, and an ideal lens images the cone as an ellipse. Off the axis it is longer than
the circle of radius focal length x radius / depth, and its centre is not the image of the sphere's centre. With the
centre at (x, y, z) in the camera's axes, rho^2 = x^2 + y^2, d^2 = rho^2 + z^2 and radius R, on the plane z = 1:

    centre (x, y) z / (z^2 - R^2),  half axis away from the axis  R sqrt(d^2 - R^2) / (z^2 - R^2),
    half axis across  R / sqrt(z^2 - R^2).

A distorting lens bends the ellipse; the ellipse whose outline is nearest to the bent one is used. To second order in
the half axes the bent outline is an ellipse still; what is left, of third order, is some thousandths of a pixel while
the sphere covers a small part of the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.cameras.projective import PinholeCamera, distort
from tsuiseki.tracking.types import FloatArray

# Points at which a bent ellipse is sampled, enough for harmonics up to the third.
POINTS_ON_BENT_ELLIPSE = 8


@dataclass(frozen=True)
class Outlines:
    """Ellipses ``middle + first cos t + second sin t`` of N spheres.

    Attributes:
        centre: ``(N, 2)`` pixels of the spheres' centres.
        middle: ``(N, 2)`` pixels of the ellipses' centres.
        first: ``(N, 2)`` one half axis, pixels; away from the optical axis if the lens is ideal.
        second: ``(N, 2)`` the other.
    """

    centre: FloatArray
    middle: FloatArray
    first: FloatArray
    second: FloatArray

    def points(self, angles: int) -> FloatArray:
        """``(N, angles, 2)`` pixels around each outline."""
        t = np.arange(angles)[:, None] * (2 * np.pi / angles)
        return np.asarray(self.middle[:, None] + np.cos(t) * self.first[:, None] + np.sin(t) * self.second[:, None])


def sphere_outlines(camera: PinholeCamera, centres: FloatArray, radius: float) -> Outlines:
    """Outlines of spheres at ``centres`` ``(N, 3)``, metres; NaN where a sphere is not wholly before the camera."""
    local = camera.to_camera(centres)
    z = np.where(local[:, 2] > radius, local[:, 2], np.nan)
    flat = local[:, :2]
    rho2 = np.einsum("ij,ij->i", flat, flat)
    room = z * z - radius**2
    with np.errstate(divide="ignore", invalid="ignore"):
        outward = np.where(rho2[:, None] > 1e-18, flat / np.sqrt(rho2)[:, None], [1.0, 0.0])
    across = np.stack([-outward[:, 1], outward[:, 0]], axis=1)
    middle = flat * (z / room)[:, None]
    first = outward * (radius * np.sqrt(rho2 + room) / room)[:, None]
    second = across * (radius / np.sqrt(room))[:, None]
    if camera.distortion.any():
        middle, first, second = _bent(camera, middle, first, second)
    offset, scale = camera.principal_point, camera.focal
    local[:, 2] = z
    return Outlines(camera.project_local(local), middle * scale + offset, first * scale, second * scale)


def sphere_circles(camera: PinholeCamera, centres: FloatArray, radius: float) -> Outlines:
    """Circles of radius focal length x radius / depth about the images of ``centres`` ``(N, 3)``, metres.

    The one radius r0 of figure 1 of the sphere paper; right on the optical axis of a lens without distortion. NaN where
    a sphere is not before the camera.
    """
    pixels, depth = camera.project(centres)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.where(depth > 0, radius / depth, np.nan)[:, None] * camera.focal
    nothing = np.zeros(len(size))
    first, second = np.stack([size[:, 0], nothing], axis=1), np.stack([nothing, size[:, 1]], axis=1)
    return Outlines(pixels, pixels, first, second)


def _bent(
    camera: PinholeCamera, middle: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The ellipses nearest to ideal ellipses seen through the lens.

    A bent ellipse is a Fourier series in t. The terms of order 0 and 1 are an ellipse; across the outline, the term of
    order 2 acts like a shift (first harmonic) and a bulge of order 3, so the shift is added to the middle.
    """
    t = np.arange(POINTS_ON_BENT_ELLIPSE)[:, None] * (2 * np.pi / POINTS_ON_BENT_ELLIPSE)
    ideal = middle[:, None] + np.cos(t) * first[:, None] + np.sin(t) * second[:, None]
    distorted = distort(ideal.reshape(-1, 2), camera.distortion).reshape(ideal.shape)

    def harmonic(wave: FloatArray) -> FloatArray:
        return np.asarray(2 / POINTS_ON_BENT_ELLIPSE * (wave * distorted).sum(axis=1))

    first, second = harmonic(np.cos(t)), harmonic(np.sin(t))
    even, odd = harmonic(np.cos(2 * t)), harmonic(np.sin(2 * t))
    u, v = (axis / np.linalg.norm(axis, axis=1, keepdims=True) for axis in (first, second))
    along_u = 0.5 * ((even * u).sum(axis=1) + (odd * v).sum(axis=1))
    along_v = 0.5 * ((odd * u).sum(axis=1) - (even * v).sum(axis=1))
    return distorted.mean(axis=1) + along_u[:, None] * u + along_v[:, None] * v, first, second
