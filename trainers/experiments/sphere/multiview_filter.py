"""The 3D filter on measured pixels of several cameras, and the smoother behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.cameras.moving_target import TimedCamera
from tsuiseki.tracking.filters.kalman import smooth
from tsuiseki.tracking.filters.motion.space import Manoeuvring
from tsuiseki.tracking.filters.particles.resampling import weighted_covariance, weighted_mean
from tsuiseki.tracking.filters.particles.stages import Covering
from tsuiseki.tracking.sphere.tracker import OPEN, TRUST, SphereState, SphereTracker, TimedViews
from tsuiseki.tracking.sphere.views import PointLikelihood
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# A detector seldom misses for long, so a view opens again soon.
COVERING = Covering(covers=0.05, opens=5.0, floor=0.01)
STAGES = 4
# Spread of a start, metres and m/s, and share of the particles that start anew where the filter and all views disagree.
SPREAD, SPEED, ANEW = 0.3, 4.0, 0.2


@dataclass(frozen=True)
class FlightSettings:
    """Of the filter.

    Attributes:
        particles: how many.
        agitation: change of velocity in one second between manoeuvres, m/s.
        manoeuvres: in one second.
        kick: change of velocity by a manoeuvre, m/s.
        inflation: the pixels' standard deviation over that of the fit: their errors last for many frames.
        lag: seconds by which an estimate waits for more pixels.
        longest_alone: seconds for which one camera alone is believed.
    """

    particles: int = 1000
    agitation: float = 2.0
    manoeuvres: float = 1.0
    kick: float = 3.0
    inflation: float = 2.0
    lag: float = 0.24
    longest_alone: float = 1.0


@dataclass(frozen=True)
class Course:
    """What the filter found at T times.

    Attributes:
        times: ``(T,)`` seconds.
        means: ``(T, 6)`` positions and velocities.
        covariances: ``(T, 6, 6)``.
        stretch: ``(T,)`` number of the unbroken stretch that each time belongs to; -1 where nothing is known.
        alone: ``(T,)`` whether one camera alone was there.
        log_evidence: of all pixels.
        motion: of the filter.
    """

    times: FloatArray
    means: FloatArray
    covariances: FloatArray
    stretch: IntArray
    alone: BoolArray
    log_evidence: float
    motion: Manoeuvring

    def smoothed(self, lag: float) -> FloatArray:
        """``(T, 3)`` positions given the pixels up to ``lag`` seconds later; NaN where nothing is known."""
        points = np.full((len(self.times), 3), np.nan)
        for number in range(int(self.stretch.max()) + 1):
            part = self.stretch == number
            means, _ = smooth(self.times[part], self.means[part], self.covariances[part], self.motion, lag)
            points[part] = means[:, :3]
        return points


def track_points(
    cameras: Sequence[TimedCamera],
    times: FloatArray,
    pixels: FloatArray,
    start: FloatArray,
    settings: FlightSettings,
    rng: np.random.Generator,
) -> Course:
    """The filter over all moments.

    Args:
        cameras: C cameras.
        times: ``(T,)`` seconds.
        pixels: ``(T, C, 2)``, NaN where a camera saw nothing.
        start: ``(T, 3)`` triangulated positions, NaN where there is none: where the filter begins, begins again after
            less than two cameras saw the target for too long, and looks besides when no view agrees with it.
        settings: of the filter.
        rng: random numbers.
    """
    likelihood = PointLikelihood([c.camera for c in cameras], pixel_noise(cameras) * settings.inflation)
    motion = Manoeuvring(settings.agitation, settings.manoeuvres, settings.kick)
    tracker = SphereTracker(likelihood, motion, COVERING, stages=STAGES)
    seen, known = np.isfinite(pixels[:, :, 0]), np.isfinite(start[:, 0])
    means, covariances = np.full((len(times), 6), np.nan), np.full((len(times), 6, 6), np.nan)
    stretch = np.full(len(times), -1)
    state: SphereState | None = None
    number, evidence, last_pair = -1, 0.0, -np.inf
    for k, time in enumerate(times):
        last_pair, before = (float(time) if known[k] else last_pair), last_pair
        if time - before > settings.longest_alone:
            state = None
        if time - last_pair > settings.longest_alone:
            continue
        if state is None:
            state = tracker.start_at(start[k], SPREAD, settings.particles, len(cameras), rng, float(time), SPEED)
            number += 1
        elif known[k] and (state.open[seen[k]] < OPEN).all():
            state = also_at(state, start[k], rng)
        views = [pixel if one else None for pixel, one in zip(pixels[k], seen[k], strict=True)]
        state, info = tracker.step(state, TimedViews(float(time), views), rng)
        means[k] = weighted_mean(state.particles.particles, state.particles.log_weights)
        covariances[k] = weighted_covariance(state.particles.particles, state.particles.log_weights)
        stretch[k] = number
        evidence += info.log_evidence
    alone = ~known & (seen.sum(axis=1) == 1) & (stretch >= 0)
    return Course(times, means, covariances, stretch, alone, evidence, motion)


def also_at(state: SphereState, point: FloatArray, rng: np.random.Generator) -> SphereState:
    """Some particles moved to ``point`` ``(3,)``, the views trusted anew: the next weighing tells who is right.

    Several cameras that disagree with the filter at once are seldom all wrong.
    """
    states = state.particles.particles.copy()
    chosen = rng.choice(len(states), round(ANEW * len(states)), replace=False)
    states[chosen, :3] = point + SPREAD * rng.standard_normal((len(chosen), 3))
    states[chosen, 3:] += SPEED * rng.standard_normal((len(chosen), 3))
    particles = replace(state.particles, particles=states)
    return replace(state, particles=particles, open=np.full_like(state.open, TRUST))


def pixel_noise(cameras: Sequence[TimedCamera]) -> FloatArray:
    """``(C,)`` standard deviation along x and y of the fitted pixels, from their median distance."""
    # The median of a Rayleigh distribution is 1.1774 standard deviations.
    return np.array([max(float(np.median(c.residuals)) / 1.1774, 0.5) for c in cameras])
