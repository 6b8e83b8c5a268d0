"""A particle filter on colour histograms; thesis 2.2.3.

Perez et al., "Color-based probabilistic tracking", ECCV 2002: particles are boxes ``x, y, scale``; the likelihood falls
with the squared Bhattacharyya distance between the histogram of a box and the first frame's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.base import bootstrap, each_frame
from tsuiseki.tracking.filters.particles.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.particles.weights import probabilities
from tsuiseki.tracking.single.interface import TargetState, box_centre
from tsuiseki.tracking.single.matching import colour_bins
from tsuiseki.tracking.types import FloatArray, ImageArray, Status


@dataclass(frozen=True)
class ColourParticleSettings:
    """Constants.

    Attributes:
        particles: how many.
        position: standard deviation of the walk, in sides of the target.
        scale: standard deviation of the walk of the logarithm of the size.
        sharpness: lambda of the likelihood ``exp(-lambda d^2)``.
        side: pixels of a box when its colours are counted.
        lost_below: Bhattacharyya coefficient at which the target counts as lost.
    """

    particles: int = 200
    position: float = 0.12
    scale: float = 0.02
    sharpness: float = 20.0
    side: int = 12
    lost_below: float = 0.6


class ColourParticle:
    """The box is the mean of the particles, the score the Bhattacharyya coefficient of the best one."""

    def __init__(self, settings: ColourParticleSettings | None = None, seed: int = 0) -> None:
        self.settings = ColourParticleSettings() if settings is None else settings
        self._rng = np.random.default_rng(seed)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        self._size = np.asarray(box[2:] - box[:2], dtype=np.float64)
        first = np.concatenate([box_centre(box), [0.0]])
        self._reference = self._histograms(image, first[None])[0]
        self._filter = ParticleFilter[ImageArray](bootstrap(each_frame(self._move)), self._log_likelihood)
        self._state = self._filter.init(np.repeat(first[None], self.settings.particles, axis=0))

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        self._state, _ = self._filter.step(self._state, image, self._rng)
        weights = probabilities(self._state.log_weights)
        mean = weights @ self._state.particles
        half = self._size * np.exp(mean[2]) / 2
        score = float(self._coefficients(image, self._state.particles[[int(np.argmax(weights))]])[0])
        status: Status = "tracking" if score >= self.settings.lost_below else "lost"
        return TargetState(np.concatenate([mean[:2] - half, mean[:2] + half]), score, status)

    def _move(self, particles: FloatArray, rng: np.random.Generator) -> FloatArray:
        walk = np.concatenate([self.settings.position * self._size, [self.settings.scale]])
        moved = particles + rng.normal(size=particles.shape) * walk
        moved[:, 2] = np.clip(moved[:, 2], -1.5, 1.5)
        return np.asarray(moved)

    def _log_likelihood(self, particles: FloatArray, observation: ImageArray) -> FloatArray:
        return -self.settings.sharpness * (1 - self._coefficients(observation, particles))

    def _coefficients(self, image: ImageArray, particles: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(self._histograms(image, particles) * self._reference).sum(axis=1))

    def _histograms(self, image: ImageArray, particles: FloatArray) -> FloatArray:
        """``(N, 64)`` colours at a grid of points in each box; points outside the image repeat its border."""
        side = self.settings.side
        grid = (np.arange(side) + 0.5) / side - 0.5
        size = self._size * np.exp(particles[:, 2:3])
        x = particles[:, 0:1] + size[:, 0:1] * grid
        y = particles[:, 1:2] + size[:, 1:2] * grid
        column = np.clip(np.floor(x).astype(int), 0, image.shape[1] - 1)
        row = np.clip(np.floor(y).astype(int), 0, image.shape[0] - 1)
        bins = colour_bins(image[row[:, :, None], column[:, None, :]]).reshape(len(particles), -1).astype(np.int64)
        bins += 64 * np.arange(len(particles))[:, None]
        counts = np.bincount(bins.ravel(), minlength=64 * len(particles))
        return counts.reshape(len(particles), 64) / side**2
