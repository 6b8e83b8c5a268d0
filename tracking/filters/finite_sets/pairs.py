"""Likelihoods of particles and measurements, only where the two are near each other.

Particles stand in contiguous *groups* (the particles of one track, one cluster or one birth place). A group and a
measurement are a pair when the measurement lies within the sensor's gate of the group's bounding box, so the cost
follows the pairs that matter and not particles times measurements.

The marginal probabilities of a one-to-one association come from loopy belief propagation (Williams and Lau, 2014).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import rel_entr, xlogy

from tsuiseki.tracking.filters.finite_sets.point_model import GaussianSensor
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class GatedPairs:
    """Gated pairs of groups and measurements, and their entries: one for each particle of each pair.

    Attributes:
        groups: ``(K,)`` group of each pair.
        measurements: ``(K,)`` measurement of each pair.
        starts: ``(K,)`` first entry of each pair.
        particle: ``(E,)`` particle of each entry.
        measurement: ``(E,)`` measurement of each entry.
        log_likelihood: ``(E,)`` logarithm of the density ``h(y | x)``.
    """

    groups: IntArray
    measurements: IntArray
    starts: IntArray
    particle: IntArray
    measurement: IntArray
    log_likelihood: FloatArray

    def __len__(self) -> int:
        return len(self.groups)

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums over each pair ``(K, ...)`` of values per entry ``(E, ...)``."""
        if len(self) == 0:
            return np.zeros((0, *values.shape[1:]))
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))

    def by_measurement(self, values: FloatArray, count: int) -> FloatArray:
        """Sums ``(count,)`` over the entries of each measurement."""
        return np.bincount(self.measurements, self.sums(values), minlength=count).astype(np.float64)

    def by_particle(self, values: FloatArray, count: int) -> FloatArray:
        """Sums ``(count,)`` over the entries of each particle."""
        return np.bincount(self.particle, values, minlength=count).astype(np.float64)


def find_pairs(particles: FloatArray, starts: IntArray, measurements: FloatArray, sensor: GaussianSensor) -> GatedPairs:
    """The gated pairs of groups and measurements.

    Args:
        particles: ``(N, D)``, group after group.
        starts: ``(G,)`` first particle of each group, increasing from 0; no group is empty.
        measurements: ``(M, Z)``.
        sensor: gives the likelihood and the gate.
    """
    if len(particles) == 0 or len(measurements) == 0:
        nothing = np.empty(0, dtype=np.int64)
        return GatedPairs(nothing, nothing, nothing, nothing, nothing, np.empty(0))
    projected = sensor.project(particles)
    groups, chosen = _gate(projected, starts, measurements, sensor)
    sizes = np.diff(np.append(starts, len(particles)))[groups]
    first = np.cumsum(sizes) - sizes
    particle = np.repeat(starts[groups] - first, sizes) + np.arange(int(sizes.sum()))
    measurement = np.repeat(chosen, sizes)
    log_likelihood = sensor.log_likelihood(projected, particle, measurements, measurement)
    return GatedPairs(groups, chosen, first, particle, measurement, log_likelihood)


def groups_near(particles: FloatArray, starts: IntArray, measurements: FloatArray, sensor: GaussianSensor) -> BoolArray:
    """``(G,)`` whether a measurement is gated with each group; arguments as `find_pairs`."""
    near = np.zeros(len(starts), dtype=np.bool_)
    if len(starts) and len(measurements):
        near[_gate(sensor.project(particles), starts, measurements, sensor)[0]] = True
    return near


def _gate(
    projected: FloatArray, starts: IntArray, measurements: FloatArray, sensor: GaussianSensor
) -> tuple[IntArray, IntArray]:
    """Group and measurement of each pair: bounding boxes about each group's first particle, so angles may wrap."""
    reference = projected[starts]
    sizes = np.diff(np.append(starts, len(projected)))
    offset = sensor.difference(projected, np.repeat(reference, sizes, axis=0))
    reach = sensor.gate * sensor.deviations(len(measurements))
    columns = [np.ascontiguousarray(column) for column in offset.T]
    low = np.stack([np.minimum.reduceat(column, starts) for column in columns], axis=1)
    high = np.stack([np.maximum.reduceat(column, starts) for column in columns], axis=1)
    distance = sensor.difference(measurements[None, :, :], reference[:, None, :])
    inside = np.all((distance >= low[:, None, :] - reach) & (distance <= high[:, None, :] + reach), axis=2)
    groups, chosen = np.nonzero(inside)
    return groups.astype(np.int64), chosen.astype(np.int64)


