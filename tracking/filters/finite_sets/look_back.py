"""The targets of one observation earlier, given this one as well: smoothing with a lag of one step.

Whether a target has ended or was only missed, and whether a measurement began one, is mostly told by the next
observation; and a place between two measurements is known better than the last one. A fixed lag of one step of the
forward-backward recursions, in particle form (Kitagawa, "Monte Carlo filter and smoother", 1996): the particles as they
were before they moved get the weights that they have after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.base import TargetEstimates
from tsuiseki.tracking.filters.particles.weights import logarithms
from tsuiseki.tracking.types import FloatArray, IntArray

TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class TrackParticles:
    """Tracks in particle form.

    Attributes:
        labels: ``(T,)`` positive.
        existence: ``(T,)`` probabilities.
        particles: ``(T, P, D)``.
        log_weights: ``(T, P)``; the weights of each track sum to one.
    """

    labels: IntArray
    existence: FloatArray
    particles: FloatArray
    log_weights: FloatArray


@dataclass(frozen=True)
class LookBack:
    """The same tracks through one step of a filter.

    Attributes:
        before: as they were.
        predicted_existence: ``(T,)`` probability that each was there and goes on.
        predicted_log_weights: ``(T, P)`` of the particles of those that go on.
        existence: ``(T,)`` probability that each goes on, given the observation.
        log_weights: ``(T, P)`` of the particles of those that go on, given the observation.
    """

    before: TrackParticles
    predicted_existence: FloatArray
    predicted_log_weights: FloatArray
    existence: FloatArray
    log_weights: FloatArray

    def smoothed(self) -> TrackParticles:
        """The tracks before the step, given its observation.

        A track was there if it goes on, or if it ended just now. The observation tells the second from one that never
        was there no better than the probabilities before it: ``r' = r+ + (1 - r+) r (1 - s) / (1 - r s)`` with ``r``
        before, ``r s`` predicted, and ``r+`` after.
        """
        r, going_on, after = self.before.existence, self.predicted_existence, self.existence
        unlike = (1.0 - after) / np.maximum(1.0 - going_on, TINY)
        ended = unlike * (r - going_on)
        existence = np.clip(after + ended, 0.0, 1.0)
        died = r[:, None] * np.exp(self.before.log_weights) - going_on[:, None] * np.exp(self.predicted_log_weights)
        weights = after[:, None] * np.exp(self.log_weights) + unlike[:, None] * np.maximum(died, 0.0)
        total = weights.sum(axis=1, keepdims=True)
        equal = np.full(weights.shape, 1.0 / max(weights.shape[1], 1))
        shares = np.divide(weights, total, out=equal, where=total > 0)
        return TrackParticles(self.before.labels, existence, self.before.particles, logarithms(shares))


def likely(tracks: TrackParticles, report: float) -> TargetEstimates:
    """The tracks whose existence is above ``report``, at the mean of their particles."""
    shown = tracks.existence > report
    means = np.einsum("tp,tpd->td", np.exp(tracks.log_weights[shown]), tracks.particles[shown])
    return TargetEstimates(tracks.labels[shown], means, tracks.existence[shown])
