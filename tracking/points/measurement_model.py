"""The model that the finite-set filters take, from the settings of a sensor and its targets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.base import Births, Motion
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, MixtureBirths, newborn
from tsuiseki.tracking.filters.finite_sets.models import (
    GaussianSensor,
    PointModel,
    StateFunction,
    StateTest,
    linear_sensor,
    polar_sensor,
)
from tsuiseki.tracking.filters.motion.points import constant_velocity, coordinated_turn, taking_turns
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.types.measurements import MotionSettings, Scan, SensingModel

FIRST_TURN = 0.05
"""Standard deviation of a new target's rate of turn, radians a second."""


def state_columns(model: SensingModel) -> int:
    """Length of a state."""
    return 2 * model.sensor.dimensions + int(_turns(model)) + int(len(model.motions) > 1)


def point_model(model: SensingModel) -> PointModel:
    """The model that the filters take, for steps of one second."""
    dimensions = model.sensor.dimensions
    moves = [_motion(motion, dimensions) for motion in model.motions]
    motion = moves[0] if len(moves) == 1 else taking_turns(moves, model.switching)
    deviation = np.broadcast_to(np.asarray(model.sensor.deviation), (dimensions,)).copy()
    circular = (0,) if model.sensor.model == "bearing-range" else ()
    sensor = GaussianSensor(_sensor(model)[0], deviation, circular)
    inside = _inside(sensor, model.region) if model.leave == "gone" else None
    return PointModel(motion, sensor, model.survival, model.detection, model.clutter / _volume(model), inside=inside)


def point_births(model: SensingModel, particles: int) -> Births[FloatArray]:
    """Births a second: anywhere in the region, drawn where something was measured, or at the places of the model."""
    dimensions, places = model.sensor.dimensions, model.births.places
    turn = FIRST_TURN if _turns(model) else None
    modes = len(model.motions)
    sensor = point_model(model).sensor
    if not places:
        complete = newborn(_sensor(model)[1], dimensions, model.births.speed, turn, modes)
        density = model.births.rate / _volume(model)
        return MeasurementBirths(density, sensor, complete, state_columns(model), max(particles // 5, 1))
    extra = state_columns(model) - 2 * dimensions
    means = np.array([[*place.mean, *[0.0] * extra] for place in places])
    spread = [np.broadcast_to(np.asarray(place.deviation), (2 * dimensions,)) for place in places]
    rest = [turn] * int(turn is not None) + [0.0] * int(modes > 1)
    deviations = np.array([[*each, *rest] for each in spread])
    return MixtureBirths(np.array([place.rate for place in places]), means, deviations, particles, sensor, modes)


def _motion(motion: MotionSettings, dimensions: int) -> Motion:
    if motion.model == "coordinated-turn":
        return coordinated_turn(motion.acceleration, motion.turn, dimensions)
    return constant_velocity(motion.acceleration, dimensions)


def _inside(sensor: GaussianSensor, region: Sequence[tuple[float, float]]) -> StateTest:
    low, high = np.array(region).T

    def inside(particles: FloatArray) -> BoolArray:
        places = sensor.project(particles)
        return np.asarray(((places >= low) & (places <= high)).all(axis=1))

    return inside


def _turns(model: SensingModel) -> bool:
    return any(motion.model == "coordinated-turn" for motion in model.motions)


def _sensor(model: SensingModel) -> tuple[StateFunction, StateFunction]:
    origin = np.array(model.sensor.position or (0.0,) * model.sensor.dimensions)
    make = linear_sensor if model.sensor.model == "linear" else polar_sensor
    return make(model.sensor.dimensions, origin)


def _volume(model: SensingModel) -> float:
    if not model.region:
        raise RequestError("region: expected pairs low, high of each measured number, got none")
    return float(np.prod([high - low for low, high in model.region]))


def region_of(scans: Sequence[Scan]) -> tuple[tuple[float, float], ...]:
    """Where the measurements lie.

    Raises:
        RequestError: they do not spread along every axis.
    """
    every = np.concatenate([scan.measurements for scan in scans])
    if len(every) == 0:
        raise RequestError("expected at least one measurement, got none")
    low, high = every.min(axis=0), every.max(axis=0)
    if not (high > low).all():
        raise RequestError("region: expected pairs low, high, for all measurements lie on a line")
    return tuple((float(a), float(b)) for a, b in zip(low, high, strict=True))


def positions_of(model: SensingModel, measurements: FloatArray) -> FloatArray:
    """Positions ``(M, D)`` of error-free measurements ``(M, Z)``."""
    return _sensor(model)[1](measurements)
