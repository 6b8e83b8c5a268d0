"""Models of targets that are seen as points: motion, sensor, survival, detection and clutter.

States are ``(N, D)`` float64 as of `point_motion`: position and velocity on each axis, ``x, vx, y, vy`` or with
``z, vz``, then a rate of turn where a motion needs one, and the number of the motion where several take turns. Equation
numbers are those of the finite-sets paper: sets of targets and of measurements (24)-(27) move by (28) and are observed
by (29).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

StateFunction = Callable[[FloatArray], FloatArray]
StateTest = Callable[[FloatArray], BoolArray]


def cartesian(particles: FloatArray) -> FloatArray:
    """Positions ``(N, 2)`` ``x, y`` of states ``x, vx, y, ...``."""
    return particles[:, 0:3:2]


def bearing_range(particles: FloatArray) -> FloatArray:
    """Bearing from the y axis, radians, and distance from the origin, ``(N, 2)``, of states ``x, vx, y, ...``."""
    x, y = particles[:, 0], particles[:, 2]
    return np.stack([np.arctan2(x, y), np.hypot(x, y)], axis=1)


def from_bearing_range(measurements: FloatArray) -> FloatArray:
    """Positions ``(N, 2)`` ``x, y`` of bearings and ranges ``(N, 2)``, the inverse of :func:`bearing_range`."""
    bearing, distance = measurements.T
    return np.stack([distance * np.sin(bearing), distance * np.cos(bearing)], axis=1)


@dataclass(frozen=True)
class GaussianSensor:
    """Measures a function of the state with independent Gaussian errors, Eqs. (2) and (40).

    Attributes:
        project: states ``(N, D)`` to error-free measurements ``(N, Z)``.
        deviation: ``(Z,)`` standard deviations, > 0.
        circular: columns of the measurement that are angles in radians.
        gate: deviations beyond which a likelihood counts as zero.
        roots: ``(M, Z, Z)`` lower triangular roots of the covariances of the M measurements of this step, where each
            has its own; `of_scan` sets them.
    """

    project: StateFunction
    deviation: FloatArray
    circular: tuple[int, ...] = ()
    gate: float = 5.0
    roots: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "deviation", np.asarray(self.deviation, dtype=np.float64))
        if not (np.isfinite(self.deviation).all() and np.all(self.deviation > 0)):
            raise ValueError(f"expected deviations above zero, got {self.deviation.tolist()}")

    def of_scan(self, covariances: FloatArray) -> GaussianSensor:
        """The sensor for one step whose M measurements have these covariances ``(M, Z, Z)``.

        Raises:
            ValueError: one is not positive definite.
        """
        try:
            roots = np.asarray(np.linalg.cholesky(covariances), dtype=np.float64) if len(covariances) else None
        except np.linalg.LinAlgError as error:
            raise ValueError("expected positive definite covariances, got one that is not") from error
        return replace(self, roots=roots)

    def deviations(self, count: int) -> FloatArray:
        """Standard deviations ``(count, Z)`` of so many measurements."""
        if self.roots is None:
            return np.broadcast_to(self.deviation, (count, len(self.deviation)))
        return np.asarray(np.sqrt(np.einsum("mzy,mzy->mz", self.roots, self.roots)))

    def spread(self, noise: FloatArray) -> FloatArray:
        """Errors of M measurements ``(M, K, Z)`` from standard normal ``noise`` of that shape."""
        if self.roots is None:
            return np.asarray(self.deviation * noise)
        return np.asarray(np.einsum("mzy,mky->mkz", self.roots, noise))

    def difference(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """``a - b`` of measurements ``(..., Z)``, the shortest way round for angles."""
        result: FloatArray = a - b
        for column in self.circular:
            result[..., column] = (result[..., column] + np.pi) % (2 * np.pi) - np.pi
        return result

    def log_likelihood(
        self, projected: FloatArray, particle: IntArray, measurements: FloatArray, which: IntArray
    ) -> FloatArray:
        """``log h(y | x)`` ``(K,)``, constants kept, of pairs of states ``(N, Z)`` as measured and of measurements
        ``(M, Z)``.

        ``particle`` and ``which`` ``(K,)`` say of which state and of which measurement each pair is.
        """
        # Column by column: rows of two or three numbers cost several times more.
        apart = [state[particle] - measured[which] for state, measured in zip(projected.T, measurements.T, strict=True)]
        for column in self.circular:
            apart[column] = (apart[column] + np.pi) % (2 * np.pi) - np.pi
        if self.roots is None:
            scaled = [column / deviation for column, deviation in zip(apart, self.deviation, strict=True)]
            constant = np.log(np.prod(np.sqrt(2 * np.pi) * self.deviation))
        else:
            inverse = np.linalg.inv(self.roots)[which]
            scaled = list(np.einsum("kzy,yk->zk", inverse, np.stack(apart)))
            diagonal = np.einsum("mzz->mz", self.roots)
            constant = np.log(np.prod(np.sqrt(2 * np.pi) * diagonal, axis=1))[which]
        squares = np.zeros(len(particle))
        for column in scaled:
            squares += column * column
        return np.asarray(-0.5 * squares - constant)


@dataclass(frozen=True)
class PointModel:
    """The random finite set state space model, Eqs. (30)-(33) and (37)-(43): all but births.

    Attributes:
        motion: draws the next states, (33).
        sensor: likelihood of a measurement, (40).
        survival: probability that a target goes on, ``pS`` in [0, 1], (32).
        detection: probability that a target is measured, ``pD`` in [0, 1], (39); a number, or a function of states.
        clutter: density ``mu_C p_C(y)`` of false measurements per unit of measurement space, >= 0, (42)-(43); a number,
            or a function of measurements.
        period: time from one observation to the next, > 0, in seconds or whatever the motion counts in. Where it
            varies, replace it before each step: filters keep nothing that depends on it.
        inside: whether states ``(N, D)`` lie where targets can be; one that moves out of there is gone. None: anywhere.
    """

    motion: Motion
    sensor: GaussianSensor
    survival: float
    detection: float | StateFunction
    clutter: float | StateFunction
    period: float = 1.0
    inside: StateTest | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.period < np.inf:
            raise ValueError(f"expected a finite period above 0, got {self.period}")
        named = {"survival": self.survival, "detection": self.detection}
        for name, value in named.items():
            if not callable(value) and not 0.0 <= value <= 1.0:
                raise ValueError(f"expected the probability of {name} in [0, 1], got {value}")
        if not callable(self.clutter) and not 0.0 <= self.clutter < np.inf:
            raise ValueError(f"expected a finite clutter density >= 0, got {self.clutter}")

    def moved(self, particles: FloatArray, rng: np.random.Generator) -> FloatArray:
        """States ``(N, D)`` one period later."""
        return self.motion(particles, self.period, rng)

    def survival_of(self, moved: FloatArray) -> FloatArray:
        """``pS`` ``(N,)`` of states ``(N, D)`` one period later: 0 where no target can be."""
        if self.inside is None:
            return np.full(len(moved), self.survival)
        return np.where(self.inside(moved), self.survival, 0.0)

    def detection_of(self, particles: FloatArray) -> FloatArray:
        """``pD`` ``(N,)`` of states ``(N, D)``."""
        if not callable(self.detection):
            return np.full(len(particles), float(self.detection))
        probability = self.detection(particles)
        if not np.all((probability >= 0) & (probability <= 1)):
            raise ValueError("expected probabilities of detection in [0, 1]")
        return probability

    def clutter_at(self, measurements: FloatArray) -> FloatArray:
        """``mu_C p_C(y)`` ``(M,)`` at measurements ``(M, Z)``."""
        if callable(self.clutter):
            return self.clutter(measurements)
        return np.full(len(measurements), float(self.clutter))


def check_measurements(measurements: FloatArray, columns: int) -> FloatArray:
    """Measurements as a finite ``(M, columns)`` float64 array; M may be zero.

    Raises:
        ValueError: the shape is another, or a value is not finite.
    """
    measurements = np.asarray(measurements, dtype=np.float64)
    if measurements.size == 0:
        return np.empty((0, columns))
    if measurements.ndim != 2 or measurements.shape[1] != columns:
        raise ValueError(f"expected measurements of shape (M, {columns}), got {measurements.shape}")
    bad = ~np.isfinite(measurements).all(axis=1)
    if bad.any():
        raise ValueError(f"expected finite measurements, got {measurements[bad][0].tolist()} at row {np.argmax(bad)}")
    return measurements


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
