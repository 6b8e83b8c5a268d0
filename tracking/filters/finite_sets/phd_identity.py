"""Identities in the PHD filter, section 5.2 of the finite-sets paper.

A cluster is the particles of one label. After each update the labels are put in order:

1. Claim: a measurement that is probably a target takes one label, one to one, and the particles that explain it best
   get that label. A cluster over two targets is parted in this way. (Not in the paper: ``claim=False``.)
2. Join: two clusters near each other that weigh about one together get the older label. Births have labels of their
   own until then. (The paper also gives each particle that was born near a cluster its label: ``adopt=True``.)
3. Part: a cluster that weighs about two or more is cut into as many clusters.

A target is reported where the weight is near one: one for each cluster (`by_clusters`), or one for each measurement
(`by_measurements`, Ristic, Clark and Vo, 2010).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.filters.base import TargetEstimates
from tsuiseki.tracking.filters.finite_sets.labelled_particles import (
    LabelledParticles,
    cluster_moments,
    cluster_sizes,
    cluster_starts,
)
from tsuiseki.tracking.filters.finite_sets.pairs import Pairs
from tsuiseki.tracking.filters.finite_sets.point_models import GaussianSensor, PointModel
from tsuiseki.tracking.types import FloatArray, IntArray

REPORTED = 0.5
"""Least weight that counts as near one."""


@dataclass(frozen=True)
class Clusters:
    """How the update shared the measurements out.

    Attributes:
        starts: ``(G,)`` first particle of each group of one label.
        pairs: gated pairs of groups and measurements.
        share: ``(E,)`` part of each measurement's unit that each entry of ``pairs`` received.
        measurements: ``(M, Z)``.
        claimed: ``(M,)`` label of the target that each measurement is, 0 for none.
        fresh: labels from this one on were made by parting in this step and are not reported yet. A cluster of one
            target weighs about two when clutter falls beside it, so what was parted has to be found again first.
        provisional: labels from this one on were given to what was born in this step, (62).
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
    """Targets that were reported, so that one missed measurement does not end them.

    Attributes:
        labels: ``(H,)``.
        existence: ``(H,)`` probabilities.
    """

    labels: IntArray
    existence: FloatArray

    @classmethod
    def empty(cls) -> Memory:
        """No target."""
        return cls(np.empty(0, dtype=np.int64), np.empty(0))


