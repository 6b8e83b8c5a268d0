"""Marginal probabilities of a one-to-one association by loopy belief propagation (Williams and Lau, 2014)."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import FloatArray

SMALLEST = 1e-100
"""Stands for a weight of zero, so that a certain association does not divide by zero."""


def association_marginals(
    detected: FloatArray, missed: FloatArray, unclaimed: FloatArray, tolerance: float = 1e-4, iterations: int = 200
) -> tuple[FloatArray, FloatArray]:
    """Probability of each pair when every target has at most one measurement and every measurement at most one target.

    The joint weight of an association is the product of ``detected`` over its pairs, ``missed`` over the targets
    without a measurement and ``unclaimed`` over the measurements without a target. The result is exact where the pairs
    of positive weight form no loop.

    Args:
        detected: ``(T, M)`` weights >= 0.
        missed: ``(T,)`` weights >= 0.
        unclaimed: ``(M,)`` weights >= 0.
        tolerance: largest relative change of a message at the end.
        iterations: limit.

    Returns:
        ``(T, M)`` probabilities of the pairs and ``(T,)`` of no measurement; each row sums to one together with it.
    """
    missed, unclaimed = np.maximum(missed, SMALLEST), np.maximum(unclaimed, SMALLEST)
    back = np.broadcast_to(1.0 / unclaimed, detected.shape)
    for _ in range(iterations):
        claim = detected * back
        forth = detected / (missed[:, None] + claim.sum(axis=1, keepdims=True) - claim + SMALLEST)
        new = 1.0 / (unclaimed + forth.sum(axis=0) - forth).clip(SMALLEST)
        change = np.max(np.abs(np.log(new / back)), initial=0.0)
        back = new
        if change <= tolerance:
            break
    claim = detected * back
    total = missed + claim.sum(axis=1)
    return claim / total[:, None], missed / total
