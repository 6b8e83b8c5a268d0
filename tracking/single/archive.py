"""Filters of the past, thesis 3.2.7."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.correlation.kernelised_correlation import FilterBank
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class Archive:
    """The last stored filters, each a bank of one, with the response that it had when it was stored.

    Attributes:
        capacity: U, the oldest filter goes when there would be more.
        first: the filter of the first frame, kept beside them for good; None as in the thesis.
        banks: oldest first.
        scores: one a bank.
    """

    capacity: int
    first: FilterBank | None = None
    banks: tuple[FilterBank, ...] = ()
    scores: tuple[float, ...] = ()

    def add(self, bank: FilterBank, score: float) -> Archive:
        """With one more filter."""
        keep = slice(max(0, len(self.banks) + 1 - self.capacity), None)
        return Archive(self.capacity, self.first, (*self.banks, bank)[keep], (*self.scores, score)[keep])

    def candidates(self) -> tuple[FilterBank, ...]:
        """All filters that can be drawn, the first frame's first."""
        return (self.first, *self.banks) if self.first is not None else self.banks

    def weights(self, by_score: bool) -> FloatArray:
        """Relative probabilities P_K of the candidates: alike, or by score; the first frame's counts as the best."""
        scores = [max(self.scores, default=1.0)] if self.first is not None else []
        scores += self.scores
        return np.maximum(np.array(scores), 1e-6) if by_score else np.ones(len(scores))
