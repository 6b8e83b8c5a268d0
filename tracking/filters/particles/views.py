"""Weighing particles by several views, each of which may be covered.

View c gives particle i a log-ratio l_ci: how likely its picture is if the target is at the particle, over how likely it
is if the view is covered. The view is open with probability v_c, so its weight for the particle is
``v_c exp(l_ci) + 1 - v_c``. A view that speaks against all particles weighs them all alike, and does not pull the
estimate away. v_c follows a two-state Markov chain and is updated by Bayes' rule.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class Covering:
    """How views get covered and free again.

    Attributes:
        covers: rate at which an open view is covered, 1/s.
        opens: rate at which a covered view opens, 1/s.
        floor: v_c stays in [floor, 1 - floor].
    """

    covers: float = 0.5
    opens: float = 1.5
    floor: float = 0.02

    def predict(self, open_before: FloatArray, seconds: float) -> FloatArray:
        """v_c after ``seconds`` without an observation, ``(C,)``."""
        total = self.covers + self.opens
        rest = self.opens / total
        after = rest + (open_before - rest) * np.exp(-total * seconds)
        return np.asarray(np.clip(after, self.floor, 1 - self.floor))


def weigh_views(log_ratios: FloatArray, open_before: FloatArray) -> FloatArray:
    """``log(v_c exp(l_ci) + 1 - v_c)`` ``(N, C)`` for log-ratios ``(N, C)`` and ``(C,)`` probabilities in (0, 1)."""
    return np.logaddexp(np.log(open_before) + log_ratios, np.log1p(-open_before))


def open_after(log_ratios: FloatArray, open_before: FloatArray, weights: FloatArray) -> FloatArray:
    """v_c ``(C,)`` given what the views showed: the mean over particles, weighted after weighing, of Bayes' rule."""
    share = np.exp(np.log(open_before) + log_ratios - weigh_views(log_ratios, open_before))
    return np.asarray(weights @ share)
