"""A ball in space from calibrated cameras, by the particle filter of the sphere paper.

A particle is a position and a velocity. A step predicts (2.1), weighs every particle by its outline in each camera
(2.2.2) or by the background difference (2.2.1), and resamples (2.3); the estimate is the weighted mean. What the paper
leaves open: cameras are multiplied (as it says for 2.2.1), and a covered camera is recognised and left out
(`tracking.filters.views`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.filters.motion_3d import ConstantVelocity, Motion3D
from tsuiseki.tracking.filters.particle import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.resampling import systematic
from tsuiseki.tracking.filters.views import Covering, open_after, weigh_views
from tsuiseki.tracking.filters.weights import probabilities, weighted_covariance, weighted_mean
from tsuiseki.tracking.likelihoods.background import colour_difference
from tsuiseki.tracking.likelihoods.sphere import ContourSettings, outline_support, polar_maps
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray, Position, Status

Views: TypeAlias = Sequence[NDArray[Any] | None]
"""One image ``(H, W, 3)`` uint8, or one measured pixel ``(2,)``, a camera; None where it has nothing now."""

OPEN = 0.5


@dataclass(frozen=True)
class Glance:
    """What one step sees.

    Attributes:
        time: seconds, not before the last one.
        views: of C cameras.
    """

    time: float
    views: Views


class ViewLikelihood(Protocol):
    """``(N, C)`` log-ratio of what each view shows given each position ``(N, 3)`` to what it would show anyway.

    Zero where a view says nothing: no frame, or the particle is out of its sight.
    """

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray: ...


@dataclass(frozen=True)
class ContourLikelihood:
    """Section 2.2.2; see `tracking.likelihoods.sphere`."""

    cameras: Sequence[PinholeCamera]
    radius: float
    settings: ContourSettings = field(default_factory=ContourSettings)

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, image) in enumerate(zip(self.cameras, views, strict=True)):
            if image is None:
                continue
            maps = polar_maps(camera, positions, self.radius, self.settings)
            support, share = outline_support(image, maps, self.settings).T
            ratios[:, k] = self.settings.steepness * share * (support - self.settings.clutter)
        return ratios


@dataclass(frozen=True)
class BackgroundLikelihood:
    """Section 2.2.1: the colour differences from the background, multiplied over the cameras.

    Attributes:
        cameras: C cameras.
        backgrounds: C images of the empty scene.
        noise: grey levels added to each difference, so that one zero does not rule a particle out.
    """

    cameras: Sequence[PinholeCamera]
    backgrounds: Sequence[ImageArray]
    noise: float = 1.0

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, image) in enumerate(zip(self.cameras, views, strict=True)):
            if image is not None:
                difference, inside = colour_difference(camera, image, self.backgrounds[k], positions)
                ratios[:, k] = np.where(inside, np.log(difference + self.noise), np.log(self.noise))
        return ratios


@dataclass(frozen=True)
class PointLikelihood:
    """Measured pixels of the target's centre: Gaussian with a share of false ones spread over the image.

    Attributes:
        cameras: C cameras.
        sigma: ``(C,)`` standard deviation along x and y, pixels.
    """

    cameras: Sequence[PinholeCamera]
    sigma: FloatArray

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, pixel) in enumerate(zip(self.cameras, views, strict=True)):
            if pixel is None:
                continue
            projected, _ = camera.project(positions)
            square = np.square(projected - pixel).sum(axis=1) / self.sigma[k] ** 2
            density = camera.width * camera.height / (2 * np.pi * self.sigma[k] ** 2)
            ratios[:, k] = np.log(density) - 0.5 * np.nan_to_num(square, nan=1e4)
        return np.maximum(ratios, -500.0)


@dataclass(frozen=True)
class SphereState:
    """What the next step needs.

    Attributes:
        particles: ``(N, 6)`` positions and velocities, weighted.
        time: seconds.
        open: ``(C,)`` probability that each camera sees the ball.
        unseen: seconds since the last status ``tracking``.
    """

    particles: ParticleState
    time: float
    open: FloatArray
    unseen: float = 0.0


@dataclass(frozen=True)
class SphereInfo:
    """What came of one step.

    Attributes:
        position: the estimate.
        ancestors: ``(N,)`` index of each particle's parent, for smoothing.
        deviation: standard deviation of the position along its least known direction, m.
    """

    position: Position
    ancestors: IntArray
    deviation: float


@dataclass(frozen=True)
class SphereTracker:
    """The filter of the sphere paper.

    Attributes:
        likelihood: weighs positions by the views.
        motion: moves them.
        covering: how cameras get covered; None trusts every view, as in the paper.
        largest_deviation: standard deviation of the position (root of the covariance's largest eigenvalue) up to which
            it counts as known, m.
        patience: seconds without that until the status turns from ``searching`` to ``lost``.
    """

    likelihood: ViewLikelihood
    motion: Motion3D = field(default_factory=ConstantVelocity)
    covering: Covering | None = field(default_factory=Covering)
    largest_deviation: float = 0.15
    patience: float = 1.0

    def start_at(
        self,
        position: FloatArray,
        spread: float,
        particles: int,
        views: int,
        rng: np.random.Generator,
        time: float = 0.0,
        speed: float = 0.3,
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
        states = rng.standard_normal((particles, 6)) * ([spread] * 3 + [speed] * 3)
        states[:, :3] += position
        return self._state(states, time, views)

    def search(
        self,
        volume: FloatArray,
        glance: Glance,
        particles: int,
        rng: np.random.Generator,
        candidates: int = 20000,
        layers: int = 8,
    ) -> SphereState:
        """Particles where one look at the whole volume finds the ball.

        A particle far from the ball learns nothing from its outline, so many candidates are drawn first; then they are
        weighed ever more sharply, resampled and moved by ever smaller random steps over the same images (Deutscher and
        Reid, "Articulated body motion capture by stochastic search", 2005).

        Args:
            volume: ``(2, 3)`` lowest and highest corner, metres.
            glance: the images.
            particles: how many at the end.
            rng: random numbers.
            candidates: drawn evenly in the volume.
            layers: rounds of weighing.
        """
        low, high = np.asarray(volume, dtype=np.float64)
        positions = low + rng.random((candidates, 3)) * (high - low)
        # Half the distance between neighbours, down to a centimetre.
        step = 0.5 * float(np.prod(high - low) / candidates) ** (1 / 3)
        count = candidates
        for layer in range(layers):
            share = (layer + 1) / layers
            total = np.maximum(self.likelihood(positions, glance.views), -3.0).sum(axis=1)
            count = max(particles, count // 2)
            chosen = systematic(probabilities(total * share), count, rng)
            jitter = max(step * (1 - share), 0.01)
            positions = np.clip(positions[chosen] + rng.standard_normal((count, 3)) * jitter, low, high)
        states = np.column_stack([positions[:: max(count // particles, 1)][:particles], np.zeros((particles, 3))])
        states[:, 3:] = rng.standard_normal((particles, 3)) * 0.3
        return self._state(states, glance.time, len(glance.views))

    def step(self, state: SphereState, glance: Glance, rng: np.random.Generator) -> tuple[SphereState, SphereInfo]:
        """One look further: the state after it and the estimate."""
        seconds = max(glance.time - state.time, 0.0)
        fresh = np.array([view is not None for view in glance.views])
        before = state.open if self.covering is None else self.covering.predict(state.open, seconds)
        weigher = _Weigher(self.likelihood, glance, before if self.covering else None)

        def move(particles: FloatArray, observation: Glance, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
            del observation
            return self.motion(particles, seconds, rng), np.zeros(len(particles))

        after, info = ParticleFilter(move, weigher).step(state.particles, glance, rng)
        weights = probabilities(after.log_weights)
        opened = open_after(weigher.ratios, before, weights) if self.covering else before
        opened = np.where(fresh, opened, before)
        mean = weighted_mean(after.particles, after.log_weights)
        covariance = weighted_covariance(after.particles, after.log_weights)
        deviation = float(np.sqrt(max(np.linalg.eigvalsh(covariance[:3, :3])[-1], 0.0)))
        known = deviation <= self.largest_deviation and int((opened > OPEN).sum()) >= min(2, len(opened))
        unseen = 0.0 if known else state.unseen + seconds
        status: Status = "tracking" if known else "searching" if unseen <= self.patience else "lost"
        score = float(np.mean(opened)) * float(np.exp(-deviation / self.largest_deviation))
        position = Position(glance.time, mean[:3], covariance[:3, :3], score, status, mean[3:], opened)
        return SphereState(after, glance.time, opened, unseen), SphereInfo(position, info.ancestors, deviation)

    def _state(self, states: FloatArray, time: float, views: int) -> SphereState:
        particles = ParticleState(states, np.full(len(states), -np.log(len(states))))
        return SphereState(particles, time, np.full(views, 0.9))


class _Weigher:
    """The log-likelihood of one step; it keeps the views' ratios, which the views' update needs too."""

    def __init__(self, likelihood: ViewLikelihood, glance: Glance, opened: FloatArray | None) -> None:
        self._likelihood, self._glance, self._open = likelihood, glance, opened
        self.ratios = np.empty((0, len(glance.views)))

    def __call__(self, particles: FloatArray, observation: Glance) -> FloatArray:
        del observation
        self.ratios = self._likelihood(particles[:, :3], self._glance.views)
        weighed = self.ratios if self._open is None else weigh_views(self.ratios, self._open)
        return np.asarray(weighed.sum(axis=1))
