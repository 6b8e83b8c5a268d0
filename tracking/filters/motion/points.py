"""How points and boxes move: on a plane, in space along each axis, and in the image.

States of points are ``(N, D)``: position and velocity on each axis, ``x, vx, y, vy`` or ``x, vx, y, vy, z, vz``; after
them a rate of turn ``omega`` in radians a second where a motion needs one, and the number of the motion, from 0, where
several take turns. A motion leaves the columns that are not its own as they are. Equation numbers are those of the
finite-sets paper. Every motion keeps to `tsuiseki.tracking.filters.base.Motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.base import Motion, whole_frames
from tsuiseki.tracking.types import FloatArray


def constant_velocity(acceleration: float, dimensions: int = 2) -> Motion:
    """Straight motion with a random acceleration constant over each step, (1), along each of 2 or 3 axes.

    Args:
        acceleration: its standard deviation along each axis, in units a second squared.
        dimensions: 2 or 3.
    """

    def move(states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        # Column by column: a product with a 4x4 matrix costs several times more.
        moved = states.copy()
        for axis, noise in enumerate(rng.standard_normal((dimensions, len(states)))):
            gained = (acceleration * seconds) * noise
            velocity = states[:, 2 * axis + 1]
            moved[:, 2 * axis] = states[:, 2 * axis] + seconds * velocity + (0.5 * seconds) * gained
            moved[:, 2 * axis + 1] = velocity + gained
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
    nothing is merged.

    Args:
        motions: two or more.
        rate: changes of mode a second; the new mode is any other one.
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
    """Smooth motion (64)-(66) of boxes ``x, y, x before, y before, width, height`` in pixels, (63); in frames.

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
            here, before = states[:, :2], states[:, 2:4]
            size = np.maximum(states[:, 4:] + noise[:, 2:], self.smallest)
            states = np.concatenate([2 * here - before + noise[:, :2], here, size], axis=1)
        return states
