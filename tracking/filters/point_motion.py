"""How points and boxes move: on a plane, in space, and in the image.

States of points are ``(N, D)``: position and velocity on each axis, ``x, vx, y, vy`` or ``x, vx, y, vy, z, vz``; after
them a rate of turn ``omega`` in radians a second where a motion needs one, and the number of the motion, from 0, where
several take turns. A motion leaves the columns that are not its own as they are. The motions of a ball in space have
states ``(N, 6)``, position (m) and then velocity (m/s). Equation numbers are those of the finite-sets paper. Every
motion keeps to `tsuiseki.tracking.filters.base.Motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.base import Motion, whole_frames
from tsuiseki.tracking.types import FloatArray


def constant_velocity(acceleration: float) -> Motion:
    """Straight motion of states ``x, vx, y, vy`` with a random acceleration constant over each step, Eq. (1).

    ``acceleration`` is its standard deviation along each axis, in units a second squared.
    """

    def move(states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        # Column by column: a product with a 4x4 matrix costs several times more.
        moved = np.empty_like(states)
        for place, noise in zip((0, 2), rng.standard_normal((2, len(states))), strict=True):
            gained = (acceleration * seconds) * noise
            velocity = states[:, place + 1]
            moved[:, place] = states[:, place] + seconds * velocity + (0.5 * seconds) * gained
            moved[:, place + 1] = velocity + gained
        return moved

    return move


def straight(acceleration: float, dimensions: int) -> Motion:
    """`constant_velocity` along each of 2 or 3 axes; further columns stay as they are."""

    def move(states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        moved = states.copy()
        for axis, noise in enumerate(rng.standard_normal((dimensions, len(states)))):
            gained = (acceleration * seconds) * noise
            moved[:, 2 * axis] += seconds * states[:, 2 * axis + 1] + (0.5 * seconds) * gained
            moved[:, 2 * axis + 1] += gained
        return moved

    return move


def coordinated_turn(acceleration: float, turn: float, dimensions: int = 2) -> Motion:
    """Motion on arcs in the plane of x and y, whose velocity turns at the rate ``omega``, (1); straight in z.

    Args:
        acceleration: standard deviation of the random acceleration along each axis.
        turn: standard deviation of the change of ``omega`` a second, in radians a second.
        dimensions: 2 or 3.
    """
    rate = 2 * dimensions

    def move(states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        gain = acceleration * np.array([seconds**2 / 2, seconds])
        x, vx, y, vy, omega = states.T[[0, 1, 2, 3, rate]]
        angle = omega * seconds
        sine, cosine = np.sin(angle), np.cos(angle)
        # sin(wT)/w and (1 - cos(wT))/w, whose limits at w = 0 are T and 0.
        straight = seconds * np.sinc(angle / np.pi)
        aside = seconds * np.sinc(angle / (2 * np.pi)) * np.sin(angle / 2)
        noise = rng.standard_normal((3, len(states)))
        moved = states.copy()
        moved[:, 0] = x + straight * vx - aside * vy + gain[0] * noise[0]
        moved[:, 1] = cosine * vx - sine * vy + gain[1] * noise[0]
        moved[:, 2] = y + aside * vx + straight * vy + gain[0] * noise[1]
        moved[:, 3] = sine * vx + cosine * vy + gain[1] * noise[1]
        moved[:, rate] = omega + turn * seconds * noise[2]
        if dimensions == 3:
            gained = (acceleration * seconds) * rng.standard_normal(len(states))
            moved[:, 4] += seconds * states[:, 5] + (0.5 * seconds) * gained
            moved[:, 5] += gained
        return moved

    return move


def taking_turns(motions: Sequence[Motion], rate: float) -> Motion:
    """Several motions of which one is in force at a time: a Markov chain, whose state is the particle's last column.

    The model of the interacting multiple model filter (Blom and Bar-Shalom, 1988); the particles carry the mode, so
    nothing is merged. ``rate`` is of changes of mode a second; the new mode is any other one of two or more motions.
    """

    def move(particles: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        mode = particles[:, -1].astype(np.int64)
        # The chance of another mode after a time, of a chain that leaves each at this rate.
        others = (len(motions) - 1) / len(motions)
        changes = rng.random(len(mode)) < others * (1 - np.exp(-rate * seconds / others))
        mode = np.where(changes, (mode + rng.integers(1, len(motions), len(mode))) % len(motions), mode)
        moved = particles.copy()
        for number, motion in enumerate(motions):
            mine = mode == number
            moved[mine] = motion(particles[mine], seconds, rng)
        moved[:, -1] = mode
        return moved

    return move


@dataclass(frozen=True)
class PlaneWalk:
    """Random walk of the first K columns; the others stay. In frames.

    Attributes:
        deviation: ``(K,)`` standard deviations of a step.
    """

    deviation: FloatArray

    def __call__(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        columns = len(self.deviation)
        moved = states.copy()
        for _ in range(whole_frames(seconds)):
            moved[:, :columns] += rng.standard_normal((len(states), columns)) * self.deviation
        return moved


@dataclass(frozen=True)
class PlaneVelocity:
    """Constant velocity of a place ``x, y, vx, vy`` in the image, for a Kalman filter; in frames.

    Attributes:
        place: variance that a frame adds to the place along each axis, square pixels.
        velocity: variance that a frame adds to the velocity along each axis, square pixels.
    """

    place: float
    velocity: float

    def linear(self, seconds: float) -> tuple[FloatArray, FloatArray]:
        """Transition ``(4, 4)`` and covariance of the noise ``(4, 4)`` over ``seconds`` > 0."""
        noise = np.diag([self.place, self.place, self.velocity, self.velocity])
        return np.eye(4) + seconds * np.eye(4, k=2), seconds * noise


@dataclass(frozen=True)
class DriftingBox:
    """Constant velocity of boxes ``x, vx, y, vy, width, height`` in pixels, whose size drifts; in frames.

    Attributes:
        acceleration: standard deviation of the change of velocity from one frame to the next, pixels.
        growth: standard deviation of the change of width and height from one frame to the next, pixels.
    """

    acceleration: float
    growth: float

    def __call__(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        for _ in range(whole_frames(seconds)):
            deviation = [self.acceleration, self.acceleration, self.growth, self.growth]
            noise = rng.standard_normal((len(states), 4)) * deviation
            moved = states.copy()
            moved[:, [0, 2]] += states[:, [1, 3]] + noise[:, :2] / 2
            moved[:, [1, 3]] += noise[:, :2]
            moved[:, 4:] = np.maximum(states[:, 4:] + noise[:, 2:], 1.0)
            states = moved
        return states


SMALLEST_SIDE = 3.0
"""Least width and height of a box in pixels."""


@dataclass(frozen=True)
class SteppingBox:
    """Smooth motion of boxes ``x, y, x before, y before, width, height`` in pixels, Eqs. (63)-(66); in frames.

    The position goes on by its last step, the size drifts.

    Attributes:
        place: standard deviation of the change of the step, ``tau_x`` and ``tau_y``, pixels.
        size: standard deviation of the change of size, ``tau_d`` and ``tau_h``, pixels.
        smallest: least width and height in pixels. A box as small as a single spot of the colour has a greater
            ``p (1 - q)`` than the object around it.
    """

    place: float
    size: float
    smallest: float = SMALLEST_SIDE

    def __call__(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        deviation = np.array([self.place, self.place, self.size, self.size])
        for _ in range(whole_frames(seconds)):
            noise = deviation * rng.standard_normal((len(states), 4))
            now, previous = states[:, :2], states[:, 2:4]
            size = np.maximum(states[:, 4:] + noise[:, 2:], self.smallest)
            states = np.concatenate([2 * now - previous + noise[:, :2], now, size], axis=1)
        return states


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
            velocity = states[:, 3:]
            speed = np.sqrt(np.square(velocity).sum(axis=1, keepdims=True))
            # The air stops a ball at most.
            slowing = np.minimum(self.drag * speed, 1 / seconds) if seconds > 0 else 0.0
            gained = np.cross(self.spin, velocity) - slowing * velocity
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
