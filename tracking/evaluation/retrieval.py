"""How well appearance features find the same person again: ranks, mean average precision, area under the ROC."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Retrieval:
    """Scores of a retrieval, each in [0, 1].

    Attributes:
        rank1: share of the queries whose closest gallery entry is the same person.
        rank5: share of those of which one of the five closest is.
        rank10: likewise, of ten.
        mean_average_precision: mean over the queries of the area under their precision-recall steps.
        queries: number of queries that have an answer in the gallery; the others do not count.
    """

    rank1: float
    rank5: float
    rank10: float
    mean_average_precision: float
    queries: int


def evaluate_retrieval(
    distances: FloatArray, query_ids: IntArray, gallery_ids: IntArray, junk: BoolArray | None = None
) -> Retrieval:
    """Rank-1 and mean average precision of a query set against a gallery, as Market-1501 defines them.

    Equal distances count against the query: a wrong entry comes before a right one.

    Args:
        distances: ``(Q, G)`` smaller is more alike.
        query_ids: ``(Q,)`` identities.
        gallery_ids: ``(G,)`` identities.
        junk: ``(Q, G)`` gallery entries that are neither right nor wrong for a query, such as views a moment apart.

    Raises:
        ValueError: no query has an answer in the gallery.
    """
    junk = np.zeros(distances.shape, dtype=np.bool_) if junk is None else junk
    right = (query_ids[:, None] == gallery_ids[None, :]) & ~junk
    answered = right.any(axis=1)
    if not answered.any():
        raise ValueError("expected queries with the same person in the gallery, found none")
    right, junk, distances = right[answered], junk[answered], distances[answered]
    # Junk sinks to the end, where it takes no rank from anything that counts.
    order = np.lexsort([right, np.where(junk, np.inf, distances)], axis=1)
    hits = np.take_along_axis(right, order, axis=1)
    precision = np.cumsum(hits, axis=1) / np.arange(1, hits.shape[1] + 1)
    average = (precision * hits).sum(axis=1) / hits.sum(axis=1)
    ranks = [float(hits[:, :k].any(axis=1).mean()) for k in (1, 5, 10)]
    return Retrieval(ranks[0], ranks[1], ranks[2], float(average.mean()), int(answered.sum()))


def area_under_roc(positive: FloatArray, negative: FloatArray) -> float:
    """Probability that a random positive scores higher than a random negative, ties counted half.

    >>> area_under_roc(np.array([0.9, 0.5]), np.array([0.5, 0.1]))
    0.875

    Args:
        positive: ``(P,)`` scores of pairs that are the same.
        negative: ``(N,)`` scores of pairs that are not.

    Raises:
        ValueError: one of them is empty.
    """
    if len(positive) == 0 or len(negative) == 0:
        raise ValueError(f"expected positives and negatives, got {len(positive)} and {len(negative)}")
    ordered = np.sort(negative)
    below = np.searchsorted(ordered, positive, side="left") + np.searchsorted(ordered, positive, side="right")
    return float(below.mean() / (2 * len(negative)))
