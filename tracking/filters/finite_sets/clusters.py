"""Weighted particles that carry labels, section 5.2 of the finite-sets paper.

The particles of one label are a cluster: what may be one target. They stand together, so that sums over clusters are
sums over slices. In memory the numbers of one column lie together (Fortran order): motion, sensor and means go column
by column. The posterior of the PHD filter is such a set; the targets are read off its clusters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from tsuiseki.tracking.filters.base import TargetEstimates
from tsuiseki.tracking.filters.finite_sets.pairs import GatedPairs
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class LabelledParticles:
    """A posterior intensity, Eq. (60).

    Attributes:
        particles: ``(N, D)``, those of one label together.
        labels: ``(N,)`` positive, not falling.
        log_weights: ``(N,)``; the weights sum to the expected number of targets.
        next_label: the least label not used yet.
    """

    particles: FloatArray
    labels: IntArray
    log_weights: FloatArray
    next_label: int

    def __len__(self) -> int:
        return len(self.particles)

    @cached_property
    def weights(self) -> FloatArray:
        """``(N,)``, not to be changed."""
        return np.exp(self.log_weights)

    @property
    def expected_count(self) -> float:
        """Expected number of targets."""
        return float(self.weights.sum())

    def select(self, which: BoolArray | IntArray) -> Self:
        """The particles at a mask or at indices."""
        return replace(
            self, particles=rows(self.particles, which), labels=self.labels[which], log_weights=self.log_weights[which]
        )


def rows(particles: FloatArray, which: BoolArray | IntArray) -> FloatArray:
    """Particles ``(N, D)`` at a mask or at indices; the columns of the result lie together in memory."""
    indices = np.flatnonzero(which) if which.dtype == np.bool_ else which
    return np.take(particles.T, indices, axis=1).T


def joined(*parts: FloatArray) -> FloatArray:
    """Particles ``(N, D)`` one after the other; the columns of the result lie together in memory."""
    return np.concatenate([part.T for part in parts], axis=1).T


def first_particles(particles: FloatArray, count: float) -> LabelledParticles:
    """``count`` expected targets spread evenly over particles ``(N, D)`` of one label; ``(0, D)`` for no target.

    Raises:
        ValueError: a particle is not finite, or the count is negative or has no particle to stand on.
    """
    particles = np.asarray(particles, dtype=np.float64)
    if particles.ndim != 2 or not np.isfinite(particles).all():
        raise ValueError(f"expected finite particles of shape (N, D), got shape {particles.shape}")
    if not 0 <= count < np.inf or (count > 0) != (len(particles) > 0):
        raise ValueError(f"expected a count >= 0 with particles exactly when it is not 0, got {count}")
    log_weights = np.full(len(particles), np.log(count / len(particles)) if count else 0.0)
    return LabelledParticles(particles, np.ones(len(particles), dtype=np.int64), log_weights, 2)


def cluster_starts(labels: IntArray) -> IntArray:
    """First index of each run of equal labels ``(N,)``."""
    if len(labels) == 0:
        return np.empty(0, dtype=np.int64)
    return np.concatenate([[0], np.flatnonzero(labels[1:] != labels[:-1]) + 1]).astype(np.int64)


def cluster_sizes(starts: IntArray, count: int) -> IntArray:
    """Particles ``(G,)`` in each cluster, of ``count`` in all."""
    return np.diff(starts, append=count)


def cluster_moments(posterior: LabelledParticles, starts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Weight ``(G,)`` and mean ``(G, D)`` of each cluster."""
    if len(starts) == 0:
        return np.empty(0), np.empty((0, posterior.particles.shape[1]))
    weights = posterior.weights
    masses = np.add.reduceat(weights, starts)
    # Column by column: over rows of a few numbers reduceat is several times slower.
    sums = np.stack([np.add.reduceat(weights * column, starts) for column in posterior.particles.T], axis=1)
    return masses, sums / np.maximum(masses, np.finfo(np.float64).tiny)[:, None]


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
    pairs: GatedPairs
    share: FloatArray
    measurements: FloatArray
    claimed: IntArray
    fresh: int
    provisional: int


@dataclass(frozen=True)
class PhdState(LabelledParticles):
    """The posterior intensity, and the targets reported from it.

    Attributes:
        memory: probability in [0, 1] that each target exists that was reported in the step before, by its label; one in
            here is not ended by one missed measurement.
    """

    memory: Mapping[int, float] = field(default_factory=dict)


Extraction = Callable[[PhdState, Clusters], TargetEstimates]
"""Reads the targets off the posterior."""


def by_clusters(posterior: PhdState, clusters: Clusters) -> TargetEstimates:
    """One target for each cluster whose weight is near one: its mean."""
    masses, means = cluster_moments(posterior, clusters.starts)
    names = posterior.labels[clusters.starts]
    reported = (masses > REPORTED) & (names < clusters.fresh)
    return TargetEstimates(names[reported], means[reported], masses[reported])


def by_measurements(posterior: PhdState, clusters: Clusters) -> TargetEstimates:
    """One target for each measurement of which the particles received more than half: their mean, weighted by share."""
    pairs, count = clusters.pairs, len(clusters.measurements)
    masses = pairs.by_measurement(clusters.share, count)
    reported = np.flatnonzero((masses > REPORTED) & (clusters.claimed > 0) & (clusters.claimed < clusters.fresh))
    states = np.zeros((len(reported), posterior.particles.shape[1]))
    for column, values in enumerate(posterior.particles.T):
        states[:, column] = (
            pairs.by_measurement(clusters.share * values[pairs.particle], count)[reported] / masses[reported]
        )
    return TargetEstimates(clusters.claimed[reported], states, masses[reported])
