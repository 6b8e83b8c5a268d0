"""How bodies move: random walk (8), constant velocity (9) and body-fixed velocity (16)-(18) of the goldfish paper.

The first columns of a particle are the body's state: image position ``a, b`` in pixels, heading ``theta`` in radians,
and whatever bends, one column each. A motion may keep more columns behind them. Numbers are those of one frame.

Noise is an argument. The motions (16)-(18) and the same with independent noise differ in nothing else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.base import whole_frames
from tsuiseki.tracking.types import FloatArray

HEADING = 2
"""Column of the heading; position stands before it, shape behind it."""


@dataclass(frozen=True)
class Noise:
    """Gaussian increments ``mean + factor z`` with ``z`` standard normal, Eq. (18).

    Attributes:
        mean: ``(D,)``.
        factor: ``(D, D)``; its product with its transpose is the covariance. Principal components times the square
            roots of their eigenvalues, or a diagonal of standard deviations.
    """

    mean: FloatArray
    factor: FloatArray

    @classmethod
    def independent(cls, mean: FloatArray, deviation: FloatArray) -> Noise:
        """With a standard deviation ``(D,)`` for each column."""
        return cls(np.asarray(mean, dtype=np.float64), np.diag(np.asarray(deviation, dtype=np.float64)))

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """``(count, D)`` increments."""
        return np.asarray(self.mean + rng.standard_normal((count, len(self.mean))) @ self.factor.T)

    @property
    def deviation(self) -> FloatArray:
        """``(D,)`` standard deviations of the columns."""
        return np.asarray(np.linalg.norm(self.factor, axis=1))

    def widened(self, times: float) -> Noise:
        """The same about the mean, with all deviations so many times as large."""
        return Noise(self.mean, times * self.factor)

    def without_correlation(self) -> Noise:
        """Independent noise of the same means and variances."""
        return Noise.independent(self.mean, self.deviation)


class BodyMotion(ABC):
    """A `Motion` of particles whose first columns are states of a body; its time is counted in frames.

    Attributes:
        noise: of the increments of one frame.
    """

    noise: Noise

    @abstractmethod
    def start(self, states: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Particles of body states ``(N, D)`` whose motion is not known yet."""

    @abstractmethod
    def moved(self, particles: FloatArray, increments: FloatArray) -> FloatArray:
        """Where particles go in one frame with the increments ``(N, D)``."""

    def __call__(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        for _ in range(whole_frames(seconds)):
            states = self.moved(states, self.noise.draw(len(states), rng))
        return states


@dataclass(frozen=True)
class RandomWalk(BodyMotion):
    """The state stays as it is but for noise, Eq. (8).

    Attributes:
        noise: of all ``D`` columns; position in image axes.
    """

    noise: Noise

    def start(self, states: FloatArray, rng: np.random.Generator) -> FloatArray:
        del rng
        return states.copy()

    def moved(self, particles: FloatArray, increments: FloatArray) -> FloatArray:
        return particles + increments


@dataclass(frozen=True)
class ConstantVelocity(BodyMotion):
    """Velocity in image axes stays as it is but for noise, Eq. (9); two columns behind the state hold it.

    The noise of the position is that of the velocity, drawn once, so that the velocity stays the difference of the
    positions: drawn apart, a change of speed would move the body only one frame later.

    Attributes:
        noise: of ``(a', b', theta, shape…)``.
        velocity: body-fixed velocity of a body whose motion is not known yet.
    """

    noise: Noise
    velocity: Noise

    def start(self, states: FloatArray, rng: np.random.Generator) -> FloatArray:
        """The states ``(N, D)`` with a velocity along the heading of each, ``(N, D + 2)``."""
        return np.concatenate([states, turned(self.velocity.draw(len(states), rng), states[:, HEADING])], axis=1)

    def moved(self, particles: FloatArray, increments: FloatArray) -> FloatArray:
        moved = particles.copy()
        moved[:, -2:] += increments[:, :2]
        moved[:, :2] += moved[:, -2:]
        moved[:, HEADING:-2] += increments[:, 2:]
        return moved


@dataclass(frozen=True)
class BodyFixedVelocity(BodyMotion):
    """Velocity in the body's own axes stays as it is but for noise, Eqs. (16)-(17).

    As many columns behind the state hold its rates: body-fixed velocity, and the last change of heading and shape. The
    paper's proposal needs only the velocity; with ``gain`` the expected increments are linear in what `conditions`
    reads off a particle.

    Attributes:
        noise: of ``(a'_std, b'_std, theta, shape…)``: the increments of (16), correlated as in (18) or independent.
        velocity: body-fixed velocity of a body whose motion is not known yet.
        gain: ``(D, C)`` increments for each condition; None is the paper's.
    """

    noise: Noise
    velocity: Noise
    gain: FloatArray | None = None

    def start(self, states: FloatArray, rng: np.random.Generator) -> FloatArray:
        rates = np.zeros_like(states)
        rates[:, :2] = self.velocity.draw(len(states), rng)
        return np.concatenate([states, rates], axis=1)

    def moved(self, particles: FloatArray, increments: FloatArray) -> FloatArray:
        columns = len(self.noise.mean)
        states, rates = particles[:, :columns], particles[:, columns:]
        if self.gain is not None:
            increments = increments + conditions(states, rates) @ self.gain.T
        velocity = rates[:, :2] + increments[:, :2]
        moved = np.empty_like(particles)
        moved[:, HEADING:columns] = states[:, HEADING:] + increments[:, 2:]
        moved[:, :2] = states[:, :2] + turned(velocity, moved[:, HEADING])
        moved[:, columns : columns + 2] = velocity
        moved[:, columns + 2 :] = increments[:, 2:]
        return moved


def conditions(states: FloatArray, rates: FloatArray) -> FloatArray:
    """What the next increments may depend on, as ``(N, C)`` columns.

    Body-fixed velocity and its product with each shape column (a bent body turns the more the faster it swims), the
    shape, and the last changes of heading and shape.
    """
    velocity, shape = rates[:, :2], states[:, HEADING + 1 :]
    return np.concatenate([velocity, velocity[:, :1] * shape, shape, rates[:, 2:]], axis=1)


def turned(vectors: FloatArray, angles: FloatArray) -> FloatArray:
    """Vectors ``(N, 2)`` turned by angles ``(N,)``: from the body's axes to the image's, (17)."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
