"""Mean average precision of actions over batches: that of scikit-learn, closed forms, and bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from sklearn.metrics import average_precision_score

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.trainers.action import Action
from tsuiseki.trainers.metrics.actions import ActionPrecision

NAMES = ("walk", "sit", "carry", "fly")


def rows(seed: int, count: int = 80) -> tuple[torch.Tensor, torch.Tensor]:
    """Probabilities with equal ones among them, and what is so; nobody flies."""
    rng = np.random.default_rng(seed)
    target = rng.random((count, 4)) < [0.5, 0.2, 0.1, 0.0]
    return torch.from_numpy((0.3 * target + 0.7 * rng.random((count, 4))).round(1)), torch.from_numpy(target)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("batch", [7, 80])
def test_scores_are_those_of_scikit_learn_whatever_the_batch(seed: int, batch: int) -> None:
    preds, target = rows(seed)
    metric = ActionPrecision(class_names=NAMES)
    for first in range(0, len(preds), batch):
        metric.update(preds[first : first + batch], target[first : first + batch])
    expected = [average_precision_score(target[:, n], preds[:, n]) for n in range(3)]
    scores = {name: value.item() for name, value in metric.compute().items()}
    assert scores == pytest.approx(
        {"map": np.mean(expected), **{f"ap_{name}": value for name, value in zip(NAMES, expected, strict=False)}},
        abs=1e-12,
    )


def test_the_module_scores_by_it() -> None:
    preds, target = rows(1)
    model = Action(actions=4, streams=("rgb_local", "rgb_global"), size=16, trunk="mobilenet_v3_small")
    parts = [({"rgb_local": preds[n], "rgb_global": preds[n].flip(0)}, target[n].float()) for n in range(80)]
    batches = [({k: v[None] for k, v in streams.items()}, truth[None]) for streams, truth in parts]
    scores = model.scores(batches)
    for name, values in (("map", (preds + preds.flip(1)) / 2), ("map_rgb_local", preds)):
        expected = np.mean([average_precision_score(target[:, n], values[:, n]) for n in range(3)])
        assert scores[name] == pytest.approx(expected, abs=1e-12)
    assert model.scores([(batches[0][0], torch.zeros(1, 4))]) == {}


def test_a_person_of_whom_nothing_is_said_is_missed() -> None:
    metric = ActionPrecision()
    metric.update([[0.9], [float("nan")]], [[1], [1]])
    assert metric.compute() == {"map": 0.5}


def test_no_action_is_nan_with_a_warning() -> None:
    for values in ([], [[[0.5, 0.5]]]):
        metric = ActionPrecision()
        for row in values:
            metric.update(row, [[0, 0]])
        with pytest.warns(InputWarning, match="expected an action that is performed, got none"):
            assert metric.compute()["map"].isnan()


WRONG: list[tuple[Any, Any, str]] = [
    ([0.5], [1], r"`preds`: expected shape \(N, 2\), got \(1,\)"),
    ([[0.5]], [[1]], r"`preds`: expected shape \(N, 2\), got \(1, 1\)"),
    ([[0.5, 0.5]], [[1]], r"`target`: expected shape \(1, 2\), got \(1, 1\)"),
    ([[0.5, 1.5]], [[1, 0]], r"`preds`: expected probabilities in \[0, 1\], got 0.5 to 1.5"),
    ([[0.5, 0.5]], [[1, 2]], "`target`: expected 0 and 1"),
]


@pytest.mark.parametrize(("preds", "target", "line"), WRONG)
def test_rows_that_do_not_fit_are_refused_in_one_line(preds: Any, target: Any, line: str) -> None:
    with pytest.raises(RequestError, match=line):
        ActionPrecision(class_names=("a", "b")).update(preds, target)


def test_names_and_widths_must_fit() -> None:
    for names in ((), ("a", "a")):
        with pytest.raises(RequestError, match="`class_names`: expected different ones"):
            ActionPrecision(class_names=names)
    metric = ActionPrecision()
    metric.update([[0.5]], [[1]])
    metric.update([[0.5, 0.5]], [[1, 0]])
    with pytest.raises(RequestError, match="expected as many actions in all updates, got 1 and 2"):
        metric.compute()
