"""The posterior of the PHD filter, its clusters, and the targets that are read off them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.filters.base import TargetEstimates
from tsuiseki.tracking.filters.finite_sets.labelled_particles import LabelledParticles, cluster_moments
from tsuiseki.tracking.filters.finite_sets.pairs import Pairs
from tsuiseki.tracking.types import FloatArray, IntArray

REPORTED = 0.5
"""Targets: a weight above this counts as one target."""


@dataclass(frozen=True)
class Clusters:
    """The clusters of a step, and how the update divided the measurements among their particles.

    Attributes:
        starts: ``(G,)`` first particle of each cluster.
        pairs: pairs of clusters and measurements within the gate.
        share: ``(E,)`` in [0, 1], the part of a measurement that each entry of ``pairs`` received. Over all particles
            the parts of one measurement sum to at most 1; the rest is clutter.
        measurements: ``(M, Z)`` in the units of the sensor.
        claimed: ``(M,)`` label assigned to each measurement, 0 for none.
        fresh: least label made by a split in this step. Such labels are not reported yet: clutter beside a target can
            raise the weight of its cluster to two, so the new cluster has to be measured again first.
        provisional: least label given to a birth of this step, (62).
    """

    starts: IntArray
    pairs: Pairs
    share: FloatArray
    measurements: FloatArray
    claimed: IntArray
    fresh: int
    provisional: int


@dataclass(frozen=True)
class Memory:
    """Targets reported in the step before. A target in here is not ended by one missed measurement.

    Attributes:
        labels: ``(H,)``.
        existence: ``(H,)`` probability that each exists, in [0, 1].
    """

    labels: IntArray
    existence: FloatArray

    @classmethod
    def empty(cls) -> Memory:
        """No target."""
        return cls(np.empty(0, dtype=np.int64), np.empty(0))


@dataclass(frozen=True)
class PhdState(LabelledParticles):
    """The posterior intensity, and the targets reported from it.

    Attributes:
        memory: the targets reported.
    """

    memory: Memory = field(default_factory=Memory.empty)


Extraction = Callable[[PhdState, Clusters], TargetEstimates]
"""Reads the targets off the posterior."""


def by_clusters(posterior: PhdState, clusters: Clusters) -> TargetEstimates:
    """One target for each cluster whose weight is near one: its mean."""
    masses, means = cluster_moments(posterior, clusters.starts)
    names = posterior.labels[clusters.starts]
    shown = (masses > REPORTED) & (names < clusters.fresh)
    return TargetEstimates(names[shown], means[shown], masses[shown])


def by_measurements(posterior: PhdState, clusters: Clusters) -> TargetEstimates:
    """One target for each measurement of which the particles received more than half: their mean, weighted by share."""
    pairs, count = clusters.pairs, len(clusters.measurements)
    masses = pairs.by_measurement(clusters.share, count)
    shown = np.flatnonzero((masses > REPORTED) & (clusters.claimed > 0) & (clusters.claimed < clusters.fresh))
    states = np.zeros((len(shown), posterior.particles.shape[1]))
    for column, values in enumerate(posterior.particles.T):
        states[:, column] = pairs.by_measurement(clusters.share * values[pairs.particle], count)[shown] / masses[shown]
    return TargetEstimates(clusters.claimed[shown], states, masses[shown])