@dataclass(frozen=True)
class PhdState(LabelledParticles):
    """The posterior intensity, and the targets reported.

    Attributes:
        memory: what was reported.
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
    """One target for each measurement that the particles explain better than not: the mean under that measurement."""
    pairs, count = clusters.pairs, len(clusters.measurements)
    masses = pairs.by_measurement(clusters.share, count)
    shown = np.flatnonzero((masses > REPORTED) & (clusters.claimed > 0) & (clusters.claimed < clusters.fresh))
    states = np.zeros((len(shown), posterior.particles.shape[1]))
    for column, values in enumerate(posterior.particles.T):
        states[:, column] = pairs.by_measurement(clusters.share * values[pairs.particle], count)[shown] / masses[shown]
    return TargetEstimates(clusters.claimed[shown], states, masses[shown])


@dataclass(frozen=True)
class Identity:
    """The rules of section 5.2.

    Attributes:
        near: two clusters are near when their means are closer than this, in deviations of the sensor.
        whole: two near clusters join when they weigh less than this together; one is parted when it weighs more.
        remember: report a target through a missed measurement; without it a target is reported by its weight alone.
        confirm: report what was parted in this step only when it is found again.
        claim: measurements claim particles, one label each. `by_measurements` needs it.
        adopt: a particle that was born near the mean of a cluster takes the label of the nearest, as printed; without
            it births join as a cluster.
    """

    near: float = 2.0
    whole: float = 1.5
    remember: bool = True
    confirm: bool = True
    claim: bool = True
    adopt: bool = False

    def recall(
        self, memory: Memory, estimates: TargetEstimates, posterior: PhdState, clusters: Clusters, model: PointModel
    ) -> tuple[TargetEstimates, Memory]:
        """Adds the targets that were reported before and probably only went unmeasured.

        A miss leaves ``1 - pD`` of a cluster's weight whatever the weight was, since the intensity is that of a Poisson
        number of targets. A cluster with an identity is one target or none: its existence ``r`` falls to
        ``r (1 - pD) / (1 - r pD)``, and rises with the share of the measurements that it receives.
        """
        starts = clusters.starts
        names, (_, means) = posterior.labels[starts], cluster_moments(posterior, starts)
        before = np.zeros(len(names))
        known = np.isin(memory.labels, names)
        before[np.searchsorted(names, memory.labels[known])] = memory.existence[known]
        before *= model.survival
        detection = model.detection_of(means)
        missed = before * (1.0 - detection) / np.maximum(1.0 - before * detection, np.finfo(np.float64).tiny)
        cluster = np.repeat(np.arange(len(names)), cluster_sizes(starts, len(posterior)))[clusters.pairs.particle]
        fed = np.bincount(cluster, clusters.share, minlength=len(names)).clip(0.0, 1.0)
        existence = fed + (1.0 - fed) * missed
        there = (existence > REPORTED) & ((before > 0) | np.isin(names, estimates.ids))
        added = there & ~np.isin(names, estimates.ids)
        joined = TargetEstimates(
            np.concatenate([estimates.ids, names[added]]),
            np.concatenate([estimates.states, means[added]]),
            np.concatenate([estimates.weights, existence[added]]),
        )
        return joined, Memory(names[there], existence[there])

    def tidy(self, posterior: PhdState, clusters: Clusters, sensor: GaussianSensor) -> tuple[PhdState, Clusters]:
        """Labels after claiming, joining and parting; particles come back grouped by label."""
        claimed = np.zeros(len(clusters.measurements), dtype=np.int64)
        if self.claim:
            labels, claimed, fresh = _claim(posterior, clusters)
            posterior, clusters = _grouped(replace(posterior, labels=labels, next_label=fresh), clusters)
        if self.adopt:
            labels = self._adopted(posterior, clusters, sensor)
            posterior, clusters = _grouped(replace(posterior, labels=labels), clusters)
        target = self._join(posterior, clusters.starts, claimed, sensor)
        renamed = dict(zip(posterior.labels[clusters.starts].tolist(), target.tolist(), strict=True))
        claimed = np.array([renamed.get(int(label), 0) for label in claimed], dtype=np.int64)
        labels, fresh = self._part(posterior, clusters.starts, target)
        posterior, clusters = _grouped(replace(posterior, labels=labels, next_label=fresh), clusters)
        return posterior, replace(clusters, claimed=claimed, fresh=clusters.fresh if self.confirm else fresh)

    def _adopted(self, posterior: PhdState, clusters: Clusters, sensor: GaussianSensor) -> IntArray:
        """Labels ``(N,)`` after each newborn particle took that of the nearest older cluster, where it is near."""
        starts, labels = clusters.starts, posterior.labels
        old = starts[labels[starts] < clusters.provisional]
        born = np.flatnonzero(labels >= clusters.provisional)
        if len(old) == 0 or len(born) == 0:
            return labels
        _, means = cluster_moments(posterior, starts)
        centres = sensor.project(means[: len(old)])
        places = sensor.project(posterior.particles[born])
        apart = sensor.difference(places[:, None, :], centres[None, :, :]) / sensor.deviation
        distance = np.sqrt(np.sum(apart**2, axis=2))
        nearest = np.argmin(distance, axis=1)
        near = distance[np.arange(len(born)), nearest] < self.near
        taken = labels.copy()
        taken[born[near]] = labels[old][nearest[near]]
        return taken

    def _join(self, posterior: PhdState, starts: IntArray, claimed: IntArray, sensor: GaussianSensor) -> IntArray:
        """New label of each cluster: two near ones that weigh about one together take the older label, the nearest pair
        first.

        Two clusters that measurements claimed are two targets, and stay apart.
        """
        masses, means = cluster_moments(posterior, starts)
        target = posterior.labels[starts].copy()
        projected = sensor.project(means) if len(means) else np.empty((0, len(sensor.deviation)))
        apart = sensor.difference(projected[:, None, :], projected[None, :, :]) / sensor.deviation
        distance = np.sqrt(np.sum(apart**2, axis=2))
        taken = np.isin(target, claimed)
        allowed = np.tril((distance < self.near) & ~(taken[:, None] & taken), k=-1)
        if not allowed.any():
            return target
        # Each looks at the nearest of the older ones.
        nearest = np.argmin(np.where(allowed, distance, np.inf), axis=1)
        younger = np.flatnonzero(allowed.any(axis=1))
        for group in younger[np.argsort(distance[younger, nearest[younger]], kind="stable")]:
            low, high = sorted((int(target[nearest[group]]), int(target[group])))
            joined = (target == low) | (target == high)
            if low != high and masses[joined].sum() < self.whole and taken[joined].sum() < 2:
                target[joined] = low
        return target

    def _part(self, posterior: PhdState, starts: IntArray, target: IntArray) -> tuple[IntArray, int]:
        """Labels after joining, where heavy clusters were cut across their longest axis; and the next free label.

        A cluster is cut into as many equal parts as it weighs.
        """
        sizes, fresh = cluster_sizes(starts, len(posterior)), posterior.next_label
        labels, weights = np.repeat(target, sizes), np.exp(posterior.log_weights)
        names, cluster = np.unique(target, return_inverse=True)
        masses = np.bincount(cluster, np.add.reduceat(weights, starts) if len(starts) else None)
        for heavy in np.flatnonzero(masses > self.whole):
            parts = max(round(float(masses[heavy])), 2)
            members = np.flatnonzero(np.repeat(cluster == heavy, sizes))
            centred = posterior.particles[members] - np.average(posterior.particles[members], 0, weights[members])
            axis = np.linalg.eigh((weights[members, None] * centred).T @ centred)[1][:, -1]
            order = members[np.argsort(centred @ axis, kind="stable")]
            part = np.minimum(np.cumsum(weights[order]) / masses[heavy] * parts, parts - 1).astype(np.int64)
            labels[order] = np.where(part == 0, names[heavy], fresh + part - 1)
            fresh += parts - 1
        return labels, fresh


def _claim(posterior: PhdState, clusters: Clusters) -> tuple[IntArray, IntArray, int]:
    """Claiming: new labels ``(N,)``, the label ``(M,)`` that each measurement took (0 for none), the next free label.

    A measurement takes the label that gave it most, one to one, or a new one. It claims the particles that gave it more
    than they gave any other measurement and more than they kept. Particles of a claimed label that lie outside the
    gate of its measurement are another target, and get a new label.
    """
    pairs, count, particles = clusters.pairs, len(clusters.measurements), len(posterior)
    labels, fresh = posterior.labels.copy(), posterior.next_label
    claimed = np.zeros(count, dtype=np.int64)
    shown = np.flatnonzero(pairs.by_measurement(clusters.share, count) > REPORTED)
    if len(shown) == 0:
        return labels, claimed, fresh
    names = labels[clusters.starts]
    table = np.zeros((count, len(names)))
    table[pairs.measurements, pairs.groups] = pairs.sums(clusters.share)
    rows, columns = linear_sum_assignment(table[shown], maximize=True)
    own = table[shown[rows], columns] > 0
    claimed[shown[rows[own]]] = names[columns[own]]
    without = shown[claimed[shown] == 0]
    claimed[without] = fresh + np.arange(len(without))
    fresh += len(without)
    entries = np.flatnonzero(claimed[pairs.measurement] > 0)
    particle, share = pairs.particle[entries], clusters.share[entries]
    greatest = np.zeros(particles)
    np.maximum.at(greatest, particle, share)
    winner = (share == greatest[particle]) & (share > 0.5 * np.exp(posterior.log_weights[particle]))
    inside = np.zeros(particles, dtype=np.bool_)
    inside[particle[claimed[pairs.measurement[entries]] == labels[particle]]] = True
    sizes = cluster_sizes(clusters.starts, particles)
    astray = np.repeat(np.isin(names, claimed[shown]), sizes) & ~inside
    strayed = np.add.reduceat(astray, clusters.starts) > 0
    labels = np.where(astray, np.repeat(fresh - 1 + np.cumsum(strayed), sizes), labels)
    labels[particle[winner]] = claimed[pairs.measurement[entries[winner]]]
    return labels, claimed, fresh + int(strayed.sum())


def _grouped(posterior: PhdState, clusters: Clusters) -> tuple[PhdState, Clusters]:
    """The same with the particles sorted by label."""
    if np.all(posterior.labels[1:] >= posterior.labels[:-1]):
        return posterior, replace(clusters, starts=cluster_starts(posterior.labels))
    order = np.argsort(_small(posterior.labels), kind="stable")
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    state = replace(
        posterior,
        particles=posterior.particles[order],
        labels=posterior.labels[order],
        log_weights=posterior.log_weights[order],
    )
    pairs = replace(clusters.pairs, particle=back[clusters.pairs.particle])
    return state, replace(clusters, pairs=pairs, starts=cluster_starts(state.labels))


def _small(labels: IntArray) -> NDArray[np.int16] | IntArray:
    """Numbers in the order of ``labels``, of few bits where there are few labels: NumPy sorts those by their digits."""
    starts = cluster_starts(labels)
    names, rank = np.unique(labels[starts], return_inverse=True)
    if len(names) > np.iinfo(np.int16).max:
        return labels
    return np.repeat(rank.astype(np.int16), cluster_sizes(starts, len(labels)))
