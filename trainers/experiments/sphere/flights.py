"""A flying drone seen by six unsynchronised cameras: the 3D filter with point measurements, against RTK.

Cameras and clocks are calibrated from the first half of the trajectory only; the second half is tracked and scored. The
filter and plain triangulation get the same pixels, interpolated to common times. The noise of the filter and the lag of
its smoother are chosen on the first half too, for each number of cameras: better than triangulation in both respects
(`FlightScores.better`), and of those the least median distance to RTK.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from tsuiseki.datamodules.readers.multiview_drone import DroneFlight, DroneView
from tsuiseki.tracking.cameras.moving_target import TimedCamera, calibrate_by_path
from tsuiseki.tracking.cameras.triangulation import triangulate
from tsuiseki.tracking.evaluation.space import acceleration
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.experiment import Watch
from tsuiseki.trainers.experiments.sphere.multiview_filter import Course, FlightSettings, track_points

CAMERA_COUNTS = (2, 3, 4, 6)
STEP = 0.04
# Pixels are interpolated over at most so many missing frames.
LARGEST_GAP = 3.5
OFFSETS = np.arange(-120.0, 120.0, 0.5)
MARGIN = 1.0
# What is tried on the first half.
AGITATIONS = (1.0, 2.0, 4.0)
INFLATIONS = (1.0, 2.0)
LAGS = (0.0, 0.12, 0.24, 0.48, 0.96)


@dataclass(frozen=True)
class FlightScores:
    """Errors in metres against RTK over the moments that two cameras saw, and apart those that one saw.

    Attributes:
        cameras: how many were used.
        moments: compared.
        filter_median, triangulation_median: of the distance to RTK.
        filter_tail, triangulation_tail: 95th percentiles.
        filter_acceleration, triangulation_acceleration: root mean square, m/s^2.
        alone: moments that one camera saw, at most `FlightSettings.longest_alone` after two did.
        alone_median, alone_tail: of the filter's distance there; NaN where there is none.
    """

    cameras: int
    moments: int
    filter_median: float
    triangulation_median: float
    filter_tail: float
    triangulation_tail: float
    filter_acceleration: float
    triangulation_acceleration: float
    alone: int
    alone_median: float
    alone_tail: float

    @property
    def better(self) -> bool:
        """Whether the filter's median is no larger than triangulation's and its acceleration at most half."""
        return (
            self.filter_median <= self.triangulation_median
            and self.filter_acceleration <= 0.5 * self.triangulation_acceleration
        )


@dataclass(frozen=True)
class Trial:
    """One way to set the filter, on the first half.

    Attributes:
        settings: tried.
        scores: there.
        log_evidence: of the pixels; the same for all lags.
    """

    settings: FlightSettings
    scores: FlightScores
    log_evidence: float


def calibrate_flight(flight: DroneFlight, watch: Watch) -> list[TimedCamera]:
    """All cameras and their clocks, from the first half of the trajectory."""
    half = len(flight.times) // 2
    trajectory = CubicSpline(flight.times[: half + 1], flight.points[: half + 1])
    span = (0.0, float(flight.times[half]))
    return [
        calibrate_by_path(trajectory, span, v.frames, v.pixels, v.intrinsics, v.frame_rate, OFFSETS)
        for v in watch.over(flight.views, "calibrating", len(flight.views))
    ]


def half_of(
    flight: DroneFlight, cameras: Sequence[TimedCamera], first: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the first C cameras saw in one half of the flight.

    Returns:
        Common times ``(T,)``, pixels ``(T, C, 2)`` with NaN where a camera saw nothing, true positions ``(T, 3)``.
    """
    middle, end = float(flight.times[len(flight.times) // 2]), float(flight.times[-1])
    begin, end = (0.0, middle) if first else (middle, end)
    times = np.arange(begin + MARGIN, end - MARGIN, STEP)
    pixels = np.stack([_at(times, v, c) for v, c in zip(flight.views[: len(cameras)], cameras, strict=True)], axis=1)
    return times, pixels, np.asarray(CubicSpline(flight.times, flight.points)(times))


def try_noise(
    flight: DroneFlight, cameras: Sequence[TimedCamera], seed: int, agitation: float, inflation: float
) -> list[Trial]:
    """Every lag with one kind of noise on the whole first half of the flight.

    The evidence of each noise is kept beside it. It is not what decides: errors of calibration and clocks last for many
    frames, and the filter's likelihood takes them for independent.
    """
    times, pixels, truth = half_of(flight, cameras, first=True)
    triangulated, _ = triangulate([c.camera for c in cameras], pixels)
    settings = FlightSettings(agitation=agitation, inflation=inflation)
    rng = np.random.default_rng((seed, len(cameras), 6))
    course = track_points(cameras, times, pixels, triangulated, settings, rng)
    scores = [score_course(len(cameras), course, lag, triangulated, truth) for lag in LAGS]
    return [Trial(replace(settings, lag=lag), of, course.log_evidence) for lag, of in zip(LAGS, scores, strict=True)]


def chosen(trials: Sequence[Trial]) -> Trial:
    """Of those better than triangulation in both respects, or of all if there is none, that of the least median."""
    return min(trials, key=lambda t: (not t.scores.better, t.scores.filter_median))


def score_course(cameras: int, course: Course, lag: float, triangulated: FloatArray, truth: FloatArray) -> FlightScores:
    """Smoothed filter and plain triangulation ``(T, 3)`` against the truth ``(T, 3)``."""
    estimates = course.smoothed(lag)
    both = np.isfinite(triangulated[:, 0]) & np.isfinite(estimates[:, 0])
    away, plain = (np.sqrt(np.square(p - truth).sum(axis=1)) for p in (estimates, triangulated))
    single = away[course.alone & np.isfinite(away)]
    shown = [np.where(both[:, None], p, np.nan) for p in (estimates, triangulated)]
    return FlightScores(
        cameras,
        int(both.sum()),
        float(np.median(away[both])),
        float(np.median(plain[both])),
        float(np.percentile(away[both], 95)),
        float(np.percentile(plain[both], 95)),
        acceleration(course.times, shown[0], STEP),
        acceleration(course.times, shown[1], STEP),
        len(single),
        float(np.median(single)) if len(single) else float("nan"),
        float(np.percentile(single, 95)) if len(single) else float("nan"),
    )


def surveyed_errors(cameras: Sequence[TimedCamera], surveyed: FloatArray) -> FloatArray:
    """``(C,)`` distances of the cameras to ``surveyed`` ``(C, 3)``, metres, after the best rigid motion: a check only.

    The survey lives in a frame of its own, so the cameras' frame is first laid upon it (Kabsch).
    """
    places = np.stack([c.camera.position for c in cameras])
    a, b = places - places.mean(axis=0), surveyed - surveyed.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    return np.asarray(np.sqrt(np.square(a @ turn - b).sum(axis=1)))


def _at(times: FloatArray, view: DroneView, camera: TimedCamera) -> FloatArray:
    """Pixels ``(T, 2)`` at ``times``, interpolated between neighbouring frames."""
    stamps = camera.times(view.frames)
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    share = (times - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    inside = (share >= 0) & (share <= 1) & (view.frames[after] - view.frames[after - 1] <= LARGEST_GAP)
    pixels = view.pixels[after - 1] + share[:, None] * (view.pixels[after] - view.pixels[after - 1])
    return np.where(inside[:, None], pixels, np.nan)
