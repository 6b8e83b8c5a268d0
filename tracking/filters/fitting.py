"""Maximum-likelihood fitting of a particle filter's parameters, equation (11) of the finite-sets paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from tsuiseki.tracking.filters.particle import Observation, ParticleFilter, ParticleState
from tsuiseki.tracking.types import FloatArray

Build = Callable[[FloatArray], ParticleFilter[Observation]]


@dataclass(frozen=True)
class Fit:
    """The parameters found.

    Attributes:
        parameters: ``(P,)``.
        log_evidence: of all observations at these parameters.
        evaluations: how often the filter ran over the observations.
        converged: whether the search ended by its tolerance and not by its limit.
    """

    parameters: FloatArray
    log_evidence: float
    evaluations: int
    converged: bool


def log_evidence(
    particle_filter: ParticleFilter[Observation],
    state: ParticleState,
    observations: Sequence[Observation],
    rng: np.random.Generator,
) -> float:
    """Logarithm of ``p(y_1:K)``, the sum of the steps' log-evidences."""
    total = 0.0
    for observation in observations:
        state, info = particle_filter.step(state, observation, rng)
        total += info.log_evidence
    return total


def fit(
    build: Build[Observation],
    start: FloatArray,
    state: ParticleState,
    observations: Sequence[Observation],
    seed: int = 0,
    evaluations: int = 200,
    tolerance: float = 1e-2,
) -> Fit:
    """Parameters of greatest log-evidence by a Nelder-Mead search.

    Every run draws the same random numbers, so that a difference between parameters is not their noise.

    Args:
        build: makes the filter of parameters ``(P,)``; all real vectors must be allowed, so give scales as logarithms.
        start: ``(P,)`` where the search begins.
        state: the initial particles, the same for all parameters.
        observations: all of them, in order; at least one.
        seed: of the random numbers.
        evaluations: limit of runs over the observations.
        tolerance: end of the search, in parameters and in log-evidence.

    Raises:
        ValueError: there is no observation, or no particle explains the observations at ``start``.
    """
    if len(observations) == 0:
        raise ValueError("expected at least one observation to fit to, got none")

    def cost(parameters: FloatArray) -> float:
        value = log_evidence(build(parameters), state, observations, np.random.default_rng(seed))
        # The search cannot compare infinities; 1e300 is worse than any explained sequence.
        return -value if np.isfinite(value) else 1e300

    start = np.asarray(start, dtype=np.float64)
    if cost(start) >= 1e300:
        raise ValueError(f"expected start parameters that explain the observations, got {start.tolist()}")
    simplex = np.vstack([start, start + 0.5 * np.eye(len(start))])
    options = {"maxfev": evaluations, "xatol": tolerance, "fatol": tolerance, "initial_simplex": simplex}
    result = minimize(cost, start, method="Nelder-Mead", options=options)
    return Fit(np.asarray(result.x, dtype=np.float64), -float(result.fun), int(result.nfev), bool(result.success))
