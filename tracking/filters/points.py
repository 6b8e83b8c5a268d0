"""What every filter of several point targets reports."""

from __future__ import annotations

from dataclasses import dataclass

from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class PointEstimates:
    """The targets of one step.

    Attributes:
        ids: ``(N,)`` positive and, for one target, the same through time.
        states: ``(N, D)``.
        weights: ``(N,)`` how sure the filter is of each: its expected count or its probability of existence.
    """

    ids: IntArray
    states: FloatArray
    weights: FloatArray

    def __len__(self) -> int:
        return len(self.ids)
