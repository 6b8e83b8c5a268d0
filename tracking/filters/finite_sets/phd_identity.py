"""Identities in the PHD filter, section 5.2 of the finite-sets paper.

A cluster is the set of particles with one label. The sum of its weights is the expected number of targets in it. Three
rules change the labels after each update:

1. Claim. Each measurement that is probably a target is assigned one label, one to one. The particles that explain it
   best get that label. This splits a cluster that covers two targets. The paper does not have this rule.
2. Join. Two clusters near each other with a total weight of about one get the older label. New particles keep a label
   of their own until then. The paper also gives each new particle near a cluster the label of that cluster.
3. Split. A cluster with a weight of about two or more is cut into that many clusters.

A target is reported where the weight is near one: one target for each cluster (`by_clusters`), or one for each
measurement (`by_measurements`, Ristic, Clark and Vo, 2010).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.filters.base import TargetEstimates
from tsuiseki.tracking.filters.finite_sets.clusters import (
    REPORTED,
    Clusters,
    PhdState,
    cluster_moments,
    cluster_sizes,
    cluster_starts,
    rows,
)
from tsuiseki.tracking.filters.finite_sets.point_model import GaussianSensor, PointModel
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

NEAR = 2.0
"""Two clusters may join whose means are closer than this, in standard deviations of the sensor."""
WHOLE = 1.5
"""Two clusters may join whose total weight is less than this many targets; one that weighs more is split. In (1, 2)."""


@dataclass(frozen=True)
class TrackIdentity:
    """The rules of section 5.2.

    Attributes:
        printed: as the paper has it: no rule 1, which `by_measurements` needs; a new particle near the mean of a
            cluster takes the label of the nearest one; what a split makes is reported at once; and a target is not
            reported through a missed measurement.
    """

    printed: bool = False

    def recall(
        self,
        memory: Mapping[int, float],
        estimates: TargetEstimates,
        posterior: PhdState,
        clusters: Clusters,
        model: PointModel,
    ) -> tuple[TargetEstimates, Mapping[int, float]]:
        """Add the targets that were reported before and now probably missed a measurement.

        A missed measurement multiplies the weight of a cluster by ``1 - pD``, because the intensity describes a Poisson
        number of targets. But a cluster with an identity is one target or none. Its probability of existence ``r``
        falls to ``r (1 - pD) / (1 - r pD)`` only, and rises with the share of measurements that it receives.

        ``memory`` is of the step before, ``estimates`` are what the weights report, the others are of this step.
        """
        starts, sizes = clusters.starts, cluster_sizes(clusters.starts, len(posterior))
        names = posterior.labels[starts]
        prior = np.array([memory.get(name, 0.0) for name in names.tolist()])
        if model.inside is None:
            prior *= model.survival
        else:
            # What moved out of there weighs nothing now, so its share is that of the numbers.
            prior *= np.add.reduceat(model.survival_of(posterior.particles), starts) / sizes
        _, means = cluster_moments(posterior, starts)
        detection = model.detection_of(means)
        missed = prior * (1.0 - detection) / np.maximum(1.0 - prior * detection, np.finfo(np.float64).tiny)
        cluster = np.repeat(np.arange(len(names)), sizes)[clusters.pairs.particle]
        fed = np.bincount(cluster, clusters.share, minlength=len(names)).clip(0.0, 1.0)
        existence = fed + (1.0 - fed) * missed
        reported = _among(names, estimates.ids)
        there = (existence > REPORTED) & ((prior > 0) | reported)
        added = there & ~reported
        recalled = TargetEstimates(names[added], means[added], existence[added])
        return estimates.and_then(recalled), dict(zip(names[there].tolist(), existence[there].tolist(), strict=True))

    def tidy(self, posterior: PhdState, clusters: Clusters, sensor: GaussianSensor) -> tuple[PhdState, Clusters]:
        """The posterior after the three rules, its particles grouped by label; and its clusters."""
        labels, fresh = posterior.labels, posterior.next_label
        claimed = np.zeros(len(clusters.measurements), dtype=np.int64)
        if self.printed:
            posterior, clusters = _grouped(posterior, clusters)
            labels = self._adopted(posterior, clusters, sensor)
        else:
            labels, claimed, fresh = _claim(posterior, clusters)
        names, cluster = np.unique(labels, return_inverse=True)
        posterior, clusters = _grouped(replace(posterior, labels=labels, next_label=fresh), clusters, cluster)
        masses, means = cluster_moments(posterior, clusters.starts)
        target = self._join(names, masses, means, claimed, sensor)
        if (target != names).any():
            renamed = dict(zip(names.tolist(), target.tolist(), strict=True))
            claimed = np.array([renamed.get(int(label), 0) for label in claimed], dtype=np.int64)
            labels = np.repeat(target, cluster_sizes(clusters.starts, len(posterior)))
            posterior, clusters = _grouped(replace(posterior, labels=labels), clusters)
        labels, next_label = self._part(posterior, clusters.starts)
        if next_label > fresh:
            posterior, clusters = _grouped(replace(posterior, labels=labels, next_label=next_label), clusters)
        return posterior, replace(clusters, claimed=claimed, fresh=next_label if self.printed else clusters.fresh)

    def _adopted(self, posterior: PhdState, clusters: Clusters, sensor: GaussianSensor) -> IntArray:
        """Labels ``(N,)`` after each new particle took the label of the nearest older cluster, if that is near."""
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
        near = distance[np.arange(len(born)), nearest] < NEAR
        adopted = labels.copy()
        adopted[born[near]] = labels[old][nearest[near]]
        return adopted

    def _join(
        self, names: IntArray, masses: FloatArray, means: FloatArray, claimed: IntArray, sensor: GaussianSensor
    ) -> IntArray:
        """Rule 2: the new label ``(G,)`` of each cluster. The nearest pair joins first.

        Two clusters whose labels are both assigned to measurements are two targets, and do not join.
        """
        target = names.copy()
        projected = sensor.project(means) if len(means) else np.empty((0, len(sensor.deviation)))
        apart = sensor.difference(projected[:, None, :], projected[None, :, :]) / sensor.deviation
        distance = np.sqrt(np.sum(apart**2, axis=2))
        assigned = _among(target, claimed)
        allowed = np.tril((distance < NEAR) & ~(assigned[:, None] & assigned), k=-1)
        if not allowed.any():
            return target
        # Each takes the nearest of the older ones.
        nearest = np.argmin(np.where(allowed, distance, np.inf), axis=1)
        younger = np.flatnonzero(allowed.any(axis=1))
        for group in younger[np.argsort(distance[younger, nearest[younger]], kind="stable")]:
            low, high = sorted((int(target[nearest[group]]), int(target[group])))
            joined = (target == low) | (target == high)
            if low != high and masses[joined].sum() < WHOLE and assigned[joined].sum() < 2:
                target[joined] = low
        return target

    def _part(self, posterior: PhdState, starts: IntArray) -> tuple[IntArray, int]:
        """Rule 3: the labels ``(N,)`` of the particles, and the next free label.

        A heavy cluster is cut across its longest axis, into parts of equal weight, about one each.
        """
        labels, fresh = posterior.labels, posterior.next_label
        weights = posterior.weights
        masses = np.add.reduceat(weights, starts) if len(starts) else np.empty(0)
        ends = starts + cluster_sizes(starts, len(posterior))
        for heavy in np.flatnonzero(masses > WHOLE):
            labels = labels.copy() if labels is posterior.labels else labels
            members = slice(starts[heavy], ends[heavy])
            parts = max(round(float(masses[heavy])), 2)
            centred = posterior.particles[members] - np.average(posterior.particles[members], 0, weights[members])
            axis = np.linalg.eigh((weights[members, None] * centred).T @ centred)[1][:, -1]
            order = np.argsort(centred @ axis, kind="stable")
            part = np.minimum(np.cumsum(weights[members][order]) / masses[heavy] * parts, parts - 1).astype(np.int64)
            name = labels[starts[heavy]]
            labels[starts[heavy] + order] = np.where(part == 0, name, fresh + part - 1)
            fresh += parts - 1
        return labels, fresh


def _claim(posterior: PhdState, clusters: Clusters) -> tuple[IntArray, IntArray, int]:
    """Rule 1: new labels ``(N,)``, the label ``(M,)`` of each measurement (0 for none), and the next free label.

    A measurement is assigned the label from which most of its weight comes, one to one, or a new label. Its label is
    given to each particle for which this measurement has the largest share, and a share above half the particle's
    weight. Particles that have an assigned label but lie outside the gate of its measurement are another target, and
    get a new label.
    """
    pairs, count, particles = clusters.pairs, len(clusters.measurements), len(posterior)
    labels, fresh = posterior.labels.copy(), posterior.next_label
    claimed = np.zeros(count, dtype=np.int64)
    measured = np.flatnonzero(pairs.by_measurement(clusters.share, count) > REPORTED)
    if len(measured) == 0:
        return labels, claimed, fresh
    names = labels[clusters.starts]
    table = np.zeros((count, len(names)))
    table[pairs.measurements, pairs.groups] = pairs.sums(clusters.share)
    rows, columns = linear_sum_assignment(table[measured], maximize=True)
    supported = table[measured[rows], columns] > 0
    claimed[measured[rows[supported]]] = names[columns[supported]]
    without = measured[claimed[measured] == 0]
    claimed[without] = fresh + np.arange(len(without))
    fresh += len(without)
    entries = np.flatnonzero(claimed[pairs.measurement] > 0)
    particle, share = pairs.particle[entries], clusters.share[entries]
    greatest = np.zeros(particles)
    np.maximum.at(greatest, particle, share)
    winner = (share == greatest[particle]) & (share > 0.5 * posterior.weights[particle])
    inside = np.zeros(particles, dtype=np.bool_)
    inside[particle[claimed[pairs.measurement[entries]] == labels[particle]]] = True
    sizes = cluster_sizes(clusters.starts, particles)
    astray = np.repeat(_among(names, claimed[measured]), sizes) & ~inside
    strayed = np.add.reduceat(astray, clusters.starts) > 0
    labels = np.where(astray, np.repeat(fresh - 1 + np.cumsum(strayed), sizes), labels)
    labels[particle[winner]] = claimed[pairs.measurement[entries[winner]]]
    return labels, claimed, fresh + int(strayed.sum())


def _grouped(posterior: PhdState, clusters: Clusters, key: IntArray | None = None) -> tuple[PhdState, Clusters]:
    """The same with the particles sorted by label, or by a ``key`` ``(N,)`` that sorts them by label, too."""
    key = posterior.labels if key is None else key
    if np.all(key[1:] >= key[:-1]):
        return posterior, replace(clusters, starts=cluster_starts(posterior.labels))
    order = np.argsort(key, kind="stable")
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    state = replace(
        posterior,
        particles=rows(posterior.particles, order),
        labels=posterior.labels[order],
        log_weights=posterior.log_weights[order],
    )
    pairs = replace(clusters.pairs, particle=back[clusters.pairs.particle])
    return state, replace(clusters, pairs=pairs, starts=cluster_starts(state.labels))


def _among(values: IntArray, few: IntArray) -> BoolArray:
    """Whether each of some tens of values is one of a few; several times faster than `numpy.isin` then."""
    return np.asarray((values[:, None] == few).any(axis=1))
