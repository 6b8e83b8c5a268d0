"""A ball in space from calibrated cameras, by the particle filter of the sphere paper.

A particle is a position and a velocity. A step predicts (2.1), weighs every particle by its outline in each camera
(2.2.2) or by the background difference (2.2.1), and resamples (2.3); the estimate is the weighted mean. Cameras are
multiplied, as the paper says for 2.2.1. Beyond the paper: a covered camera is recognised and left out
and particles are weighed in two stages (both are in `tracking.filters.resampling`). Without these two
(``covering=None, stages=1``), with `RandomWalk3D` and `views.PrintedContourLikelihood`, it is the paper's filter.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.filters.motion.points import ConstantVelocity3D
from tsuiseki.tracking.filters.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.resampling import (
    Covering,
    bearable_share,
    drawn_and_spread,
    log_sum,
    open_after,
    probabilities,
    weigh_views,
    weighted_covariance,
    weighted_mean,
)
from tsuiseki.tracking.sphere.views import ViewLikelihood, Views
from tsuiseki.tracking.types import FloatArray, Position, Status

# A view counts as open from OPEN on, and begins with TRUST.
OPEN, TRUST = 0.5, 0.9
# Effective sample size, over the number of particles, after a stage of weighing, and the kernel's relative width.
STAGE_SHARE, STAGE_WIDTH = 0.1, 0.6
START_SPEED = 0.3
"""Standard deviation of the velocity of a ball that was just found, along each axis, m/s."""


@dataclass(frozen=True)
class TimedViews:
    """The observation of one step.

    Attributes:
        time: seconds, not before the last one.
        views: of C cameras.
    """

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
        unseen: seconds since the last status ``tracking``.
    """

    particles: ParticleState
    time: float
    open: FloatArray
    last_frames: FloatArray
    unseen: float = 0.0


@dataclass(frozen=True)
class SphereInfo:
    """What came of one step.

    Attributes:
        position: the estimate.
        log_evidence: logarithm of the density of the views given all before them, over that of views that say nothing.
        deviation: standard deviation of the position along its least known direction, m.
    """

    position: Position
    log_evidence: float
    deviation: float


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
        """Equally weighted particles ``(N, 6)``, positions (m) and velocities (m/s), for so many cameras.

        Args:
            particles: of the start; see `with_velocities`.
            views: number of cameras.
            time: of the start, seconds.
        """
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
        """Particles around a measured position, as the paper starts.

        Args:
            position: ``(3,)`` metres.
            spread: standard deviation around it, m.
            particles: how many.
            views: number of cameras.
            rng: random numbers.
            time: of the start, seconds.
            speed: standard deviation of the velocity along each axis, m/s.
        """
        positions = position + spread * rng.standard_normal((particles, 3))
        return self.init(with_velocities(positions, speed, rng), views, time)

    def step(
        self, state: SphereState, observation: TimedViews, rng: np.random.Generator
    ) -> tuple[SphereState, SphereInfo]:
        """One observation further: the state after it and the estimate."""
        seconds = max(observation.time - state.time, 0.0)
        fresh = np.array([view is not None for view in observation.views])
        before = state.open if self.covering is None else self.covering.predict(state.open, seconds)
        stages = _Stages(self, seconds, before)
        # Drawn anew every time (2.3), so that the stages begin with equal weights.
        after, info = ParticleFilter(stages.propose, stages.weigh, threshold=1.0).step(
            state.particles, observation, rng
        )
        weights = probabilities(after.log_weights)
        opened = np.where(fresh, stages.opened(weights), before)
        mean = weighted_mean(after.particles, after.log_weights)
        covariance = weighted_covariance(after.particles, after.log_weights)
        deviation = float(np.sqrt(max(np.linalg.eigvalsh(covariance[:3, :3])[-1], 0.0)))
        last_frames = np.where(fresh, observation.time, state.last_frames)
        # Cameras out of step take turns; one that gave no frame for long sees nothing, whatever it saw before.
        seeing = (opened > OPEN) & (observation.time - last_frames <= self.patience)
        known = deviation <= self.largest_deviation and int(seeing.sum()) >= min(2, len(opened))
        unseen = 0.0 if known else state.unseen + seconds
        status: Status = "tracking" if known else "searching" if unseen <= self.patience else "lost"
        score = float(np.mean(opened)) * float(np.exp(-deviation / self.largest_deviation))
        position = Position(observation.time, mean[:3], covariance[:3, :3], score, status, mean[3:], opened)
        evidence = stages.log_evidence + info.log_evidence
        return SphereState(after, observation.time, opened, last_frames, unseen), SphereInfo(
            position, evidence, deviation
        )


class _Stages:
    """Proposal and likelihood of one step, in stages."""

    def __init__(self, tracker: SphereTracker, seconds: float, opened: FloatArray) -> None:
        self._tracker, self._seconds, self._open = tracker, seconds, opened
        self._done = 0.0
        self.ratios: FloatArray | None = None
        self.log_evidence = 0.0

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
            self.log_evidence += log_sum(gained) - float(np.log(len(moved)))
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
