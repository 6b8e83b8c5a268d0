"""How well actions are recognised: frame-wise scores at a threshold, and average precision (thesis 5.4.4).

A row is one person in one frame. The thesis calls its frame-wise numbers recognition accuracy and does not define them.
Here the number of Table 5.5 is F1 = 2 TP / (2 TP + FP + FN) of each action over all rows. An action counts as
recognised where its probability is above the threshold. The average is over the actions that occur in the labels.
Precision and recall are given, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

THRESHOLD = 0.4


@dataclass(frozen=True)
class ActionScores:
    """Scores of each of A actions, NaN where an action does not occur.

    Attributes:
        names: of the actions.
        f1: ``(A,)`` in [0, 1].
        precision: ``(A,)`` right share of the calls; 0 where there is none.
        recall: ``(A,)`` called share of what occurs.
        average_precision: ``(A,)`` area under the precision-recall steps.
        positives: ``(A,)`` number of rows in which the action occurs.
        rows: number of rows.
    """

    names: tuple[str, ...]
    f1: FloatArray
    precision: FloatArray
    recall: FloatArray
    average_precision: FloatArray
    positives: IntArray
    rows: int

    @property
    def mean_f1(self) -> float:
        """Mean over the actions that occur: the average of Table 5.5."""
        return float(np.nanmean(self.f1))

    @property
    def mean_average_precision(self) -> float:
        """Mean over the actions that occur: mAP."""
        return float(np.nanmean(self.average_precision))


def evaluate_actions(
    names: Sequence[str], probabilities: FloatArray, truth: BoolArray, threshold: float = THRESHOLD
) -> ActionScores:
    """Scores of probabilities against labels.

    Args:
        names: of the A actions.
        probabilities: ``(N, A)`` of what is said; NaN where nothing is said of a person, which is a miss.
        truth: ``(N, A)`` what is so.
        threshold: on the probability, above which an action is called.

    Raises:
        RequestError: no action occurs in any row.
    """
    if not truth.any():
        raise RequestError("expected rows with actions to score, found none")
    called = probabilities > threshold
    right = (called & truth).sum(axis=0)
    positives, calls = truth.sum(axis=0), called.sum(axis=0)
    occurs = positives > 0
    f1, precision, recall = (
        np.where(occurs, numerator / np.maximum(denominator, 1), np.nan)
        for numerator, denominator in ((2 * right, positives + calls), (right, calls), (right, positives))
    )
    average = average_precisions(probabilities, truth)
    return ActionScores(tuple(names), f1, precision, recall, average, positives.astype(np.int64), len(truth))


def average_precisions(scores: FloatArray, truth: BoolArray) -> FloatArray:
    """``(A,)`` sum over the rises of recall of the precision there, for ``(N, A)`` scores; NaN without a positive.

    Rows of equal score enter together, so their order does not matter. A row without a score, NaN, never enters: what
    is so there is never recalled.

    >>> average_precisions(np.array([[0.9], [0.8], [0.7]]), np.array([[True], [False], [True]])).round(4).tolist()
    [0.8333]
    """
    scored = np.isfinite(scores)
    scores = np.where(scored, scores, -np.inf)
    order = np.argsort(-scores, axis=0, kind="stable")
    ranked, hits = np.take_along_axis(scores, order, axis=0), np.take_along_axis(truth & scored, order, axis=0)
    found = np.cumsum(hits, axis=0)
    precision = found / np.arange(1, len(scores) + 1)[:, None]
    # Precision at the last row of each group of equal scores, carried back to the others of the group.
    last = np.ones(ranked.shape, dtype=np.bool_)
    last[:-1] = ranked[1:] != ranked[:-1]
    rows = np.where(last, np.arange(len(scores))[:, None], len(scores))
    ends = np.minimum.accumulate(rows[::-1], axis=0)[::-1]
    precision = np.take_along_axis(precision, ends, axis=0)
    positives = truth.sum(axis=0)
    total = (precision * hits).sum(axis=0)
    nowhere = np.full(scores.shape[1], np.nan)
    return np.asarray(np.divide(total, positives, out=nowhere, where=positives > 0))
