"""Retrieval scores against hand-computed values and plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.evaluation.reidentification import area_under_roc, evaluate_retrieval


def test_two_queries_by_hand() -> None:
    distances = np.array([[0.1, 0.2, 0.3, 0.4], [0.4, 0.3, 0.2, 0.1]])
    scores = evaluate_retrieval(distances, np.array([1, 2]), np.array([1, 2, 1, 1]))
    # Query 1 hits ranks 1, 3, 4: (1 + 2/3 + 3/4) / 3. Query 2 hits rank 3: 1/3.
    assert scores.rank1 == 0.5
    assert scores.mean_average_precision == pytest.approx(((1 + 2 / 3 + 3 / 4) / 3 + 1 / 3) / 2)
    assert scores.queries == 2


def test_junk_takes_no_rank() -> None:
    distances = np.array([[0.0, 0.1, 0.2, 0.3]])
    junk = np.array([[True, False, False, False]])
    scores = evaluate_retrieval(distances, np.array([1]), np.array([1, 2, 1, 2]), junk)
    assert scores.rank1 == 0.0
    assert scores.mean_average_precision == pytest.approx(1 / 2)


def test_queries_without_answer_do_not_count() -> None:
    scores = evaluate_retrieval(np.array([[0.0, 1.0], [0.0, 1.0]]), np.array([1, 7]), np.array([1, 2]))
    assert (scores.rank1, scores.mean_average_precision, scores.queries) == (1.0, 1.0, 1)


def test_equal_distances_flatter_nobody() -> None:
    scores = evaluate_retrieval(np.zeros((1, 4)), np.array([1]), np.array([1, 2, 2, 2]))
    assert scores.rank1 == 0.0
    assert scores.mean_average_precision == pytest.approx(1 / 4)


def test_only_the_order_matters() -> None:
    rng = np.random.default_rng(0)
    distances, query, gallery = rng.random((9, 30)), rng.integers(0, 4, 9), rng.integers(0, 4, 30)
    assert evaluate_retrieval(distances, query, gallery) == evaluate_retrieval(distances**3, query, gallery)


def test_area_under_roc_is_the_share_of_ordered_pairs() -> None:
    rng = np.random.default_rng(0)
    positive, negative = rng.integers(0, 6, 40) + 1.0, rng.integers(0, 6, 30) * 1.0
    pairs = (positive[:, None] > negative).mean() + 0.5 * (positive[:, None] == negative).mean()
    assert area_under_roc(positive, negative) == pytest.approx(pairs)


def test_nothing_to_score() -> None:
    with pytest.raises(ValueError, match="same person in the gallery"):
        evaluate_retrieval(np.zeros((1, 1)), np.array([1]), np.array([2]))
    with pytest.raises(ValueError, match="positives and negatives"):
        area_under_roc(np.zeros(0), np.zeros(3))
