"""A proposal in two layers: particles are resampled by a flattened likelihood and move a second time.

Deutscher, Blake and Reid, "Articulated body motion capture by annealed particle filtering", CVPR 2000.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numpy as np

from tsuiseki.tracking.filters.base import LogLikelihood, Observation
from tsuiseki.tracking.filters.motion.body_motion import BodyMotion
from tsuiseki.tracking.filters.particles.resampling import Resampler, systematic
from tsuiseki.tracking.filters.particles.weights import probabilities
from tsuiseki.tracking.types import FloatArray


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
