"""The SMC-PHD filter: the expected number of targets in every region, carried by weighted particles.

Equations (44)-(59) of the finite-sets paper. Weights are absolute: their sum is the expected number of targets, so
every likelihood keeps its constants. The update (45) is printed with a proportionality sign; it is an equality, as (53)
has it, or the sum would mean nothing.

Particles carry labels (60)-(62); `phd_identity` keeps the labels and reads tracks off.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tsuiseki.tracking.filters.base import Births, SetInfo
from tsuiseki.tracking.filters.finite_sets.clusters import (
    Clusters,
    Extraction,
    PhdState,
    by_measurements,
    cluster_sizes,
    cluster_starts,
    first_particles,
    joined,
)
from tsuiseki.tracking.filters.finite_sets.pairs import find_pairs
from tsuiseki.tracking.filters.finite_sets.phd_identity import TrackIdentity
from tsuiseki.tracking.filters.finite_sets.point_model import PointModel, check_measurements
from tsuiseki.tracking.filters.resampling import logarithms, systematic
from tsuiseki.tracking.types import FloatArray

LIMIT = 200_000
"""Particles at most, whatever the expected count."""
TINY = float(np.finfo(np.float64).tiny)
NEGLIGIBLE = 1e-5
"""Weight below which a light cluster is not helped by more particles."""


@dataclass(frozen=True)
class PhdInfo(SetInfo):
    """What one step found.

    Attributes:
        posterior: the weighted particles after the update, before they are drawn anew.
        log_evidence: logarithm of ``p(Y_k | Y_1:k-1)`` of (11), the predicted targets being Poisson, but for
            ``exp(-m)``, as of `labelled_multi_bernoulli.LabelledInfo`.
    """

    posterior: PhdState
    log_evidence: float


@dataclass(frozen=True)
class PhdFilter:
    """Settings and step of the SMC-PHD filter.

    Attributes:
        model: motion, sensor, survival, detection and clutter.
        births: proposal of new targets with its weights, (51)-(52); it may use the measurements.
        density: particles ``rho`` for each expected target, (50) and (56).
        identity: how clusters keep, join and part their labels, section 5.2.
        extract: reads the targets off: ``by_measurements`` or ``by_clusters``.
        smallest_cluster: particles that a light cluster keeps, each of less weight; 0 draws by weight alone, (57).
        printed: leave ``pD`` out of the sum (55), as it is printed; (46) has it.
    """

    model: PointModel
    births: Births[FloatArray]
    density: int = 1000
    identity: TrackIdentity = field(default_factory=TrackIdentity)
    extract: Extraction = by_measurements
    smallest_cluster: int = 200
    printed: bool = False

    def init(self, particles: FloatArray, count: float = 0.0) -> PhdState:
        """``count`` expected targets spread evenly over particles ``(N, D)``; ``(0, D)`` begins with no target.

        Raises:
            ValueError: a particle is not finite, or the count is negative or has no particle to stand on.
        """
        first = first_particles(particles, count)
        return PhdState(first.particles, first.labels, first.log_weights, first.next_label)

    def step(self, state: PhdState, observation: FloatArray, rng: np.random.Generator) -> tuple[PhdState, PhdInfo]:
        """One observation ``(M, Z)`` further: predict, update, read off the targets, draw anew."""
        measurements = check_measurements(observation, len(self.model.sensor.deviation))
        predicted = self._predict(state, measurements, rng)
        posterior, clusters, evidence = self._update(predicted, measurements, state.next_label)
        posterior, clusters = self.identity.tidy(posterior, clusters, self.model.sensor)
        estimates = self.extract(posterior, clusters)
        if not self.identity.printed:
            estimates, memory = self.identity.recall(state.memory, estimates, posterior, clusters, self.model)
            posterior = replace(posterior, memory=memory)
        info = PhdInfo(estimates, posterior.expected_count, posterior, evidence)
        return self._resample(posterior, rng), info

    def _predict(self, state: PhdState, measurements: FloatArray, rng: np.random.Generator) -> PhdState:
        """Eq. (44): survivors by the motion, Eqs. (48)-(49), keep their labels, Eq. (61).

        Births (51)-(52) get provisional ones, Eq. (62).
        """
        moved = self.model.moved(state.particles, rng)
        survived = logarithms(self.model.survival_of(moved)) + state.log_weights
        born = self.births.draw(measurements, rng)
        return PhdState(
            joined(moved, born.particles),
            np.concatenate([state.labels, state.next_label + born.groups]),
            np.concatenate([survived, born.log_weights]),
            state.next_label + len(born.starts),
        )

    def _update(
        self, predicted: PhdState, measurements: FloatArray, provisional: int
    ) -> tuple[PhdState, Clusters, float]:
        """Weights by Eqs. (53)-(55), which are Eqs. (45)-(47) for particles; an equality. Also the log evidence.

        (54) and (55) are printed without the ``pD`` that (46) has before the same convolution. With it the weights of
        the targets that explain a measurement sum to at most one.
        """
        weights, detection = predicted.weights, self.model.detection_of(predicted.particles)
        starts = cluster_starts(predicted.labels)
        pairs = find_pairs(predicted.particles, starts, measurements, self.model.sensor)
        joint = (detection * weights)[pairs.particle] * np.exp(pairs.log_likelihood)
        # ``mu_C p_C(y) + pD C_k(y)``, the denominator of (46); 0 / 0 without clutter says nothing, so its share is 0.
        summed = weights[pairs.particle] * np.exp(pairs.log_likelihood) if self.printed else joint
        total = self.model.clutter_at(measurements) + pairs.by_measurement(summed, len(measurements))
        share = joint / np.maximum(total, TINY)[pairs.measurement]
        gained = pairs.by_particle(share, len(weights))
        log_weights = logarithms((1.0 - detection) * weights + gained)
        posterior = PhdState(predicted.particles, predicted.labels, log_weights, predicted.next_label)
        nothing = np.zeros(len(measurements), dtype=np.int64)
        clusters = Clusters(starts, pairs, share, measurements, nothing, predicted.next_label, provisional)
        expected = (detection * weights)[predicted.labels < provisional].sum()
        return posterior, clusters, float(np.log(np.maximum(total, TINY)).sum() - expected)

    def _resample(self, posterior: PhdState, rng: np.random.Generator) -> PhdState:
        """``rho`` particles a target, each of weight ``1 / rho``, Eqs. (56)-(59); a light cluster has more, lighter."""
        weights, starts = posterior.weights, cluster_starts(posterior.labels)
        masses = np.add.reduceat(weights, starts) if len(starts) else np.empty(0)
        total = float(masses.sum())
        scale = min(1.0, LIMIT / max(self.density * total, 1.0))
        sizes_by_weight = scale * self.density * masses
        light = (sizes_by_weight < self.smallest_cluster) & (masses >= NEGLIGIBLE)
        sizes = cluster_sizes(starts, len(weights))
        factor = np.where(light, self.smallest_cluster / np.where(light, sizes_by_weight, 1.0), 1.0)
        intensity = weights * np.repeat(factor, sizes)
        count = round(scale * self.density * float(intensity.sum()))
        if count == 0:
            return posterior.select(np.empty(0, dtype=np.int64))
        drawn = systematic(intensity, count, rng)
        new_weights = float(intensity.sum()) / count / np.repeat(factor, sizes)[drawn]
        return replace(posterior.select(drawn), log_weights=np.log(new_weights))
