"""A flying drone seen by six unsynchronised cameras: the 3D filter with point measurements, against RTK.

Cameras and clocks are calibrated from the first half of the trajectory only; the second half is tracked and scored. The
filter and plain triangulation get the same pixels, interpolated to common times. The filter's parameters were chosen on
the first half.
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
from tsuiseki.tracking.filters.smoothing import Lineage
from tsuiseki.tracking.filters.views import Covering
from tsuiseki.tracking.filters.weights import probabilities
from tsuiseki.tracking.likelihoods.views import PointLikelihood
from tsuiseki.tracking.trackers.sphere import Glance, SphereState, SphereTracker
from tsuiseki.tracking.types import BoolArray, FloatArray

CAMERA_COUNTS = (2, 3, 4, 6)
STEP = 0.04
# Pixels are interpolated over at most so many missing frames.
LARGEST_GAP = 3.5
OFFSETS = np.arange(-120.0, 120.0, 0.5)
MARGIN = 1.0


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

    particles: int = 3000
    agitation: float = 12.0
    inflation: float = 3.0
    lag: float = 0.12
    longest_alone: float = 1.0


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


def second_half(flight: DroneFlight, cameras: Sequence[TimedCamera]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Common times ``(T,)``, pixels ``(T, C, 2)`` with NaN where a camera saw nothing, true positions ``(T, 3)``."""
    half = len(flight.times) // 2
    times = np.arange(flight.times[half] + MARGIN, flight.times[-1] - MARGIN, STEP)
    pixels = np.stack([_at(times, v, c) for v, c in zip(flight.views, cameras, strict=True)], axis=1)
    return times, pixels, np.asarray(CubicSpline(flight.times, flight.points)(times))


def track_points(
    cameras: Sequence[TimedCamera],
    times: FloatArray,
    pixels: FloatArray,
    start: FloatArray,
    settings: DroneSettings,
    rng: np.random.Generator,
) -> tuple[FloatArray, BoolArray]:
    """The filter over all moments.

    Args:
        cameras: C cameras.
        times: ``(T,)`` seconds.
        pixels: ``(T, C, 2)``, NaN where a camera saw nothing.
        start: ``(T, 3)`` triangulated positions, NaN where there is none: where the filter begins, and begins again
            after it has not known the position.
        settings: of the filter.
        rng: random numbers.

    Returns:
        ``(T, 3)`` positions, NaN where there is none, and ``(T,)`` whether one camera alone carried them.
    """
    sigma = np.array([max(float(np.median(c.residuals)) / 1.1774, 0.5) for c in cameras]) * settings.inflation
    likelihood = PointLikelihood([c.camera for c in cameras], sigma)
    tracker = SphereTracker(likelihood, ConstantVelocity(settings.agitation), Covering(0.05, 5.0, 0.01), 1.0)
    estimates, alone = np.full((len(times), 3), np.nan), np.zeros(len(times), dtype=np.bool_)
    seen = np.isfinite(pixels[:, :, 0])
    state: SphereState | None = None
    lineage, numbers = Lineage(), list[int]()
    last_pair = -np.inf
    for k, time in enumerate(times):
        known = bool(np.isfinite(start[k]).all())
        # Two cameras after a gap fix the position better than what one camera or none has left of it.
        if known and (state is None or (state.unseen > 0.1 and time - last_pair > 1.5 * STEP)):
            state = tracker.start_at(start[k], 0.2, settings.particles, len(cameras), rng, time, speed=4.0)
            lineage, numbers = Lineage(), []
        if known:
            last_pair = time
        if state is None or time - last_pair > settings.longest_alone:
            state = None
            continue
        views = [pixel if one else None for pixel, one in zip(pixels[k], seen[k], strict=True)]
        state, info = tracker.step(state, Glance(float(time), views), rng)
        lineage = lineage.extended(info.ancestors, state.particles.particles[:, :3], float(time), settings.lag)
        numbers = [*numbers, k][-len(lineage.times) :]
        alone[k] = not known and seen[k].sum() == 1
        weights = probabilities(state.particles.log_weights)
        if time - lineage.times[0] >= settings.lag - 1e-6:
            estimates[numbers[0]] = weights @ lineage.states[0]
    return estimates, alone


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
    estimates, alone = track_points(
        cameras, times, pixels, triangulated, settings, np.random.default_rng((seed, len(cameras)))
    )
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
