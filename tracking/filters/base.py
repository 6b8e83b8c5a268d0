"""The contract of all filters, on one page.

A filter is a frozen dataclass of settings with two functions, ``init`` and ``step`` (`Filter`). The state is what the
next step needs; the info is what came out: estimates and diagnostics. It computes the posterior of the state given all
observations so far: (5)-(10) of the finite-sets paper, thesis eq. 2.5 and its estimate, eq. 2.6. Motion and likelihood
are its models of state and observation, (1)-(4).

Neither function changes what it is given. All randomness is ``rng``: the same seed gives the same result. What a filter
is made of is an argument: a `Motion` (`body_motion` and `point_motion` have all), a `Proposal`, a `LogLikelihood`,
`Births`. `tsuiseki.tracking.filters.resampling` keeps the good particles.

Weights are logarithms wherever they are kept or handed on: ``(N,)`` float64 in [-inf, inf), where ``-inf`` is a
particle that cannot be. Of one target they sum to one, of several to the expected
number of targets. Particles are ``(N, D)`` float64. What an observation is, only the proposal, the likelihood and the
births know; one that carries its own time gives the motion its seconds, otherwise the filter's settings do.

Two files are no filters in this sense, but parts of trackers. `kalman` gives a step in two halves, ``predict`` and
``update``, over all tracks at once, because a tracker associates between them; it draws nothing. The correlation
filters learn a template from images.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from tsuiseki.tracking.types import Columns, FloatArray, IntArray

State = TypeVar("State")
Observation = TypeVar("Observation")
ObservationIn = TypeVar("ObservationIn", contravariant=True)
InfoOut = TypeVar("InfoOut", covariant=True)


class Motion(Protocol):
    """Draws the states ``(N, D)`` after ``seconds`` > 0, given the states ``(N, D)`` now, equation (1) of the
    finite-sets paper.

    A motion that is known for one frame only counts in frames (`whole_frames`): there one frame stands for a second.
    """

    def __call__(self, states: FloatArray, seconds: float, rng: np.random.Generator, /) -> FloatArray: ...


class Proposal(Protocol[ObservationIn]):
    """Draws the next particles; returns them ``(N, D)`` with ``log f - log q`` ``(N,)``, the correction of (15)."""

    def __call__(
        self, particles: FloatArray, observation: ObservationIn, rng: np.random.Generator, /
    ) -> tuple[FloatArray, FloatArray]: ...


class LogLikelihood(Protocol[ObservationIn]):
    """``log h(y | x)`` ``(N,)`` of each particle ``(N, D)``, with its constants, since the evidence needs them."""

    def __call__(self, particles: FloatArray, observation: ObservationIn, /) -> FloatArray: ...


@dataclass(frozen=True)
class BornParticles:
    """Weighted draws of the birth intensity in contiguous groups, one for each place of birth.

    Attributes:
        particles: ``(J, D)``.
        log_weights: ``(J,)``; the weights sum to the expected number of births.
        starts: ``(G,)`` first particle of each group.
    """

    particles: FloatArray
    log_weights: FloatArray
    starts: IntArray

    @property
    def groups(self) -> IntArray:
        """``(J,)`` number of each particle's group, from 0."""
        return np.repeat(np.arange(len(self.starts)), np.diff(self.starts, append=len(self.particles)))


class Births(Protocol[ObservationIn]):
    """Proposal ``q_Gamma(. | Y)`` of new targets, (51), with the weights of (52)."""

    def draw(self, observation: ObservationIn, rng: np.random.Generator, /) -> BornParticles: ...


@dataclass(frozen=True)
class TargetEstimates(Columns):
    """The targets that a filter of several targets reports in one step.

    Attributes:
        ids: ``(N,)`` positive and, for one target, the same through time.
        states: ``(N, D)``.
        weights: ``(N,)`` how sure the filter is of each: its expected count or its probability of existence.
    """

    ids: IntArray
    states: FloatArray
    weights: FloatArray


@dataclass(frozen=True)
class SetInfo:
    """What every filter of several targets found in one step.

    Attributes:
        estimates: the targets reported.
        expected_count: expected number of targets, the unreported ones included.
    """

    estimates: TargetEstimates
    expected_count: float


class Filter(Protocol[State, ObservationIn, InfoOut]):
    """A filter; see the module.

    ``init`` takes particles ``(N, D)`` drawn from what is known at the start; ``(0, D)`` where a filter of several
    targets begins with none. It may take more, which says what else is known. ``step`` goes one observation further.
    """

    def init(self, particles: FloatArray) -> State: ...

    def step(self, state: State, observation: ObservationIn, rng: np.random.Generator) -> tuple[State, InfoOut]: ...


def whole_frames(seconds: float) -> int:
    """The time as a number of frames, for a motion that is known for one frame.

    Raises:
        ValueError: it is not a whole number from 1.
    """
    count = round(seconds)
    if count < 1 or count != seconds:
        raise ValueError(f"expected a whole number of frames from 1, got {seconds}")
    return count


def bootstrap(motion: Motion) -> Proposal[object]:
    """The motion model itself as proposal, Eq. (21): its correction is zero.

    Args:
        motion: draws the next states, one unit of its time later.
    """

    def propose(particles: FloatArray, observation: object, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        del observation
        return motion(particles, 1.0, rng), np.zeros(len(particles))

    return propose
