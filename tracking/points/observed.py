"""The finite-set filters of boxes, of coloured regions and of a sensor's scans, with their models of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.base import Births, Filter, Motion, SetInfo
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, MixtureBirths, newborn
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter
from tsuiseki.tracking.filters.finite_sets.point_model import (
    GaussianSensor,
    PointModel,
    StateFunction,
    StateTest,
    linear_sensor,
    polar_sensor,
)
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import (
    Calibrated,
    EachAlone,
    Equalised,
    WithoutOthers,
    as_printed,
)
from tsuiseki.tracking.filters.finite_sets.region_phd import AnywhereBirths, PatchBirths, RegionPhdFilter
from tsuiseki.tracking.filters.point_motion import (
    DriftingBox,
    SteppingBox,
    coordinated_turn,
    straight,
    taking_turns,
)
from tsuiseki.tracking.points.settings import BlobSettings, PointSettings, SetMethod
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.types.measurements import Scan
from tsuiseki.tracking.types.sensing_model import MotionSettings, SensingModel

SetFilter: TypeAlias = Filter[Any, Any, SetInfo]
# Length of a state of a box or region.
COLUMNS = 6
# Probability that a measured box goes on, in each frame.
SURVIVAL = 0.99
# Expected new targets in a frame. With the preset paper also the share of a target's particles that are drawn for them.
BIRTHS = 0.05
# Standard deviation of a measured centre, in heights of a typical box.
PLACE_ERROR = 0.06
# Standard deviation of a measured width or height, in heights of a typical box.
SIZE_ERROR = 0.08
# Standard deviation of a new box's velocity along each axis, in heights of a typical box a frame.
SPEED = 0.1
# Standard deviation of the change of velocity in a frame, in the same units.
ACCELERATION = 0.015
# Standard deviation of the change of size in a frame, in heights of a typical box.
GROWTH = 0.01
# Standard deviation of the change of a coloured object's step, ``tau_x`` and ``tau_y``, pixels.
PLACE_NOISE = 1.5
# Standard deviation of the change of its size, ``tau_d`` and ``tau_h``, pixels.
SIZE_NOISE = 1.0
# Largest expected number with the preset paper, whose number of particles is this times those of a target.
TARGETS = 10
# A new target's velocity is known by a few of its particles only; without a kernel a calm motion keeps those few.
KERNEL = 0.5
# Share of a motion's noise that a calm target has.
CALM = 0.2
# Standard deviation of a new target's rate of turn, radians a second.
FIRST_TURN = 0.05


def box_of(particles: FloatArray) -> FloatArray:
    """Centres and sizes ``(N, 4)`` of states ``(N, 6)``."""
    return particles[:, [0, 2, 4, 5]]


def box_filter(settings: PointSettings, extent: tuple[float, float], unit: float) -> SetFilter:
    """The filter of boxes about ``unit`` pixels high in an image of ``extent`` pixels: points of centre and size."""
    sensor = GaussianSensor(box_of, np.repeat([PLACE_ERROR * unit, SIZE_ERROR * unit], 2))
    # False boxes lie anywhere in the image, their sides within about half of a typical one.
    volume = extent[0] * extent[1] * (0.5 * unit) * unit
    motion = DriftingBox(ACCELERATION * unit, GROWTH * unit)
    model = PointModel(motion, sensor, SURVIVAL, settings.detection, settings.clutter / volume)

    def complete(measurements: FloatArray, rng: np.random.Generator) -> FloatArray:
        states = np.empty((len(measurements), COLUMNS))
        states[:, [0, 2, 4, 5]] = measurements
        states[:, [1, 3]] = SPEED * unit * rng.standard_normal((len(measurements), 2))
        return states

    births = MeasurementBirths(BIRTHS / volume, sensor, complete, COLUMNS)
    chosen = LabelledMultiBernoulliFilter if settings.method == "labelled" else PhdFilter
    return chosen(model, births, settings.particles)


def region_motion(settings: BlobSettings) -> SteppingBox:
    """How coloured objects move."""
    return SteppingBox(PLACE_NOISE, SIZE_NOISE, settings.smallest)


def region_filter(settings: BlobSettings) -> RegionPhdFilter:
    """The filter of several coloured objects for the preset."""
    motion, particles = region_motion(settings), settings.particles
    if settings.preset == "paper":
        births = AnywhereBirths(BIRTHS, max(round(particles * BIRTHS), 1), settings.size)
        return RegionPhdFilter(motion, births, EachAlone(), Equalised(as_printed), particles, particles * TARGETS)
    return RegionPhdFilter(motion, PatchBirths(smallest=settings.smallest), WithoutOthers(), Calibrated(), particles)


def with_calm_motion(model: SensingModel) -> SensingModel:
    """A single motion takes turns with the same at `CALM` of its noise: a target is placed better while it is calm."""
    if len(model.motions) > 1:
        return model
    motion = model.motions[0]
    calm = replace(motion, acceleration=CALM * motion.acceleration, turn=CALM * motion.turn)
    return replace(model, motions=(calm, motion))


def scan_filter(model: SensingModel, method: SetMethod, particles: int) -> LabelledMultiBernoulliFilter | PhdFilter:
    """The filter of a sensor's scans, for steps of one second, with so many particles of each target."""
    points = point_model(model)
    births = _births(model, points.sensor, particles)
    if method == "phd":
        return PhdFilter(points, births, particles)
    modes = int(len(model.motions) > 1)
    return LabelledMultiBernoulliFilter(points, births, particles, kernel=KERNEL, discrete=modes)


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


