"""What a sensor measures, and the targets in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, ShortRepr


@dataclass(frozen=True, repr=False)
class Scan(ShortRepr):
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


@dataclass(frozen=True, repr=False)
class SensedTargets(ShortRepr):
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


@dataclass(frozen=True, repr=False)
class SensedTrack(ShortRepr):
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


@dataclass(frozen=True, repr=False)
class PersonOnFloor(SensedTrack):
    """A person on a floor that several sensors cover; `scans` number the moments.

    Attributes:
        detected: ``(T, S)`` which sensors detected them.
    """

    detected: BoolArray
