"""How a point moves in space, for particle filters.

States are ``(N, 6)``, position (m) and velocity (m/s). The motion over a longer time has the same law as several
shorter ones in a row, so frames may be dropped or uneven.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class RandomWalk3D:
    """Section 2.1 of the sphere paper: the position takes a random step, the velocity stays zero.

    Attributes:
        diffusion: standard deviation along each axis after one second, m; it grows with the square root of time.
    """

    diffusion: float = 0.15

    def __call__(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        moved = np.zeros_like(states)
        step = rng.standard_normal((len(states), 3)) * self.diffusion * np.sqrt(seconds)
        moved[:, :3] = states[:, :3] + step
        return moved


@dataclass(frozen=True)
class ConstantVelocity3D:
    """White-noise acceleration (Bar-Shalom et al., *Estimation with Applications*, 2001, section 6.2.2).

    Attributes:
        agitation: standard deviation of the velocity gained in one second, m/s.
    """

    agitation: float = 1.5

    def __call__(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        first, second = rng.standard_normal((2, len(states), 3)) * self.agitation * np.sqrt(seconds)
        velocity = states[:, 3:] + first
        # Integrated white noise over T: variance T^3 / 3, of which the part T / 2 goes with the velocity's.
        position = states[:, :3] + seconds * (states[:, 3:] + 0.5 * first + second / np.sqrt(12))
        return np.concatenate([position, velocity], axis=1)


@dataclass(frozen=True)
class Ballistic:
    """Free flight under gravity that bounces off a level floor, with white-noise acceleration besides.

    Attributes:
        radius: of the ball: its centre bounces at this height above the floor, m.
        floor: height of the floor, m.
        gravity: along -z, m/s^2.
        restitution: speed after a bounce over the speed before, [0, 1].
        agitation: as in `ConstantVelocity3D`, m/s.
        drag: deceleration by the air over the speed squared, 1/m: density x drag coefficient x cross-section /
            (2 x mass), about 0.02 for a tennis ball and 0.1 for table tennis.
        spin: ``(3,)`` Magnus coefficient along the axis of spin, 1/s: the acceleration is its cross product with the
            velocity.
    """

    radius: float
    floor: float = 0.0
    gravity: float = 9.81
    restitution: float = 0.75
    agitation: float = 1.0
    drag: float = 0.0
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        moved = ConstantVelocity3D(self.agitation)(states, seconds, rng)
        if self.drag or any(self.spin):
            # At the velocity before the step: second order in the time between frames.
            before = states[:, 3:]
            speed = np.sqrt(np.square(before).sum(axis=1, keepdims=True))
            # The air stops a ball at most.
            slowing = np.minimum(self.drag * speed, 1 / seconds) if seconds > 0 else 0.0
            gained = np.cross(self.spin, before) - slowing * before
            moved[:, :3] += 0.5 * gained * seconds**2
            moved[:, 3:] += gained * seconds
        moved[:, 2] -= 0.5 * self.gravity * seconds**2
        moved[:, 5] -= self.gravity * seconds
        lowest = self.floor + self.radius
        below = (moved[:, 2] < lowest) & (moved[:, 5] < 0)
        # Energy fixes the speed at the floor however the step was cut: v^2 there is v^2 here - 2 g depth.
        depth = lowest - moved[below, 2]
        down = np.sqrt(np.maximum(moved[below, 5] ** 2 - 2 * self.gravity * depth, 0.0))
        late = np.minimum(2 * depth / np.maximum(down - moved[below, 5], 1e-9), seconds)
        up = self.restitution * down
        moved[below, 2] = lowest + np.maximum(up * late - 0.5 * self.gravity * late**2, 0.0)
        moved[below, 5] = up - self.gravity * late
        # A ball that has come to rest must not sink through the floor.
        moved[:, 2] = np.maximum(moved[:, 2], lowest)
        return moved