def births_a_second(model: SensingModel) -> float:
    """Expected new targets a second, at all places together or anywhere."""
    return sum(place.rate for place in model.births.places) or model.births.rate


def _births(model: SensingModel, sensor: GaussianSensor, particles: int) -> Births[FloatArray]:
    """Births a second: anywhere in the region, drawn where something was measured, or at the places of the model."""
    dimensions, places, modes = model.sensor.dimensions, model.births.places, len(model.motions)
    turn = FIRST_TURN if _turns(model) else None
    if not places:
        complete = newborn(_sensor(model)[1], dimensions, model.births.speed, turn, modes)
        density = model.births.rate / _volume(model)
        return MeasurementBirths(density, sensor, complete, state_columns(model), max(particles // 5, 1))
    # Behind places and velocities a state has its rate of turn, and the number of its motion, where there are several.
    hidden_columns = [turn] * int(turn is not None) + [0.0] * int(modes > 1)
    means = np.array([[*place.mean, *[0.0] * len(hidden_columns)] for place in places])
    spread = [np.broadcast_to(np.asarray(place.deviation), (2 * dimensions,)) for place in places]
    deviations = np.array([[*deviation, *hidden_columns] for deviation in spread])
    return MixtureBirths(np.array([place.rate for place in places]), means, deviations, particles, sensor, modes)


def _motion(motion: MotionSettings, dimensions: int) -> Motion:
    # A type checker sees where a model has no case.
    match motion.model:
        case "constant-velocity":
            return straight(motion.acceleration, dimensions)
        case "coordinated-turn":
            return coordinated_turn(motion.acceleration, motion.turn, dimensions)


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
    measurements = np.concatenate([scan.measurements for scan in scans]) if scans else np.empty(0)
    if len(measurements) == 0:
        raise RequestError("expected at least one measurement, got none")
    low, high = measurements.min(axis=0), measurements.max(axis=0)
    if not (high > low).all():
        raise RequestError("region: expected pairs low, high, for all measurements lie on a line")
    return tuple((float(a), float(b)) for a, b in zip(low, high, strict=True))


def positions_of(model: SensingModel, measurements: FloatArray) -> FloatArray:
    """Positions ``(M, D)`` of error-free measurements ``(M, Z)``."""
    return _sensor(model)[1](measurements)
