"""Matching two sets one to one (Hungarian): by the least cost, or by the most overlap."""

from __future__ import annotations

import numpy as np
import scipy

from tsuiseki.tracking.types import FloatArray, IntArray

# Indices of an empty matching.
NOTHING = np.empty(0, dtype=np.int64)


def assign(costs: FloatArray, limit: float) -> tuple[IntArray, IntArray]:
    """Match rows to columns one to one: as many pairs within the limit as possible, at the least total cost.

    A cost above the limit counts as infinite (thesis 2.3.2: c > ε becomes ∞), and so does NaN.

    Args:
        costs: ``(N, M)``.
        limit: the gate ε; a pair of a higher cost is never matched.

    Returns:
        Indices of the matched rows, increasing, and of their columns.

    >>> assign(np.array([[0.1, 0.2], [0.15, 0.9]]), limit=0.5)
    (array([0, 1]), array([1, 0]))
    """
    if costs.size == 0:
        return NOTHING, NOTHING
    barred = ~(costs <= limit)
    if barred.all():
        return NOTHING, NOTHING
    if not barred.any():
        rows, columns = scipy.optimize.linear_sum_assignment(costs)
        return rows, columns
    # One barred pair is dearer than any matching of allowed ones, so it is taken only where nothing else is left.
    lowest = min(float(costs[~barred].min()), 0.0)
    rows, columns = scipy.optimize.linear_sum_assignment(
        np.where(barred, (limit - lowest + 1.0) * (min(costs.shape) + 1), costs)
    )
    allowed = ~barred[rows, columns]
    return rows[allowed], columns[allowed]


def assign_overlaps(overlaps: FloatArray, least: float) -> tuple[IntArray, IntArray]:
    """Match rows to columns one to one for the greatest total overlap.

    Args:
        overlaps: ``(N, M)`` in [0, 1].
        least: pairs that overlap less count for nothing, and so never push a valid pair aside.

    Returns:
        Indices of the matched rows, increasing, and of their columns.

    >>> assign_overlaps(np.array([[0.6, 0.55], [0.7, 0.4]]), least=0.5)
    (array([0, 1]), array([1, 0]))
    """
    valid = overlaps >= least
    rows, columns = scipy.optimize.linear_sum_assignment(np.where(valid, overlaps, 0), maximize=True)
    matched = valid[rows, columns]
    return rows[matched], columns[matched]
