"""Particle filters: bootstrap and guided; thesis eq. 2.9, and the likelihood of a model (11) by (23).

See `tsuiseki.tracking.filters.base` for the contract. ``ParticleFilter.step`` is (14)-(20) of the finite-sets paper:
resample when the effective sample size is low, propose, weigh. Resampling stands at the start of the step (it is the
same algorithm as at the end of the last one), so that estimates are taken from weighted particles, before resampling
adds its noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numpy as np

from tsuiseki.tracking.filters.base import LogLikelihood, Observation, Proposal
from tsuiseki.tracking.filters.resampling import (
    effective_sample_size,
    log_sum,
    normalise,
    probabilities,
    systematic,
)
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class ParticleState:
    """Weighted particles, Eq. (12).

    Attributes:
        particles: ``(N, D)``.
        log_weights: ``(N,)`` whose weights sum to one.
    """

    particles: FloatArray
    log_weights: FloatArray

    def __len__(self) -> int:
        return len(self.particles)


@dataclass(frozen=True)
class ParticleInfo:
    """What happened in one step.

    Attributes:
        log_evidence: logarithm of ``p(y_k | y_1:k-1)``; ``-inf`` when no particle explains the observation.
        effective_sample_size: after weighing, in [1, N].
        resampled: whether particles were drawn anew before they moved.
    """

    log_evidence: float
    effective_sample_size: float
    resampled: bool


@dataclass(frozen=True)
class ParticleFilter(Generic[Observation]):
    """A particle filter, equations (12)-(22) of the finite-sets paper.

    Attributes:
        proposal: moves the particles; `base.bootstrap` of a motion model, or a guided one that sees the observation.
        log_likelihood: weighs them.
        threshold: resample when the effective sample size is below this share of the particles, in [0, 1].
    """

    proposal: Proposal[Observation]
    log_likelihood: LogLikelihood[Observation]
    threshold: float = 0.5

    def init(self, particles: FloatArray) -> ParticleState:
        """Equally weighted draws ``(N, D)`` of the initial distribution, Eq. (13).

        Raises:
            ValueError: there is no particle, or one is not finite.
        """
        particles = np.asarray(particles, dtype=np.float64)
        if particles.ndim != 2 or len(particles) == 0 or not np.isfinite(particles).all():
            raise ValueError(f"expected finite particles of shape (N > 0, D), got shape {particles.shape}")
        return ParticleState(particles, np.full(len(particles), -np.log(len(particles))))

    def step(
        self, state: ParticleState, observation: Observation, rng: np.random.Generator
    ) -> tuple[ParticleState, ParticleInfo]:
        """One observation further, Eqs. (14)-(15) and (19)-(20). When no particle explains it, the predicted weights
        are kept.
        """
        # Ancestors with their normalised log-weights, drawn anew where few count, equations (16)-(20).
        count = len(state)
        ancestors, prior = np.arange(count), state.log_weights
        resampled = effective_sample_size(prior) < self.threshold * count
        if resampled:
            ancestors = systematic(probabilities(prior), count, rng)
            prior = np.full(count, -np.log(count))
        particles, correction = self.proposal(state.particles[ancestors], observation, rng)
        log_weights = prior + correction + self.log_likelihood(particles, observation)
        # The prior weights sum to one, so the evidence is the plain sum; the 1/L of (23) belongs to unit weights.
        log_evidence = log_sum(log_weights)
        posterior = ParticleState(particles, normalise(log_weights if log_evidence > -np.inf else prior))
        size = effective_sample_size(posterior.log_weights)
        return posterior, ParticleInfo(log_evidence, size, resampled)
