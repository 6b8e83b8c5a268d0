"""A ball in space from calibrated cameras, by the particle filter of the sphere paper.

A particle is a position and a velocity. A step predicts (section 2.1), weighs every particle by its outline in each
camera (2.2.2) or by the background difference (2.2.1), and resamples (section 2.3); the estimate is the weighted mean.
Cameras are multiplied, as the paper says for 2.2.1. Beyond the paper: a covered camera is recognised and left out
and particles are weighed in two stages (both are in `tracking.filters.resampling`). Without these two
(``covering=None, stages=1``), with `RandomWalk3D` and `views.PrintedContourLikelihood`, it is the paper's filter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.camera_files import PlacedCamera
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.filters.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.point_motion import ConstantVelocity3D
from tsuiseki.tracking.filters.resampling import (
    Covering,
    bearable_share,
    drawn_and_spread,
    open_after,
    probabilities,
    weigh_views,
    weighted_covariance,
    weighted_mean,
)
from tsuiseki.tracking.runs.steps import reported_to
from tsuiseki.tracking.sphere.settings import SphereSettings
from tsuiseki.tracking.sphere.views import ViewLikelihood, Views
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import FloatArray, Position, Status
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.video.synchronise import Moment, align, default_tolerance

# Probability from which a view counts as open.
OPEN = 0.5
# Probability that a view is open at first.
TRUST = 0.9
# Effective sample size after a stage of weighing, over the number of particles.
STAGE_SHARE = 0.1
# Relative width of the kernel that particles are spread by after a stage.
STAGE_WIDTH = 0.6
# Standard deviation of the velocity of a ball that was just found, along each axis, m/s.
START_SPEED = 0.3


@dataclass(frozen=True)
class TimedViews:
    """The observation of one step: seconds, not before the last one, and the views of C cameras."""

    time: float
    views: Views


@dataclass(frozen=True)
class SphereState:
    """What the next step needs.

    Attributes:
        particles: ``(N, 6)`` positions and velocities, weighted.
        time: seconds.
        open: ``(C,)`` probability that each camera sees the ball.
        last_frames: ``(C,)`` seconds at which each camera last gave a frame.
        undetected: seconds since the last status ``tracking``.
    """

    particles: ParticleState
    time: float
    open: FloatArray
    last_frames: FloatArray
    undetected: float = 0.0


def with_velocities(positions: FloatArray, speed: float, rng: np.random.Generator) -> FloatArray:
    """States ``(N, 6)`` at positions ``(N, 3)`` with Gaussian velocities; ``speed`` is their deviation, m/s."""
    return np.column_stack([positions, speed * rng.standard_normal((len(positions), 3))])


@dataclass(frozen=True)
class SphereTracker:
    """The filter of the sphere paper.

    Attributes:
        likelihood: weighs positions by the views.
        motion: moves them.
        covering: how cameras get covered; None trusts every view, as the paper does.
        largest_deviation: standard deviation of the position (root of the covariance's largest eigenvalue) up to which
            it counts as known, m.
        patience: seconds without that until the status turns from ``searching`` to ``lost``.
        stages: in which a step weighs (`tracking.filters.resampling`), at most; 1 weighs at once, as the
            paper does.
    """

    likelihood: ViewLikelihood
    motion: Motion = field(default_factory=ConstantVelocity3D)
    covering: Covering | None = field(default_factory=Covering)
    largest_deviation: float = 0.15
    patience: float = 1.0
    stages: int = 2

    def init(self, particles: FloatArray, views: int, time: float = 0.0) -> SphereState:
        """Equally weighted particles ``(N, 6)``, see `with_velocities`, for so many cameras; ``time`` in seconds."""
        weighted = ParticleState(particles, np.full(len(particles), -np.log(len(particles))))
        return SphereState(weighted, time, np.full(views, TRUST), np.full(views, time))

    def start_at(
        self,
        position: FloatArray,
        spread: float,
        particles: int,
        views: int,
        rng: np.random.Generator,
        time: float = 0.0,
        speed: float = START_SPEED,
    ) -> SphereState:
        """So many ``particles`` around a measured position ``(3,)``, as the paper starts; see `init`.

        ``spread`` is the standard deviation of the position, m, and ``speed`` that of the velocity along each axis,
        m/s.
        """
        positions = position + spread * rng.standard_normal((particles, 3))
        return self.init(with_velocities(positions, speed, rng), views, time)

    def step(
        self, state: SphereState, observation: TimedViews, rng: np.random.Generator
    ) -> tuple[SphereState, Position]:
        """One observation further: the state after it and the estimate."""
        seconds = max(observation.time - state.time, 0.0)
        fresh = np.array([view is not None for view in observation.views])
        predicted_open = state.open if self.covering is None else self.covering.predict(state.open, seconds)
        stages = _Stages(self, seconds, predicted_open)
        # Drawn anew every time (2.3), so that the stages begin with equal weights.
        posterior, _ = ParticleFilter(stages.propose, stages.weigh, threshold=1.0).step(
            state.particles, observation, rng
        )
        weights = probabilities(posterior.log_weights)
        opened = np.where(fresh, stages.opened(weights), predicted_open)
        mean = weighted_mean(posterior.particles, posterior.log_weights)
        covariance = weighted_covariance(posterior.particles, posterior.log_weights)
        deviation = float(np.sqrt(max(np.linalg.eigvalsh(covariance[:3, :3])[-1], 0.0)))
        last_frames = np.where(fresh, observation.time, state.last_frames)
        # Cameras out of step take turns; one that gave no frame for long sees nothing, whatever it saw before.
        seeing = (opened > OPEN) & (observation.time - last_frames <= self.patience)
        certain = deviation <= self.largest_deviation and int(seeing.sum()) >= min(2, len(opened))
        undetected = 0.0 if certain else state.undetected + seconds
        status: Status = "tracking" if certain else "searching" if undetected <= self.patience else "lost"
        score = float(np.mean(opened)) * float(np.exp(-deviation / self.largest_deviation))
        position = Position(observation.time, mean[:3], covariance[:3, :3], score, status, mean[3:], opened)
        return SphereState(posterior, observation.time, opened, last_frames, undetected), position


class _Stages:
    """Proposal and likelihood of one step, in stages."""

    def __init__(self, tracker: SphereTracker, seconds: float, opened: FloatArray) -> None:
        self._tracker, self._seconds, self._open = tracker, seconds, opened
        self._done = 0.0
        self.ratios: FloatArray | None = None

    def propose(
        self, particles: FloatArray, observation: TimedViews, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Particles moved, and all stages of weighing but the last."""
        moved = self._tracker.motion(particles, self._seconds, rng)
        for _ in range(self._tracker.stages - 1):
            self.ratios = self._tracker.likelihood(moved[:, :3], observation.views)
            share = bearable_share(self._path, STAGE_SHARE * len(moved), self._done)
            if share == 1.0:
                break
            gained = self._path(share) - self._path(self._done)
            moved = drawn_and_spread(moved, gained, STAGE_WIDTH, rng)
            self._done, self.ratios = share, None
        return moved, np.zeros(len(moved))

    def weigh(self, particles: FloatArray, observation: TimedViews) -> FloatArray:
        """What is left of the log-likelihood."""
        if self.ratios is None:
            self.ratios = self._tracker.likelihood(particles[:, :3], observation.views)
        return self._path(1.0) - self._path(self._done)

    def opened(self, weights: FloatArray) -> FloatArray:
        """Probability that each view is open, given the particles' weights ``(N,)`` after weighing."""
        assert self.ratios is not None
        return self._open if self._tracker.covering is None else open_after(self.ratios, self._open, weights)

    def _path(self, share: float) -> FloatArray:
        assert self.ratios is not None
        if share == 0.0:
            # Not 0 times the logarithm of a likelihood of zero.
            return np.zeros(len(self.ratios))
        ratios = share * self.ratios
        return np.asarray((ratios if self._tracker.covering is None else weigh_views(ratios, self._open)).sum(axis=1))


# A search takes frames of different cameras within so many seconds as one moment.
RECENT = 0.15
MomentViews: TypeAlias = tuple[Moment, Views]


@dataclass
class SphereLog:
    """What a run keeps: positions, one a moment; their moments; indices of those when the volume was searched."""

    positions: list[Position] = field(default_factory=list)
    moments: list[Moment] = field(default_factory=list)
    searches: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class SphereRun:
    """Everything that a run needs, checked.

    Attributes:
        settings: how the ball is followed.
        placed: the cameras.
        stamps: ``(T,)`` of each camera, the time of every frame, seconds; none of live cameras.
        tracker: the filter.
        start: ``(3,)`` the ball at first, metres; None searches the volume.
        search: positions ``(N, 3)`` after one search of the whole volume: the start without a position, and for a ball
            that was lost.
        views: measurements of the cameras at these moments; of live ones, from now on.
        radius: of the ball, metres; 0 of a point.
        sources: the videos, where there are some.
        speed: standard deviation of the velocity of a ball that was just found, along each axis, m/s.
    """

    settings: SphereSettings
    placed: Sequence[PlacedCamera]
    stamps: Sequence[FloatArray]
    tracker: SphereTracker
    start: FloatArray | None
    search: Callable[[Views, np.random.Generator], FloatArray]
    views: Callable[[Sequence[Moment]], Iterable[MomentViews]]
    radius: float
    sources: Sequence[Source] = ()
    speed: float = START_SPEED

    @property
    def length(self) -> int | None:
        """Frames of the longest video; None of live cameras."""
        return max(map(len, self.stamps)) if self.stamps else None

    def run(
        self,
        rng: np.random.Generator,
        times: StageTimes,
        watch: Callable[[Iterable[MomentViews]], Iterable[MomentViews]] = iter,
    ) -> SphereLog:
        """Track through all moments; ``times`` gets the stages, ``watch`` passes the moments through.

        Raises:
            RunError: no moment had an image.
        """
        log = SphereLog()
        for _ in self.follow(rng, times, log, watch):
            pass
        if not log.positions:
            raise RunError("expected frames of two videos at about one time, got none; check `offsets` or `timestamps`")
        return log

    def follow(
        self,
        rng: np.random.Generator,
        times: StageTimes | None = None,
        log: SphereLog | None = None,
        watch: Callable[[Iterable[MomentViews]], Iterable[MomentViews]] = iter,
    ) -> Iterator[Position]:
        """Each position as soon as it is known, kept in ``log``; a ball that is lost is searched again."""
        state: SphereState | None = None
        times, last_search = times or StageTimes(), -np.inf
        # The newest frame of each camera: cameras that are out of step never have frames together.
        recent: dict[int, tuple[float, NDArray[Any]]] = {}
        tracker, settings = self.tracker, self.settings
        watched = watch(self._moments())
        for moment, views in watched:
            now, position = moment.time, None
            with reported_to(watched):
                recent |= {k: (now, view) for k, view in enumerate(views) if view is not None}
                recent = {k: spot for k, spot in recent.items() if now - spot[0] <= RECENT}
                if state is None and self.start is not None:
                    begin = self.start, settings.spread, settings.particles, len(views), rng, now, self.speed
                    state = tracker.start_at(*begin)
                lost = state is None or state.undetected > tracker.patience
                if lost and len(recent) >= 2 and now - last_search > tracker.patience:
                    with times.measure("search"):
                        newest = [recent[k][1] if k in recent else None for k in range(len(views))]
                        positions = self.search(newest, rng)
                    begun = tracker.init(with_velocities(positions, self.speed, rng), len(views), now)
                    state, last_search = replace(begun, undetected=0.0 if state is None else state.undetected), now
                    if log is not None:
                        log.searches.append(len(log.positions))
                if state is not None:
                    with times.measure("filter"):
                        state, position = tracker.step(state, TimedViews(now, views), rng)
                    if log is not None:
                        log.positions.append(position)
                        log.moments.append(moment)
            if position is not None:
                yield position

    def _moments(self) -> Iterable[MomentViews]:
        if not self.stamps:
            return self.views([])
        tolerance = self.settings.tolerance
        return self.views(align(self.stamps, default_tolerance(self.stamps) if tolerance is None else tolerance))
