"""A flying drone seen by six unsynchronised cameras: the 3D filter with point measurements, against RTK.

Cameras and clocks are calibrated from the first half of the trajectory only; the second half is tracked and scored. The
filter and plain triangulation get the same pixels, interpolated to common times. The filter's noise is selected on the
first half too, by the evidence of its pixels, and the lag of the smoother by the distance to RTK there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tsuiseki.datamodules.readers.multiview_drone import DroneFlight, DroneView
from tsuiseki.tracking.cameras.moving_target import TimedCamera, calibrate_by_path
from tsuiseki.tracking.cameras.triangulation import triangulate
from tsuiseki.tracking.evaluation.space import acceleration
from tsuiseki.tracking.filters.motion_3d import ConstantVelocity
from tsuiseki.tracking.filters.smoothing import smooth
from tsuiseki.tracking.filters.views import Covering
from tsuiseki.tracking.filters.weights import weighted_covariance, weighted_mean
from tsuiseki.tracking.likelihoods.views import PointLikelihood
from tsuiseki.tracking.trackers.sphere import Glance, SphereState, SphereTracker
from tsuiseki.tracking.types import BoolArray, FloatArray

CAMERA_COUNTS = (2, 3, 4, 6)
STEP = 0.04
# Pixels are interpolated over at most so many missing frames.
LARGEST_GAP = 3.5
OFFSETS = np.arange(-120.0, 120.0, 0.5)
MARGIN = 1.0
STAGES = 4


@dataclass(frozen=True)
class DroneSettings:
    """Of the filter.

    Attributes:
        particles: how many.
        agitation: change of velocity in one second, m/s.
        inflation: the pixels' standard deviation over that of the fit: their errors last for many frames.
        lag: seconds by which an estimate waits for more pixels.
        longest_alone: seconds for which one camera alone is believed.
    """

    particles: int = 1000
    agitation: float = 8.0
    inflation: float = 2.0
    lag: float = 0.48
    longest_alone: float = 1.0


@dataclass(frozen=True)
class Course:
    """What the filter found.

    Attributes:
        points: ``(T, 3)`` smoothed positions, metres; NaN where there is none.
        alone: ``(T,)`` whether one camera alone carried them.
        log_evidence: of all pixels.
    """

    points: FloatArray
    alone: BoolArray
    log_evidence: float


@dataclass(frozen=True)
class DroneScores:
    """Errors in metres against RTK over the moments that two cameras saw, and apart those that one saw.

    Attributes:
        cameras: how many were used.
        moments: compared.
        filter_median, triangulation_median: of the distance to RTK.
        filter_tail, triangulation_tail: 95th percentiles.
        filter_acceleration, triangulation_acceleration: root mean square, m/s^2.
        alone: moments that one camera saw, at most `DroneSettings.longest_alone` after two did.
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


def calibrate_flight(
    flight: DroneFlight, watch: Callable[[Iterable[DroneView]], Iterable[DroneView]] = iter
) -> list[TimedCamera]:
    """All cameras and their clocks, from the first half of the trajectory."""
    half = len(flight.times) // 2
    trajectory = CubicSpline(flight.times[: half + 1], flight.points[: half + 1])
    span = (0.0, float(flight.times[half]))
    return [
        calibrate_by_path(trajectory, span, v.frames, v.pixels, v.intrinsics, v.frame_rate, OFFSETS)
        for v in watch(flight.views)
    ]


