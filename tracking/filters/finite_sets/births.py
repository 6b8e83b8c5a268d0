"""Where new targets come from: draws of the birth intensity ``D_Gamma``, equations (34)-(36) and (50)-(52).

The weights of what is drawn sum, in expectation over the draws, to the expected number of births in the region that the
proposal covers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.base import BornParticles
from tsuiseki.tracking.filters.finite_sets.pairs import find_pairs, groups_near
from tsuiseki.tracking.filters.finite_sets.point_model import GaussianSensor, StateFunction
from tsuiseki.tracking.filters.resampling import logarithms
from tsuiseki.tracking.types import FloatArray, IntArray

QUIET = 0.1
"""Share of the particles at a place of birth near which nothing was measured."""


@dataclass(frozen=True)
class MixtureBirths:
    """Births at known places, Eqs. (34)-(36) and (50)-(51): a Gaussian mixture intensity, drawn from itself.

    Attributes:
        masses: ``(B,)`` expected births a step at each place, >= 0.
        means: ``(B, D)``.
        deviations: ``(D,)`` or ``(B, D)`` standard deviations.
        count: particles drawn at each place. The paper draws ``rho`` times its mass; more describe a rare target by
            more than a handful.
        sensor: where it is given, a place near which nothing was measured gets `QUIET` of them only, of more weight
            each: the proposal may use the measurements.
        modes: motions that take turns, each as likely at first; from 2 on the last component is the number of one.
    """

    masses: FloatArray
    means: FloatArray
    deviations: FloatArray
    count: int = 1000
    sensor: GaussianSensor | None = None
    modes: int = 1

    def draw(self, measurements: FloatArray, rng: np.random.Generator) -> BornParticles:
        """Up to ``count`` particles at each place."""
        places = len(self.means)
        masses = np.asarray(self.masses, dtype=np.float64)
        if self.sensor is None:
            weights = logarithms(np.repeat(masses / self.count, self.count))
            everywhere = np.full(places, self.count)
            return BornParticles(self._drawn(everywhere, rng), weights, np.arange(places) * self.count)
        few = max(round(QUIET * self.count), 1)
        first = self._drawn(np.full(places, few), rng)
        near = groups_near(first, np.arange(places) * few, measurements, self.sensor)
        sizes = np.where(near, self.count, few)
        starts = np.cumsum(sizes) - sizes
        particles = np.empty((int(sizes.sum()), first.shape[1]))
        early = np.arange(len(particles)) - np.repeat(starts, sizes) < few
        particles[early], particles[~early] = first, self._drawn(sizes - few, rng)
        return BornParticles(particles, logarithms(np.repeat(masses / sizes, sizes)), starts)

    def _drawn(self, sizes: IntArray, rng: np.random.Generator) -> FloatArray:
        """So many particles ``(sizes.sum(), D)`` at each place, one place after the other."""
        spread = np.broadcast_to(self.deviations, self.means.shape)
        drawn = rng.standard_normal((int(sizes.sum()), self.means.shape[1]))
        drawn *= np.repeat(spread, sizes, axis=0)
        drawn += np.repeat(self.means, sizes, axis=0)
        if self.modes > 1:
            drawn[:, -1] = rng.integers(0, self.modes, len(drawn))
        return drawn


@dataclass(frozen=True)
class MeasurementBirths:
    """Births anywhere, drawn where the measurements are (Ristic, Clark, Vo and Vo, 2012).

    The intensity is uniform over the measured space and, for what is not measured, a given prior; the proposal puts
    particles around each measurement by the sensor's errors. The weight is the ratio of the two, Eq. (52).

    Attributes:
        density: expected births a step per unit of measurement space, > 0.
        sensor: whose errors spread the proposal.
        complete: makes states ``(K, D)`` from error-free measurements ``(K, Z)`` and draws the rest of the prior.
        columns: length of a state.
        count: particles around each measurement.
        limit: particles around all measurements together.
    """

    density: float
    sensor: GaussianSensor
    complete: Callable[[FloatArray, np.random.Generator], FloatArray]
    columns: int
    count: int = 200
    limit: int = 20_000

    def draw(self, measurements: FloatArray, rng: np.random.Generator) -> BornParticles:
        """Particles around each measurement."""
        total, width = len(measurements), measurements.shape[1]
        if total == 0:
            return BornParticles(np.empty((0, self.columns)), np.empty(0), np.empty(0, dtype=np.int64))
        # Fewer around each where there are hundreds, which may all lie within one gate.
        count = min(self.count, max(self.limit // total, 1))
        noise = self.sensor.spread(rng.standard_normal((total, count, width)))
        places = (measurements[:, None, :] + noise).reshape(-1, width)
        particles = self.complete(places, rng)
        starts = np.arange(total) * count
        pairs = find_pairs(particles, starts, measurements, self.sensor)
        proposal = pairs.by_particle(np.exp(pairs.log_likelihood), len(particles)) * count
        weights = np.divide(self.density, proposal, out=np.zeros(len(particles)), where=proposal > 0)
        return BornParticles(particles, logarithms(weights), starts)


def newborn(
    invert: StateFunction, dimensions: int, speed: float, turn: float | None = None, modes: int = 1
) -> Callable[[FloatArray, np.random.Generator], FloatArray]:
    """States at measured places: the ``complete`` of `MeasurementBirths`.

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
