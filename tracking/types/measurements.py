"""What a sensor measures, the targets in it, and the model of both."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Scan:
    """What a sensor measured at one time.

    Attributes:
        time: seconds.
        measurements: ``(M, Z)``.
        covariances: ``(M, Z, Z)`` of their errors; None where they have none of their own.
    """

    time: float
    measurements: FloatArray
    covariances: FloatArray | None = None

    def __post_init__(self) -> None:
        measured, covariances = np.asarray(self.measurements, dtype=np.float64), self.covariances
        if measured.ndim != 2 or not (np.isfinite(measured).all() and np.isfinite(self.time)):
            raise RequestError(
                f"expected a finite time and finite measurements (M, Z), got {self.time}, {measured.shape}"
            )
        if covariances is not None and np.shape(covariances) != (*measured.shape, measured.shape[1]):
            raise RequestError(f"expected covariances (M, Z, Z), got {np.shape(covariances)}")
        object.__setattr__(self, "measurements", measured)


@dataclass(frozen=True)
class SensedTargets:
    """The targets of one scan.

    Attributes:
        time: seconds.
        ids: ``(N,)`` positive.
        positions: ``(N, D)``.
        velocities: ``(N, D)``.
        covariances: ``(N, 2 D, 2 D)`` of ``x, vx, y, vy, …``.
        existence: ``(N,)`` in [0, 1].
        modes: ``(N, M)`` probability of each motion where several take turns.
    """

    time: float
    ids: IntArray
    positions: FloatArray
    velocities: FloatArray
    covariances: FloatArray
    existence: FloatArray
    modes: FloatArray


@dataclass(frozen=True)
class SensedTrack:
    """One target that a sensor measured.

    Attributes:
        id: positive.
        scans: ``(T,)`` 0-based numbers of the scans.
        times: ``(T,)`` seconds.
        positions: ``(T, D)`` with D 2 or 3.
        velocities: ``(T, D)``.
        covariances: ``(T, 2 D, 2 D)`` of ``x, vx, y, vy, …``.
        existence: ``(T,)`` probability, or the expected count, in [0, 1].
        modes: ``(T, M)`` probability of each motion where several take turns; M is 0 otherwise.
    """

    id: int
    scans: IntArray
    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    covariances: FloatArray
    existence: FloatArray
    modes: FloatArray

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True)
class PersonOnFloor(SensedTrack):
    """A person on a floor that several sensors cover; `scans` number the moments.

    Attributes:
        detected: ``(T, S)`` which sensors detected them.
    """

    detected: BoolArray


def _one_of(name: str, value: object, choices: tuple[object, ...]) -> None:
    if value not in choices:
        raise RequestError(f"{name}: expected one of {', '.join(map(str, choices))}, got {value!r}")


@dataclass(frozen=True)
class SensorSettings:
    """A sensor of points.

    Attributes:
        model: linear measures positions; bearing-range measures the angle from the x axis towards y, in 3D then the
            elevation, radians, and the distance.
        deviation: standard deviation of each measured number; of one alone for all. Measurements with covariances of
            their own need none.
        dimensions: 2 or 3.
        position: place of the sensor; by default the origin.
    """

    model: Literal["linear", "bearing-range"] = "linear"
    deviation: tuple[float, ...] = (1.0,)
    dimensions: Literal[2, 3] = 2
    position: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _one_of("sensor.model", self.model, ("linear", "bearing-range"))
        _one_of("sensor.dimensions", self.dimensions, (2, 3))
        if len(self.deviation) not in (1, self.dimensions) or not min(self.deviation) > 0:
            raise RequestError(
                f"sensor.deviation: expected 1 or {self.dimensions} numbers above 0, got {self.deviation}"
            )
        if len(self.position) not in (0, self.dimensions):
            raise RequestError(f"sensor.position: expected {self.dimensions} numbers, got {len(self.position)}")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the measured numbers."""
        if self.model == "linear":
            return ("x", "y", "z")[: self.dimensions]
        return ("bearing", "range") if self.dimensions == 2 else ("bearing", "elevation", "range")


