"""Points in space from their pixels in several calibrated cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import BoolArray, FloatArray

# Rays that meet at less than this angle (radians) leave the distance open.
SMALLEST_ANGLE = 2e-3
# Gauss-Newton steps.
STEPS = 4


def triangulate(
    cameras: Sequence[PinholeCamera], pixels: FloatArray, sigma: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """The points whose projections lie nearest to ``pixels``, and how well they are known.

    The point nearest to all rays is the start; Gauss-Newton steps then make the reprojection error least.

    Args:
        cameras: C cameras.
        pixels: ``(N, C, 2)``; NaN where a camera did not see the point.
        sigma: standard deviation of the pixels along x and y.

    Returns:
        ``(N, 3)`` points, metres, and ``(N, 3, 3)`` covariances; NaN where fewer than two cameras saw the point, their
        rays are as good as parallel, or the point would lie behind a camera that saw it.

    Raises:
        ValueError: the shapes do not fit.
    """
    pixels = np.asarray(pixels, dtype=np.float64)
    if pixels.ndim != 3 or pixels.shape[1:] != (len(cameras), 2):
        raise ValueError(f"expected pixels of shape (N, {len(cameras)}, 2), got {pixels.shape}")
    rays = np.stack([c.rays(pixels[:, k]) for k, c in enumerate(cameras)], axis=1)
    visible = np.isfinite(rays).all(axis=2)
    points, enough = _nearest_to_rays(np.stack([c.position for c in cameras]), rays, visible)
    information = np.zeros((len(points), 3, 3))
    for _ in range(STEPS):
        step, information, depth = _normal_equations(cameras, pixels, visible, points)
        enough &= ((depth > 0) | ~visible).all(axis=1) & np.isfinite(step).all(axis=1)
        points = np.where(enough[:, None], points + step, points)
    _, information, depth = _normal_equations(cameras, pixels, visible, points)
    enough &= ((depth > 0) | ~visible).all(axis=1)
    covariance = np.full((len(points), 3, 3), np.nan)
    covariance[enough] = np.linalg.pinv(information[enough], hermitian=True) * sigma**2
    points[~enough] = np.nan
    return points, covariance


def _nearest_to_rays(origins: FloatArray, rays: FloatArray, visible: BoolArray) -> tuple[FloatArray, BoolArray]:
    """``(N, 3)`` points of least summed squared distance to their rays, and where the rays fix one."""
    directions = np.where(visible[..., None], rays, 0.0)
    across = visible[..., None, None] * np.eye(3) - directions[..., :, None] * directions[..., None, :]
    a = across.sum(axis=1)
    b = np.einsum("ncij,cj->ni", across, origins)
    # Two rays at angle t leave 1 - cos t as the smallest eigenvalue.
    enough = (visible.sum(axis=1) >= 2) & (np.linalg.eigvalsh(a)[:, 0] > 1 - np.cos(SMALLEST_ANGLE))
    points = np.zeros((len(a), 3))
    points[enough] = np.linalg.solve(a[enough], b[enough][:, :, None])[:, :, 0]
    return points, enough


def _normal_equations(
    cameras: Sequence[PinholeCamera],
    pixels: FloatArray,
    visible: BoolArray,
    points: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss-Newton steps ``(N, 3)``, information ``(N, 3, 3)`` for unit sigma, depths ``(N, C)``."""
    information, gradient = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    depths = []
    for k, camera in enumerate(cameras):
        projected, depth = camera.project(points)
        slopes = projection_slopes(camera, points)
        use = visible[:, k] & np.isfinite(projected).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
        slopes = np.where(use[:, None, None], slopes, 0.0)
        error = np.where(use[:, None], pixels[:, k] - projected, 0.0)
        information += np.einsum("nki,nkj->nij", slopes, slopes)
        gradient += np.einsum("nki,nk->ni", slopes, error)
        depths.append(depth)
    step = np.einsum("nij,nj->ni", np.linalg.pinv(information, hermitian=True), gradient)
    return step, information, np.stack(depths, axis=1)


def projection_slopes(camera: PinholeCamera, points: FloatArray) -> FloatArray:
    """``(N, 2, 3)`` derivatives of pixels by world coordinates, by central differences of 1e-4 times the depth."""
    depth = np.abs(camera.to_camera(points)[:, 2])
    reach = (1e-4 * np.maximum(depth, 1e-3))[:, None]
    columns = []
    for axis in np.eye(3):
        ahead, _ = camera.project(points + reach * axis)
        behind, _ = camera.project(points - reach * axis)
        columns.append((ahead - behind) / (2 * reach))
    return np.stack(columns, axis=2)
