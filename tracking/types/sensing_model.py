"""The model of a sensor and of the targets that it measures: what stands in the YAML of `track points`."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS

# Beyond it squares overflow.
LARGEST = 1e20
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
PositiveProbability = Annotated[float, Field(gt=0, le=1)]


def _several(value: Any) -> Any:
    """A number alone as one of several."""
    return (value,) if isinstance(value, int | float) else value


@dataclass(frozen=True, config=SETTINGS)
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
    deviation: Annotated[tuple[Positive, ...], BeforeValidator(_several)] = (1.0,)
    dimensions: Literal[2, 3] = 2
    position: tuple[Number, ...] = ()

    @model_validator(mode="after")
    def _one_number_a_dimension(self) -> Self:
        if len(self.deviation) not in (1, self.dimensions):
            raise ValueError(f"`sensor.deviation`: expected 1 or {self.dimensions} numbers, got {self.deviation}")
        if len(self.position) not in (0, self.dimensions):
            raise ValueError(f"`sensor.position`: expected {self.dimensions} numbers, got {len(self.position)}")
        return self

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the measured numbers."""
        if self.model == "linear":
            return ("x", "y", "z")[: self.dimensions]
        return ("bearing", "range") if self.dimensions == 2 else ("bearing", "elevation", "range")


MotionName = Literal["constant-velocity", "coordinated-turn"]


@dataclass(frozen=True, config=SETTINGS)
class MotionSettings:
    """How a target moves.

    Attributes:
        model: constant-velocity, or coordinated-turn in the plane of x and y.
        acceleration: standard deviation of the random acceleration along each axis, units a second squared.
        turn: standard deviation of the change of the rate of turn, radians a second squared.
    """

    model: MotionName = "constant-velocity"
    acceleration: NonNegative = 1.0
    turn: NonNegative = 0.02


@dataclass(frozen=True, config=SETTINGS)
class BirthPlace:
    """Where targets appear.

    Attributes:
        mean: ``x, vx, y, vy`` and in 3D ``z, vz``.
        deviation: of each of them; of one alone for all.
        rate: expected births there a second.
    """

    mean: tuple[Number, ...]
    deviation: Annotated[tuple[NonNegative, ...], BeforeValidator(_several)]
    rate: Positive

    @model_validator(mode="after")
    def _a_deviation_a_number(self) -> Self:
        if len(self.mean) not in (4, 6) or len(self.deviation) not in (1, len(self.mean)):
            raise ValueError(
                f"`births.places`: expected a mean of 4 or 6 numbers and as many deviations or one, got {self.mean} "
                f"and {self.deviation}"
            )
        return self


@dataclass(frozen=True, config=SETTINGS)
class BirthSettings:
    """New targets.

    Attributes:
        rate: expected new targets a second, anywhere in the region.
        speed: standard deviation of their velocity along each axis, units a second.
        places: known places of birth instead of anywhere.
    """

    rate: Positive = 0.1
    speed: Positive = 10.0
    places: tuple[BirthPlace, ...] = ()


@dataclass(frozen=True, config=SETTINGS)
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
    motions: Annotated[tuple[MotionSettings, ...], Field(min_length=1)] = (MotionSettings(),)
    switching: Positive = 0.1
    detection: PositiveProbability = 0.9
    survival: PositiveProbability = 0.99
    clutter: NonNegative = 1.0
    region: tuple[tuple[Number, Number], ...] = ()
    leave: Literal["gone", "unseen"] = "unseen"
    births: BirthSettings = field(default_factory=BirthSettings)

    @model_validator(mode="after")
    def _region_fits(self) -> Self:
        dimensions = self.sensor.dimensions
        if self.leave == "gone" and not self.region:
            raise ValueError("`leave`: expected a region with `gone`, got none")
        if self.region and len(self.region) != dimensions:
            raise ValueError(f"`region`: expected {dimensions} pairs low, high, got {len(self.region)}")
        if any(not low < high for low, high in self.region):
            raise ValueError(f"`region`: expected each low below its high, got {self.region}")
        if any(len(place.mean) != 2 * dimensions for place in self.births.places):
            raise ValueError(f"`births.places`: expected means of {2 * dimensions} numbers")
        return self
