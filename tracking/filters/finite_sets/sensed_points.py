"""Motions and sensors of points in two or three dimensions, and motions that take turns.

States are ``(N, D)``: position and velocity on each axis, ``x, vx, y, vy`` or ``x, vx, y, vy, z, vz``; after them a
rate of turn ``omega`` in radians a second where a motion needs one, and the number of the motion, from 0, where several
take turns. A motion leaves the columns that are not its own as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.filters.finite_sets.point_models import StateFunction, coordinated_turn
from tsuiseki.tracking.types import FloatArray


def straight(acceleration: float, dimensions: int) -> Motion:
    """Constant velocity with a random acceleration, constant over each step, along each of 2 or 3 axes.

    Args:
        acceleration: its standard deviation, in units a second squared.
        dimensions: 2 or 3.
    """

    def move(particles: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        moved = particles.copy()
        for axis, noise in enumerate(rng.standard_normal((dimensions, len(particles)))):
            gained = (acceleration * seconds) * noise
            moved[:, 2 * axis] += seconds * particles[:, 2 * axis + 1] + (0.5 * seconds) * gained
            moved[:, 2 * axis + 1] += gained
        return moved

    return move


def turning(acceleration: float, turn: float, dimensions: int) -> Motion:
    """Arcs in the plane of x and y at the rate ``omega`` of the state; along z straight on.

    Args:
        acceleration: standard deviation of the random acceleration along each axis.
        turn: standard deviation of the change of ``omega`` a second.
        dimensions: 2 or 3.
    """
    flat, rate = coordinated_turn(acceleration, turn), 2 * dimensions

    def move(particles: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        moved = particles.copy()
        plane = [0, 1, 2, 3, rate]
        moved[:, plane] = flat(particles[:, plane], seconds, rng)
        if dimensions == 3:
            gained = (acceleration * seconds) * rng.standard_normal(len(particles))
            moved[:, 4] += seconds * particles[:, 5] + (0.5 * seconds) * gained
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


def linear_sensor(dimensions: int, origin: FloatArray) -> tuple[StateFunction, StateFunction]:
    """Measured positions relative to ``origin`` ``(dimensions,)``, and back."""

    def project(particles: FloatArray) -> FloatArray:
        return particles[:, 0 : 2 * dimensions : 2] - origin

    return project, lambda measurements: measurements + origin


def polar_sensor(dimensions: int, origin: FloatArray) -> tuple[StateFunction, StateFunction]:
    """Bearing (from the x axis towards y), in 3D elevation (from the plane towards z), range; and back.

    Angles are radians; ``origin`` ``(dimensions,)`` is where the sensor stands.
    """

    def project(particles: FloatArray) -> FloatArray:
        away = particles[:, 0 : 2 * dimensions : 2] - origin
        bearing, across = np.arctan2(away[:, 1], away[:, 0]), np.hypot(away[:, 0], away[:, 1])
        if dimensions == 2:
            return np.stack([bearing, across], axis=1)
        return np.stack([bearing, np.arctan2(away[:, 2], across), np.hypot(across, away[:, 2])], axis=1)

    def invert(measurements: FloatArray) -> FloatArray:
        bearing, reach = measurements[:, 0], measurements[:, -1]
        elevation = measurements[:, 1] if dimensions == 3 else np.zeros(len(measurements))
        across = reach * np.cos(elevation)
        parts = [across * np.cos(bearing), across * np.sin(bearing), reach * np.sin(elevation)]
        return np.stack(parts[:dimensions], axis=1) + origin

    return project, invert


def newborn(
    invert: StateFunction, dimensions: int, speed: float, turn: float | None, modes: int
) -> Callable[[FloatArray, np.random.Generator], FloatArray]:
    """States at measured places: the ``complete`` of `point_births.MeasurementBirths`.

    Args:
        invert: measurements to positions.
        dimensions: 2 or 3.
        speed: standard deviation of the velocity along each axis.
        turn: standard deviation of ``omega``; None where states have none.
        modes: motions that take turns; below 2 states have no mode.
    """

    def complete(measurements: FloatArray, rng: np.random.Generator) -> FloatArray:
        places = invert(measurements)
        parts = np.empty((len(places), 2 * dimensions))
        parts[:, ::2], parts[:, 1::2] = places, speed * rng.standard_normal(places.shape)
        columns = [parts]
        if turn is not None:
            columns.append(turn * rng.standard_normal((len(places), 1)))
        if modes > 1:
            columns.append(rng.integers(0, modes, (len(places), 1)).astype(np.float64))
        return np.concatenate(columns, axis=1)

    return complete
