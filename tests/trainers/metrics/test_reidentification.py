"""Re-identification over batches: that of `evaluate_retrieval`, closed forms, and bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.reidentification import evaluate_retrieval
from tsuiseki.trainers.metrics.reidentification import ReIdentification

FIELDS = {"rank1": "rank1", "rank5": "rank5", "rank10": "rank10", "map": "mean_average_precision"}


def views(seed: int, count: int = 90) -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(seed)
    ids = rng.integers(0, 12, count)
    features = rng.normal(size=(12, 16))[ids] + rng.normal(size=(count, 16))
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    columns = {"features": features.astype(np.float32), "ids": ids, "query": rng.random(count) < 0.3,
               "cameras": rng.integers(0, 3, count), "frames": rng.integers(0, 200, count)}  # fmt: skip
    return {name: torch.from_numpy(column) for name, column in columns.items()}


@pytest.mark.parametrize("columns", [(), ("cameras",), ("frames",), ("cameras", "frames")])
@pytest.mark.parametrize("batch", [7, 90])
def test_scores_are_those_of_evaluate_retrieval_whatever_the_batch(columns: tuple[str, ...], batch: int) -> None:
    table = views(1)
    metric = ReIdentification(apart=40)
    for first in range(0, 90, batch):
        metric.update(**{k: table[k][first : first + batch] for k in ("features", "ids", "query", *columns)})
    query, ids, cameras, frames = (table[k].numpy() for k in ("query", "ids", "cameras", "frames"))
    same = ids[query][:, None] == ids[~query]
    junk = np.zeros(same.shape, np.bool_)
    if "cameras" in columns:
        junk |= same & (cameras[query][:, None] == cameras[~query])
    if "frames" in columns:
        junk |= same & (np.abs(frames[query][:, None] - frames[~query]) < 40)
    features = table["features"].numpy().astype(np.float64)
    expected = evaluate_retrieval(1 - features[query] @ features[~query].T, ids[query], ids[~query], junk)
    assert expected.rank1 < 1
    assert metric.compute() == {name: getattr(expected, field) for name, field in FIELDS.items()}


def test_gallery_views_of_the_id_minus_one_count_for_nothing() -> None:
    metric = ReIdentification()
    metric.update(torch.eye(2), ids=[1, 2], query=True)
    metric.update(torch.tensor([[1.0, 0.0], [0.8, 0.6], [0.6, 0.8]]), ids=[-1, 1, 2], query=False)
    assert metric.compute() == {"rank1": 1, "rank5": 1, "rank10": 1, "map": 1}


def test_nobody_who_is_seen_again_is_nan_with_a_warning() -> None:
    for ids, cameras in (([1, 2], None), ([1, 1], [0, 0])):
        metric = ReIdentification()
        metric.update(torch.eye(2), ids, [True, False], cameras)
        with pytest.warns(InputWarning, match="expected a person who is in a query and again in the gallery"):
            assert metric.compute()["map"].isnan()


def test_features_without_a_direction_are_as_unlike_as_right_angles() -> None:
    metric = ReIdentification()
    metric.update(torch.zeros(2, 2), [1, 2], True)
    metric.update(torch.eye(2), [1, 2], False)
    assert metric.compute() == {"rank1": 0, "rank5": 1, "rank10": 1, "map": 0.5}


def test_features_in_half_precision_are_of_unit_length() -> None:
    table = views(2)
    for kind in (torch.bfloat16, torch.float16):
        metric = ReIdentification()
        metric.update(table["features"].to(kind), table["ids"], table["query"])
        assert 0 < metric.compute()["map"] < 1


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"features": torch.ones(2)}, r"`features`: expected shape \(N, D\), got \(2,\)"),
    ({"features": 3 * torch.eye(2)}, "`features`: expected unit length, got 3 to 3; .*normalize"),
    ({"features": torch.full((2, 2), float("nan"))}, "`features`: expected unit length"),
    ({"ids": [1, 2, 3]}, r"`ids`: expected shape \(2,\), got \(3,\)"),
    ({"ids": [1, 2.5]}, "`ids`: expected whole numbers"),
    ({"query": [True]}, r"`query`: expected shape \(2,\), got \(1,\)"),
    ({"cameras": [0]}, r"`cameras`: expected shape \(2,\)"),
    ({"frames": [[0, 1]]}, r"`frames`: expected shape \(2,\), got \(1, 2\)"),
]


@pytest.mark.parametrize(("wrong", "line"), WRONG)
def test_columns_that_do_not_fit_are_refused_in_one_line(wrong: dict[str, Any], line: str) -> None:
    with pytest.raises(RequestError, match=line):
        ReIdentification().update(**{"features": torch.eye(2), "ids": [1, 2], "query": True} | wrong)


def test_features_of_two_lengths_are_refused() -> None:
    metric = ReIdentification()
    metric.update(torch.eye(2), [1, 2], True)
    metric.update(torch.eye(3), [1, 2, 3], False)
    with pytest.raises(RequestError, match="`features`: expected one length in all updates, got 2 and 3"):
        metric.compute()
