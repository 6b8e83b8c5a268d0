"""A camera and its clock from a target whose path in space is known: pixels at unknown times of a known trajectory.

Each candidate time of the first frame gives correspondences for a perspective-three-point RANSAC; the one that explains
most of them starts a robust least-squares fit of pose, clock and lens together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tsuiseki.tracking.cameras.calibration import Intrinsics
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.types import FloatArray

Trajectory = Callable[[FloatArray], FloatArray]
"""Points ``(N, 3)`` at times ``(N,)``."""

# Standard deviations of what calibration in a laboratory may have got wrong: focal lengths (relative), principal point
# (share of the image width), k1 and k2. Phones focus and stabilise, so these are wide.
LENS_DOUBT = np.array([0.05, 0.05, 0.02, 0.02, 0.1, 0.1])
CLOCK_DOUBT = 0.005


@dataclass(frozen=True)
class TimedCamera:
    """A camera and when it took its frames.

    Attributes:
        camera: the camera.
        offset: time of frame 0, seconds of the trajectory.
        period: seconds between frames.
        residuals: ``(N,)`` pixels, of the pixels that were fitted.
    """

    camera: PinholeCamera
    offset: float
    period: float
    residuals: FloatArray

    def times(self, frames: FloatArray) -> FloatArray:
        """Seconds at which ``frames`` were taken."""
        return self.offset + self.period * np.asarray(frames, dtype=np.float64)


def calibrate_by_path(
    trajectory: Trajectory,
    span: tuple[float, float],
    frames: FloatArray,
    pixels: FloatArray,
    intrinsics: Intrinsics,
    frame_rate: float,
    offsets: FloatArray,
    tolerance: float = 20.0,
    most: int = 2000,
) -> TimedCamera:
    """The camera and clock under which ``pixels`` best fit the trajectory; nothing outside ``span`` is used.

    Args:
        trajectory: the target's path.
        span: first and last time of it that may be used, seconds.
        frames: ``(N,)`` numbers of the frames in which the target was seen.
        pixels: ``(N, 2)`` where.
        intrinsics: of the lens, as calibrated elsewhere; refined within `LENS_DOUBT`.
        frame_rate: nominal, frames/s; refined within `CLOCK_DOUBT`.
        offsets: candidate times of frame 0, seconds.
        tolerance: error up to which a pixel counts as explained, for an image 1920 wide.
        most: pixels used in the fit, evenly chosen.

    Raises:
        RunError: no candidate explains a third of the pixels.
    """
    ideal = intrinsics.camera()
    scale = intrinsics.width / 1920
    normalised = ideal.normalised(pixels)
    explained, start, offset = 0.0, ideal, 0.0
    for candidate in offsets:
        share, camera = _explained(
            trajectory, span, frames / frame_rate + candidate, normalised, ideal, tolerance * scale
        )
        if share > explained:
            explained, start, offset = share, camera, float(candidate)
    if explained < 1 / 3:
        raise RunError(f"expected an offset that explains a third of the pixels, the best explains {explained:.0%}")
    times = frames / frame_rate + offset
    inside = np.flatnonzero((times > span[0] + 1) & (times < span[1] - 1))
    chosen = inside[np.linspace(0, len(inside) - 1, min(most, len(inside))).astype(int)]
    return _fit(trajectory, span, frames[chosen], pixels[chosen], start, frame_rate, offset, 3 * scale)


def _explained(
    trajectory: Trajectory,
    span: tuple[float, float],
    times: FloatArray,
    normalised: FloatArray,
    ideal: PinholeCamera,
    tolerance: float,
    sample: int = 150,
    rounds: int = 150,
) -> tuple[float, PinholeCamera]:
    usable = np.flatnonzero((times > span[0]) & (times < span[1]) & np.isfinite(normalised).all(axis=1))
    if len(usable) < 2 * sample:
        return 0.0, ideal
    chosen = usable[np.linspace(0, len(usable) - 1, sample).astype(int)]
    # OpenCV's own random numbers, so that the same input gives the same camera.
    cv2.setRNGSeed(0)
    found, turn, shift, inliers = cv2.solvePnPRansac(
        trajectory(times[chosen]),
        normalised[chosen],
        np.eye(3),
        np.zeros(5),
        iterationsCount=rounds,
        reprojectionError=tolerance / float(ideal.focal.mean()),
        flags=cv2.SOLVEPNP_P3P,
    )
    if not found or inliers is None:
        return 0.0, ideal
    rotation = Rotation.from_rotvec(turn[:, 0]).as_matrix()
    return len(inliers) / sample, replace(ideal, rotation=rotation, position=-rotation.T @ shift[:, 0])


def _fit(
    trajectory: Trajectory,
    span: tuple[float, float],
    frames: FloatArray,
    pixels: FloatArray,
    start: PinholeCamera,
    frame_rate: float,
    offset: float,
    noise: float,
) -> TimedCamera:
    width = start.width
    middle = float(frames.mean())

    def camera_of(x: FloatArray) -> PinholeCamera:
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        lens = start.distortion.copy()
        lens[:2] += x[12:14]
        return replace(
            start,
            rotation=turn @ start.rotation,
            position=start.position + x[3:6],
            focal=start.focal * np.exp(x[8:10]),
            principal_point=start.principal_point + width * x[10:12],
            distortion=lens,
        )

    def clock_of(x: FloatArray) -> tuple[float, float]:
        period = float(np.exp(x[7])) / frame_rate
        # The time of the middle frame is what the data fix; written so, rate and offset do not mix.
        return offset + middle / frame_rate + float(x[6]) - period * middle, period

    def errors(x: FloatArray) -> FloatArray:
        first, period = clock_of(x)
        times = np.clip(first + period * frames, *span)
        return np.asarray(np.nan_to_num(camera_of(x).project(trajectory(times))[0] - pixels, nan=1e3))

    def cost(x: FloatArray) -> FloatArray:
        # Soft L1 by hand, for the doubts about lens and clock are Gaussian.
        away = errors(x).ravel() / noise
        robust = np.sign(away) * np.sqrt(2 * (np.sqrt(1 + away**2) - 1))
        return np.concatenate([robust, x[8:14] / LENS_DOUBT, x[7:8] / CLOCK_DOUBT])

    fit = least_squares(cost, np.zeros(14), x_scale=[0.01] * 3 + [0.3] * 3 + [0.1, 1e-3] + [0.01] * 6, max_nfev=60)
    first, period = clock_of(fit.x)
    return TimedCamera(camera_of(fit.x), first, period, np.sqrt(np.square(errors(fit.x)).sum(axis=1)))