def half_of(
    flight: DroneFlight, cameras: Sequence[TimedCamera], first: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Common times ``(T,)``, pixels ``(T, C, 2)`` with NaN where a camera saw nothing, true positions ``(T, 3)``."""
    middle, end = float(flight.times[len(flight.times) // 2]), float(flight.times[-1])
    begin, end = (0.0, middle) if first else (middle, end)
    times = np.arange(begin + MARGIN, end - MARGIN, STEP)
    pixels = np.stack([_at(times, v, c) for v, c in zip(flight.views, cameras, strict=True)], axis=1)
    return times, pixels, np.asarray(CubicSpline(flight.times, flight.points)(times))


def track_points(
    cameras: Sequence[TimedCamera],
    times: FloatArray,
    pixels: FloatArray,
    start: FloatArray,
    settings: DroneSettings,
    rng: np.random.Generator,
) -> Course:
    """The filter over all moments, then the smoother.

    Args:
        cameras: C cameras.
        times: ``(T,)`` seconds.
        pixels: ``(T, C, 2)``, NaN where a camera saw nothing.
        start: ``(T, 3)`` triangulated positions, NaN where there is none: where the filter begins, and begins again
            after nothing or one camera alone was seen for too long.
        settings: of the filter.
        rng: random numbers.
    """
    motion = ConstantVelocity(settings.agitation)
    likelihood = PointLikelihood([c.camera for c in cameras], pixel_noise(cameras) * settings.inflation)
    tracker = SphereTracker(likelihood, motion, Covering(0.05, 5.0, 0.01), largest_deviation=1.0, stages=STAGES)
    points, alone = np.full((len(times), 3), np.nan), np.zeros(len(times), dtype=np.bool_)
    seen, known = np.isfinite(pixels[:, :, 0]), np.isfinite(start[:, 0])
    stretch = list[int]()
    means, covariances = np.empty((len(times), 6)), np.empty((len(times), 6, 6))

    def finish() -> None:
        if stretch:
            points[stretch] = smooth(times[stretch], means[stretch], covariances[stretch], motion.linear, settings.lag)[
                0
            ][:, :3]
            stretch.clear()

    state: SphereState | None = None
    evidence, last_pair = 0.0, -np.inf
    for k, time in enumerate(times):
        if known[k]:
            last_pair = time
        if time - last_pair > settings.longest_alone:
            finish()
            state = None
            continue
        if state is None:
            state = tracker.start_at(start[k], 0.3, settings.particles, len(cameras), rng, time, speed=4.0)
        views = [pixel if one else None for pixel, one in zip(pixels[k], seen[k], strict=True)]
        state, info = tracker.step(state, Glance(float(time), views), rng)
        cloud = state.particles
        means[k] = weighted_mean(cloud.particles, cloud.log_weights)
        covariances[k] = weighted_covariance(cloud.particles, cloud.log_weights)
        evidence += info.log_evidence
        alone[k] = not known[k] and seen[k].sum() == 1
        stretch.append(k)
    finish()
    return Course(points, alone, evidence)


def pixel_noise(cameras: Sequence[TimedCamera]) -> FloatArray:
    """``(C,)`` standard deviation along x and y of the fitted pixels, from their median distance."""
    # The median of a Rayleigh distribution is 1.1774 standard deviations.
    return np.array([max(float(np.median(c.residuals)) / 1.1774, 0.5) for c in cameras])


def score_flight(
    cameras: Sequence[TimedCamera],
    times: FloatArray,
    pixels: FloatArray,
    truth: FloatArray,
    settings: DroneSettings,
    seed: int,
) -> DroneScores:
    """Filter and triangulation with ``cameras`` against the truth."""
    triangulated, _ = triangulate([c.camera for c in cameras], pixels)
    course = track_points(cameras, times, pixels, triangulated, settings, np.random.default_rng((seed, len(cameras))))
    estimates, alone = course.points, course.alone
    both = np.isfinite(triangulated[:, 0]) & np.isfinite(estimates[:, 0])
    away, plain = (np.sqrt(np.square(p - truth).sum(axis=1)) for p in (estimates, triangulated))
    single = away[alone & np.isfinite(away)]
    shown = [np.where(both[:, None], p, np.nan) for p in (estimates, triangulated)]
    return DroneScores(
        len(cameras),
        int(both.sum()),
        float(np.median(away[both])),
        float(np.median(plain[both])),
        float(np.percentile(away[both], 95)),
        float(np.percentile(plain[both], 95)),
        acceleration(times, shown[0], STEP),
        acceleration(times, shown[1], STEP),
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
