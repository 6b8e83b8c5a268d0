"""The SMC-PHD filter: the expected number of targets in every region, carried by weighted particles.

Equations (44)-(59) of the finite-sets paper. Weights are absolute: their sum is the expected number of targets, so
every likelihood keeps its constants. The update (45) is printed with a proportionality sign; it is an equality, as (53)
has it, or the sum would mean nothing.

Particles carry labels (60)-(62); :mod:`tsuiseki.tracking.filters.phd_identity` keeps the labels and reads tracks off.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from tsuiseki.tracking.filters.pairs import Pairs, find_pairs
from tsuiseki.tracking.filters.phd_identity import Clusters, Extraction, Identity, Memory, by_measurements, group_starts
from tsuiseki.tracking.filters.point_births import Births
from tsuiseki.tracking.filters.point_models import PointModel, check_measurements
from tsuiseki.tracking.filters.points import PointEstimates
from tsuiseki.tracking.filters.resampling import Resampler, systematic
from tsuiseki.tracking.types import FloatArray, IntArray


class SurvivalProposal(Protocol):
    """Draws ``q_S(. | x, Y)`` of (48): the particles ``(N, D)`` moved, and ``log f - log q_S`` ``(N,)`` of (49)."""

    def __call__(
        self, particles: FloatArray, measurements: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]: ...


@dataclass(frozen=True)
class PhdState:
    """The posterior intensity, (60).

    Attributes:
        particles: ``(N, D)``, those of one label together.
        labels: ``(N,)`` positive.
        log_weights: ``(N,)``; the weights sum to the expected number of targets.
        next_label: not used yet.
        memory: what was reported.
    """

    particles: FloatArray
    labels: IntArray
    log_weights: FloatArray
    next_label: int
    memory: Memory = field(default_factory=Memory.empty)

    def __len__(self) -> int:
        return len(self.particles)

    @property
    def expected_count(self) -> float:
        """Expected number of targets."""
        return float(np.exp(self.log_weights).sum())


@dataclass(frozen=True)
class PhdInfo:
    """What one step found.

    Attributes:
        estimates: the targets and their identities.
        expected_count: sum of the weights after the update.
        posterior: the weighted particles after the update, before they are drawn anew.
        pairs: gated pairs of clusters and measurements.
    """

    estimates: PointEstimates
    expected_count: float
    posterior: PhdState
    pairs: int


@dataclass(frozen=True)
class PhdFilter:
    """Settings and step of the SMC-PHD filter.

    Attributes:
        model: motion, sensor, survival, detection and clutter.
        births: proposal of new targets with its weights, (51)-(52); it may look at the measurements.
        density: particles ``rho`` for each expected target, (50) and (56).
        proposal: of surviving particles, (48); None draws from the motion model.
        resample: one of :mod:`tsuiseki.tracking.filters.resampling`.
        identity: how clusters keep, join and part their labels, section 5.2.
        extract: reads the targets off: ``by_measurements`` or ``by_clusters``.
        most: upper bound of the particles, whatever the expected count.
        least: particles of a cluster lighter than these are worth, each of less weight; 0 draws by weight alone, (57).
        negligible: a cluster of less weight is light without that help.
    """

    model: PointModel
    births: Births
    density: int = 1000
    proposal: SurvivalProposal | None = None
    resample: Resampler = systematic
    identity: Identity = field(default_factory=Identity)
    extract: Extraction = by_measurements
    most: int = 200_000
    least: int = 200
    negligible: float = 1e-5

    def init(self, particles: FloatArray, count: float = 0.0) -> PhdState:
        """``count`` expected targets spread evenly over particles ``(N, D)``; ``(0, D)`` begins with no target.

        Raises:
            ValueError: a particle is not finite, or the count is negative or has no particle to stand on.
        """
        particles = np.asarray(particles, dtype=np.float64)
        if particles.ndim != 2 or not np.isfinite(particles).all():
            raise ValueError(f"expected finite particles of shape (N, D), got shape {particles.shape}")
        if not 0 <= count < np.inf or (count > 0) != (len(particles) > 0):
            raise ValueError(f"expected a count >= 0 with particles exactly when it is not 0, got {count}")
        log_weights = np.full(len(particles), np.log(count / len(particles)) if count else 0.0)
        return PhdState(particles, np.ones(len(particles), dtype=np.int64), log_weights, 2)

    def step(self, state: PhdState, observation: FloatArray, rng: np.random.Generator) -> tuple[PhdState, PhdInfo]:
        """One observation ``(M, Z)`` further: predict, update, read off the targets, draw anew."""
        measurements = check_measurements(observation, len(self.model.sensor.deviation))
        predicted = self._predict(state, measurements, rng)
        posterior, clusters = self._update(predicted, measurements)
        posterior, clusters = self.identity.tidy(posterior, clusters, self.model.sensor)
        estimates = self.extract(posterior, clusters)
        if self.identity.remember:
            estimates, memory = self.identity.recall(state.memory, estimates, posterior, clusters, self.model)
            posterior = replace(posterior, memory=memory)
        info = PhdInfo(estimates, posterior.expected_count, posterior, len(clusters.pairs))
        return self._resample(posterior, rng), info

    def _predict(self, state: PhdState, measurements: FloatArray, rng: np.random.Generator) -> PhdState:
        """Survivors (48)-(49) with their labels (61), then births (51)-(52) with provisional ones (62)."""
        if self.proposal is None:
            moved, correction = self.model.motion(state.particles, rng), np.zeros(len(state))
        else:
            moved, correction = self.proposal(state.particles, measurements, rng)
        with np.errstate(divide="ignore"):
            survived = np.log(self.model.survival) + correction + state.log_weights
            born = self.births.draw(measurements, rng)
            new = np.log(born.weights)
        sizes = np.diff(np.append(born.starts, len(born.particles)))
        provisional = state.next_label + np.repeat(np.arange(len(born.starts)), sizes)
        return PhdState(
            np.concatenate([moved, born.particles]),
            np.concatenate([state.labels, provisional]),
            np.concatenate([survived, new]),
            state.next_label + len(born.starts),
        )

    def _update(self, predicted: PhdState, measurements: FloatArray) -> tuple[PhdState, Clusters]:
        """Weights by (53)-(55), an equality."""
        weights, detection = np.exp(predicted.log_weights), self.model.detection_of(predicted.particles)
        starts = group_starts(predicted.labels)
        pairs = find_pairs(predicted.particles, starts, measurements, self.model.sensor)
        joint = (detection * weights)[pairs.particle] * pairs.likelihood
        share = joint / self._total(pairs, joint, measurements)[pairs.measurement]
        gained = pairs.by_particle(share, len(weights))
        with np.errstate(divide="ignore"):
            log_weights = np.log((1.0 - detection) * weights + gained)
        posterior = PhdState(predicted.particles, predicted.labels, log_weights, predicted.next_label)
        nothing = np.zeros(len(measurements), dtype=np.int64)
        return posterior, Clusters(starts, pairs, share, measurements, nothing, predicted.next_label)

    def _total(self, pairs: Pairs, joint: FloatArray, measurements: FloatArray) -> FloatArray:
        """``mu_C p_C(y) + pD C_k(y)`` ``(M,)``, the denominator of (54); never zero."""
        total = self.model.clutter_at(measurements) + pairs.by_measurement(joint, len(measurements))
        # Without clutter a measurement that no particle explains has 0 / 0: it says nothing, so its share is 0.
        return np.maximum(total, np.finfo(np.float64).tiny)

    def _resample(self, posterior: PhdState, rng: np.random.Generator) -> PhdState:
        """``rho`` particles a target, each of weight ``1 / rho``, (56)-(59); more, lighter ones in a light cluster."""
        weights, starts = np.exp(posterior.log_weights), group_starts(posterior.labels)
        masses = np.add.reduceat(weights, starts) if len(starts) else np.empty(0)
        total = float(masses.sum())
        scale = min(1.0, self.most / max(self.density * total, 1.0))
        wanted = scale * self.density * masses
        light = (wanted < self.least) & (masses >= self.negligible)
        sizes = np.diff(np.append(starts, len(weights)))
        factor = np.where(light, self.least / np.where(light, wanted, 1.0), 1.0)
        intensity = weights * np.repeat(factor, sizes)
        count = round(scale * self.density * float(intensity.sum()))
        if count == 0:
            nothing, columns = np.empty(0), posterior.particles.shape[1]
            return PhdState(
                np.empty((0, columns)), np.empty(0, dtype=np.int64), nothing, posterior.next_label, posterior.memory
            )
        drawn = self.resample(intensity, count, rng)
        kept = float(intensity.sum()) / count / np.repeat(factor, sizes)[drawn]
        return PhdState(
            posterior.particles[drawn], posterior.labels[drawn], np.log(kept), posterior.next_label, posterior.memory
        )