@dataclass(frozen=True)
class MotionSettings:
    """How a target moves.

    Attributes:
        model: constant-velocity, or coordinated-turn in the plane of x and y.
        acceleration: standard deviation of the random acceleration along each axis, units a second squared.
        turn: standard deviation of the change of the rate of turn, radians a second squared.
    """

    model: Literal["constant-velocity", "coordinated-turn"] = "constant-velocity"
    acceleration: float = 1.0
    turn: float = 0.02

    def __post_init__(self) -> None:
        _one_of("motion.model", self.model, ("constant-velocity", "coordinated-turn"))
        for name in ("acceleration", "turn"):
            if not 0 <= getattr(self, name) < np.inf:
                raise RequestError(f"motion.{name}: expected a number from 0, got {getattr(self, name)}")


@dataclass(frozen=True)
class BirthPlace:
    """Where targets appear.

    Attributes:
        mean: ``x, vx, y, vy`` and in 3D ``z, vz``.
        deviation: of each of them; of one alone for all.
        rate: expected births there a second.
    """

    mean: tuple[float, ...]
    deviation: tuple[float, ...]
    rate: float

    def __post_init__(self) -> None:
        if len(self.mean) not in (4, 6) or len(self.deviation) not in (1, len(self.mean)):
            raise RequestError(
                f"births.places: expected a mean of 4 or 6 numbers and as many deviations or one, got {self.mean} and "
                f"{self.deviation}"
            )
        if not (min(self.deviation) >= 0 and 0 < self.rate < np.inf):
            raise RequestError("births.places: expected deviations from 0 and a rate above 0")


@dataclass(frozen=True)
class BirthSettings:
    """New targets.

    Attributes:
        rate: expected new targets a second, anywhere in the region.
        speed: standard deviation of their velocity along each axis, units a second.
        places: known places of birth instead of anywhere.
    """

    rate: float = 0.1
    speed: float = 10.0
    places: tuple[BirthPlace, ...] = ()

    def __post_init__(self) -> None:
        if not (0 < self.rate < np.inf and 0 < self.speed < np.inf):
            raise RequestError("births: expected a rate and a speed above 0")


@dataclass(frozen=True)
class SensingModel:
    """Targets, sensor and clutter.

    Attributes:
        sensor: what is measured.
        motions: of the targets; several take turns. A single one, of the labelled filter, takes turns with a calm one.
        switching: changes from one motion to another a second.
        detection: probability that a target is measured in a scan.
        survival: probability that a target goes on for one second.
        clutter: expected false measurements a scan, spread evenly over the region.
        region: ``(low, high)`` of each measured number, in which clutter falls and targets appear; by default where
            the measurements lie.
        leave: ``gone`` where a target that leaves the region has ended; ``unseen`` where the region says nothing of
            targets.
        births: new targets.
    """

    sensor: SensorSettings = field(default_factory=SensorSettings)
    motions: tuple[MotionSettings, ...] = (MotionSettings(),)
    switching: float = 0.1
    detection: float = 0.9
    survival: float = 0.99
    clutter: float = 1.0
    region: tuple[tuple[float, float], ...] = ()
    leave: Literal["gone", "unseen"] = "unseen"
    births: BirthSettings = field(default_factory=BirthSettings)

    def __post_init__(self) -> None:
        for name in ("detection", "survival"):
            if not 0 < getattr(self, name) <= 1:
                raise RequestError(f"{name}: expected a probability above 0, got {getattr(self, name)}")
        if not (0 <= self.clutter < np.inf and 0 < self.switching < np.inf and self.motions):
            raise RequestError("expected clutter from 0, switching above 0 and at least one motion")
        _one_of("leave", self.leave, ("gone", "unseen"))
        if self.leave == "gone" and not self.region:
            raise RequestError("leave: expected a region with `gone`, got none")
        if self.region and len(self.region) != self.sensor.dimensions:
            raise RequestError(f"region: expected {self.sensor.dimensions} pairs low, high, got {len(self.region)}")
        if any(not low < high for low, high in self.region):
            raise RequestError(f"region: expected each low below its high, got {self.region}")
        if any(len(place.mean) != 2 * self.sensor.dimensions for place in self.births.places):
            raise RequestError(f"births.places: expected means of {2 * self.sensor.dimensions} numbers")
