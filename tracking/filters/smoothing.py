"""Estimates that wait a little: the past of the particles that survive.

A particle's ancestors are a draw from the joint distribution of all its states, so weighing the ancestors' states by
today's weights gives the distribution of a past state given everything since (Kitagawa, "Monte Carlo filter and
smoother", 1996). Over a short lag enough ancestors remain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class Lineage:
    """Past states of today's particles.

    Attributes:
        times: seconds, the oldest first.
        states: one ``(N, D)`` a time: row i belongs to the ancestor of today's particle i.
    """

    times: tuple[float, ...] = ()
    states: tuple[FloatArray, ...] = ()

    def extended(self, ancestors: IntArray, states: FloatArray, time: float, lag: float) -> Lineage:
        """The lineage one step on.

        Args:
            ancestors: ``(N,)`` index of each particle's parent among the particles before the step.
            states: ``(N, D)`` after the step.
            time: of the step, seconds.
            lag: what is older than ``time - lag`` is dropped but for the newest such, seconds.
        """
        times = (*self.times, time)
        unmoved = len(ancestors) == len(states) and np.array_equal(ancestors, np.arange(len(ancestors)))
        past = self.states if unmoved else tuple(s[ancestors] for s in self.states)
        past = (*past, states)
        first = max(sum(t <= time - lag + 1e-9 for t in times) - 1, 0)
        return Lineage(times[first:], past[first:])
