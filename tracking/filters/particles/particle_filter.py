"""Particle filters: bootstrap and guided, with a fixed or an adaptive number of particles.

See `tsuiseki.tracking.filters.base` for the contract. ``ParticleFilter.step`` is (14)-(20) of the finite-sets paper:
resample when the effective sample size is low, propose, weigh. Resampling stands at the start of the step (it is the
same algorithm as at the end of the last one), so that estimates are taken from weighted particles, before resampling
adds its noise.

A proposal in two layers: particles are resampled by a flattened likelihood and move a second time.

Deutscher, Blake and Reid, "Articulated body motion capture by annealed particle filtering", CVPR 2000.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numpy as np
from scipy.special import ndtri

from tsuiseki.tracking.filters.base import LogLikelihood, Observation, Proposal
from tsuiseki.tracking.filters.motion.bodies import BodyMotion
from tsuiseki.tracking.filters.particles.resampling import (
    Resampler,
    effective_sample_size,
    log_sum,
    normalise,
    probabilities,
    systematic,
)
from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class ParticleState:
    """Weighted particles, equation (12).

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
        ancestors: ``(N,)`` index of each particle's parent in the state before.
    """

    log_evidence: float
    effective_sample_size: float
    resampled: bool
    ancestors: IntArray


@dataclass(frozen=True)
class AdaptiveNumber:
    """Number of particles by the Kullback-Leibler bound of Fox, "KLD-sampling", 2003.

    With it the particles are drawn anew at every step, as many as the bound asks for the bins that they occupy.

    Attributes:
        bin_size: ``(D,)`` width of a bin along each column, > 0; ``inf`` leaves a column out.
        error: largest Kullback-Leibler divergence to the predicted distribution, > 0.
        confidence: probability that the bound holds, in (0, 1).
        minimum: least number of particles.
        maximum: greatest number of particles.
    """

    bin_size: FloatArray
    error: float = 0.05
    confidence: float = 0.99
    minimum: int = 50
    maximum: int = 5000

    def __post_init__(self) -> None:
        if np.any(~(np.asarray(self.bin_size) > 0)) or not self.error > 0 or not 0 < self.confidence < 1:
            raise ValueError("expected bin sizes and an error above 0 and a confidence in (0, 1)")
        if not 1 <= self.minimum <= self.maximum:
            raise ValueError(f"expected 1 <= minimum <= maximum, got {self.minimum} and {self.maximum}")

    def bound(self, bins: IntArray) -> FloatArray:
        """Particles needed for each number of occupied bins, by the Wilson-Hilferty approximation."""
        freedom = np.maximum(np.asarray(bins, dtype=np.float64) - 1.0, 0.0)
        spread = 2.0 / (9.0 * np.maximum(freedom, 1.0))
        quantile = float(ndtri(self.confidence))
        needed: FloatArray = freedom / (2.0 * self.error) * (1.0 - spread + np.sqrt(spread) * quantile) ** 3
        return needed

    def count(self, particles: FloatArray) -> int:
        """How many of the particles ``(maximum, D)``, in their random order, are enough."""
        cells = np.floor(particles / np.asarray(self.bin_size)).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        occupied = np.cumsum(np.bincount(first, minlength=len(particles)))
        numbers = np.arange(1, len(particles) + 1)
        # One bin alone asks for nothing, so the first particles say nothing: the minimum is drawn before the bound.
        enough = numbers[(numbers >= self.bound(occupied)) & (numbers >= self.minimum)]
        return int(enough[0]) if len(enough) else len(particles)


@dataclass(frozen=True)
class ParticleFilter(Generic[Observation]):
    """A particle filter, equations (12)-(22) of the finite-sets paper.

    Attributes:
        proposal: moves the particles; `base.bootstrap` of a motion model, or a guided one that sees the observation.
        log_likelihood: weighs them.
        resample: one of :mod:`tsuiseki.tracking.filters.particles.resampling`.
        threshold: resample when the effective sample size is below this share of the particles, in [0, 1].
        adaptive: chooses the number of particles at every step; None keeps the number.
    """

    proposal: Proposal[Observation]
    log_likelihood: LogLikelihood[Observation]
    resample: Resampler = systematic
    threshold: float = 0.5
    adaptive: AdaptiveNumber | None = None

    def init(self, particles: FloatArray) -> ParticleState:
        """Equally weighted draws ``(N, D)`` of the initial distribution, equation (13).

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
        """One observation further. When no particle explains it, the predicted weights are kept."""
        ancestors, prior, resampled = self._select(state, rng)
        particles, correction = self.proposal(state.particles[ancestors], observation, rng)
        if self.adaptive is not None:
            enough = self.adaptive.count(particles)
            particles, correction, ancestors = particles[:enough], correction[:enough], ancestors[:enough]
            prior = np.full(enough, -np.log(enough))
        log_weights = prior + correction + self.log_likelihood(particles, observation)
        # The prior weights sum to one, so the evidence is the plain sum; the 1/L of (23) belongs to unit weights.
        log_evidence = log_sum(log_weights)
        after = ParticleState(particles, normalise(log_weights if log_evidence > -np.inf else prior))
        size = effective_sample_size(after.log_weights)
        return after, ParticleInfo(log_evidence, size, resampled, ancestors)

    def _select(self, state: ParticleState, rng: np.random.Generator) -> tuple[IntArray, FloatArray, bool]:
        """Ancestors, their normalised log-weights, and whether they were drawn anew, equations (16)-(20)."""
        if self.adaptive is not None:
            drawn = self.resample(probabilities(state.log_weights), self.adaptive.maximum, rng)
            # The bound counts bins in the order of the draws, and resamplers return sorted indices.
            return rng.permutation(drawn), np.full(len(drawn), -np.log(len(drawn))), True
        count = len(state)
        if effective_sample_size(state.log_weights) >= self.threshold * count:
            return np.arange(count), state.log_weights, False
        drawn = self.resample(probabilities(state.log_weights), count, rng)
        return drawn, np.full(count, -np.log(count)), True


@dataclass(frozen=True)
class Annealed(Generic[Observation]):
    """Draws increments, keeps the good ones, and draws smaller changes of them.

    The particles are not those of the exact posterior: the search is what is gained. A step costs two likelihoods for
    each particle.

    Attributes:
        motion: how particles move.
        log_likelihood: the filter's own.
        power: of the likelihood in the first layer, in (0, 1].
        share: of the motion's noise that is added in the second, in [0, 1].
        resample: draws the survivors.
    """

    motion: BodyMotion
    log_likelihood: LogLikelihood[Observation]
    power: float = 0.3
    share: float = 0.4
    resample: Resampler = systematic

    def __post_init__(self) -> None:
        if not (0 < self.power <= 1 and 0 <= self.share <= 1):
            raise ValueError(f"expected a power in (0, 1] and a share in [0, 1], got {self.power} and {self.share}")

    def __call__(
        self, particles: FloatArray, observation: Observation, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """See `Proposal`."""
        noise, count = self.motion.noise, len(particles)
        increments = noise.draw(count, rng)
        weights = probabilities(self.power * self.log_likelihood(self.motion.moved(particles, increments), observation))
        kept = self.resample(weights, count, rng)
        closer = increments[kept] + self.share * (noise.draw(count, rng) - noise.mean)
        return self.motion.moved(particles[kept], closer), np.zeros(count)
