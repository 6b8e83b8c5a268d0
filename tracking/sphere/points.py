"""A ball in space by its measured pixels in two or more calibrated cameras: `track_sphere_points`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.bounds import as_settings
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.filters.resampling import Covering
from tsuiseki.tracking.formats.world_tables import read_ball_points
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.sphere.page import sphere_result
from tsuiseki.tracking.sphere.settings import FrameTimes, SphereSettings, as_place, cameras_of, chosen_motion
from tsuiseki.tracking.sphere.tracker import MomentViews, SphereRun, SphereTracker
from tsuiseki.tracking.sphere.views import PointLikelihood, Views
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import BoolArray, FloatArray, Position
from tsuiseki.tracking.video.synchronise import Moment

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


# A detector seldom misses for long, so a view opens again soon.
COVERING = Covering(covers=0.05, opens=5.0, floor=0.01)
# Of weighing in a step, at most.
STAGES = 4
# Seconds without a known place until the ball is searched again, as where all views disagree.
PATIENCE = 0.2
# Standard deviation of the velocity of a ball that was just found, along each axis, m/s.
SPEED = 5.0


def track_sphere_points(
    files: Sequence[str | Path],
    cameras: str | Path,
    *,
    start: ArrayLike | None = None,
    settings: SphereSettings | None = None,
    deviation: float = 2.0,
    radius: float = 0.0,
    seed: int = 0,
) -> Result[Position]:
    """Where a ball is in space, from its pixels in every camera.

    Args:
        files: a CSV for each camera (`tracking.formats.world_tables`), in the order of the cameras.
        cameras: ``cameras.yaml`` with one entry per file, each with its frame_rate.
        start: ``(3,)`` the ball at first, metres; by default where two cameras that see it say.
        settings: see `SphereSettings`; no preset and no likelihood, for there is no image.
        deviation: standard deviation of a measured pixel along x and y.
        radius: of the ball, metres, for its bounces.
        seed: of all random numbers.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: no two cameras show the ball at about one time.
    """
    chosen, times = sphere_points_run(files, cameras, start, settings, deviation, radius), StageTimes()
    log = chosen.run(np.random.default_rng(seed), times)
    return sphere_result(chosen, log, times, {"points": [str(file) for file in files], "seed": seed})


def sphere_points_run(
    files: Sequence[str | Path],
    cameras: str | Path,
    start: ArrayLike | None = None,
    settings: SphereSettings | None = None,
    deviation: float = 2.0,
    radius: float = 0.0,
    times: FrameTimes | None = None,
) -> SphereRun:
    """A run of `track_sphere_points`, which says what it raises; ``times`` are by default as the camera file says."""
    settings = as_settings(settings, SphereSettings)
    for name, expected in (("preset", "extended"), ("likelihood", "contour"), ("faint", None)):
        if getattr(settings, name) != expected:
            raise RequestError(
                f"`{name}`: expected none with `points`, which have no image to weigh; got {getattr(settings, name)}"
            )
    placed = cameras_of(cameras, len(files), "files", "`points`: ")
    if not 0 < deviation < np.inf or not 0 <= radius < 10:
        raise RequestError(f"expected a `deviation` above 0 and a `radius` from 0, got {deviation:g} and {radius:g}")
    pixels = [read_ball_points(a_path(file, "files")) for file in files]
    stamps = (times or FrameTimes()).of_pixels(pixels, placed)
    pinholes = [p.camera for p in placed]
    likelihood = PointLikelihood(pinholes, np.full(len(placed), float(deviation)))
    tracker = SphereTracker(likelihood, chosen_motion(settings, radius), COVERING, patience=PATIENCE, stages=STAGES)

    def search(views: Views, rng: np.random.Generator) -> FloatArray:
        return _placed_by_rays(pinholes, views, deviation, settings.particles, rng)

    def matched(moments: Sequence[Moment]) -> Iterator[MomentViews]:
        for moment in moments:
            measured = [None if f is None else p[f] for f, p in zip(moment.frames, pixels, strict=True)]
            yield moment, [None if pixel is None or np.isnan(pixel[0]) else pixel for pixel in measured]

    place = None if start is None else as_place(start)
    return SphereRun(settings, placed, stamps, tracker, place, search, matched, radius, speed=SPEED)


def _placed_by_rays(
    cameras: Sequence[PinholeCamera], views: Views, deviation: float, count: int, rng: np.random.Generator
) -> FloatArray:
    """``(count, 3)`` positions about where the rays of the pixels meet; far off where they do not."""
    pixels = np.array([[np.nan, np.nan] if view is None else view for view in views])
    points, covariances = triangulate(cameras, pixels[None], deviation)
    if np.isnan(points[0, 0]):
        middle = np.mean([camera.position + 3 * camera.rotation[2] for camera in cameras], axis=0)
        return np.asarray(middle + rng.standard_normal((count, 3)))
    # The frames of a search lie up to some hundredths of a second apart.
    spread = np.linalg.cholesky(covariances[0] + 0.05**2 * np.eye(3))
    return np.asarray(points[0] + rng.standard_normal((count, 3)) @ spread.T)