def draw_by_measurement(
    pairs: GatedPairs, joint: FloatArray, mass: FloatArray, count: int, rng: np.random.Generator
) -> IntArray:
    """Indices of particles ``(M, count)`` drawn for each measurement in proportion to ``joint`` of its entries.

    One systematic draw over all measurements at once: entries in the order of their measurement, each measurement's
    weights scaled to sum to one.
    """
    drawn = np.zeros((len(mass), count), dtype=np.int64)
    measured = np.flatnonzero(mass > 0)
    if len(measured) == 0:
        return drawn
    order = np.argsort(pairs.measurement, kind="stable")
    measurement = pairs.measurement[order]
    row = np.searchsorted(measured, measurement)
    useful = mass[measurement] > 0
    order, measurement, row = order[useful], measurement[useful], row[useful]
    cumulative = np.cumsum(joint[order] / mass[measurement])
    ends = np.append(np.flatnonzero(np.diff(measurement)), len(measurement) - 1)
    # Within a measurement the cumulative weight runs from its row number to the next; made exact at both ends.
    base = np.concatenate([[0.0], cumulative[ends[:-1]]])
    within = (cumulative - base[row]) / (cumulative[ends] - base)[row]
    places = np.ceil(count * np.clip(within, 0.0, 1.0) - rng.random(len(measured))[row]).clip(0, count)
    places[ends] = count
    copies = np.diff(row * count + places, prepend=0).astype(np.int64)
    drawn[measured] = np.repeat(pairs.particle[order], copies).reshape(len(measured), count)
    return drawn


SMALLEST = 1e-100
"""Stands for a weight of zero, so that a certain association does not divide by zero."""
ITERATIONS = 200
"""Rounds of messages at most."""


def association_marginals(
    detected: FloatArray, missed: FloatArray, unclaimed: FloatArray, tolerance: float = 1e-4
) -> tuple[FloatArray, FloatArray]:
    """Probability of each pair when every target has at most one measurement and every measurement at most one target.

    The joint weight of an association is the product of ``detected`` over its pairs, ``missed`` over the targets
    without a measurement and ``unclaimed`` over the measurements without a target. The result is exact where the pairs
    of positive weight form no loop.

    Args:
        detected: ``(T, M)`` weights >= 0.
        missed: ``(T,)`` weights >= 0.
        unclaimed: ``(M,)`` weights >= 0.
        tolerance: largest relative change of a message at the end, which takes `ITERATIONS` at most.

    Returns:
        ``(T, M)`` probabilities of the pairs and ``(T,)`` of no measurement; each row sums to one together with it.
    """
    missed, unclaimed = np.maximum(missed, SMALLEST), np.maximum(unclaimed, SMALLEST)
    back = np.broadcast_to(1.0 / unclaimed, detected.shape)
    for _ in range(ITERATIONS):
        claim = detected * back
        forth = detected / (missed[:, None] + claim.sum(axis=1, keepdims=True) - claim + SMALLEST)
        new = 1.0 / (unclaimed + forth.sum(axis=0) - forth).clip(SMALLEST)
        change = np.max(np.abs(np.log(new / back)), initial=0.0)
        back = new
        if change <= tolerance:
            break
    claim = detected * back
    total = missed + claim.sum(axis=1)
    return claim / total[:, None], missed / total


def association_evidence(
    detected: FloatArray, missed: FloatArray, unclaimed: FloatArray, claimed: FloatArray, none: FloatArray
) -> float:
    """Logarithm of the summed weight of all associations, by Bethe's free energy of their marginals.

    It is exact where the pairs of positive weight form no loop, and elsewhere at most the true one (Vontobel, "The
    Bethe permanent of a non-negative matrix", 2013).

    Args:
        detected, missed, unclaimed: as of `association_marginals`.
        claimed: ``(T, M)`` and
        none: ``(T,)`` probabilities as it returns them.
    """
    missed, unclaimed = np.maximum(missed, SMALLEST), np.maximum(unclaimed, SMALLEST)
    free = np.clip(1.0 - claimed.sum(axis=0), 0.0, 1.0)
    # The relative entropy of each choice to its weight, less what the two ends of a pair have twice.
    pairs = rel_entr(claimed, detected)[claimed > 0].sum() - xlogy(1.0 - claimed, 1.0 - claimed).sum()
    return float(-pairs - rel_entr(none, missed).sum() - rel_entr(free, unclaimed).sum())
