"""The learnt transition cost: what the trees see, what a probability costs, and which files are refused."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from tsuiseki.tracking.association.costs import pair_features
from tsuiseki.tracking.association.learnt_costs import FEATURE_SETS, Affinity, feature_rows, transition_cost
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard

WEIGHTS = Path(str(resources.files("tsuiseki.tracking"))) / "weights"
CARD = ModelCard(
    kind="affinity",
    name="test",
    class_names=FEATURE_SETS["thesis"],
    layout="NF",
    settings={"features": "thesis", "window": 7, "alpha": 1.0, "beta": -2.0, "b": -0.5},
)


def write_iou_model(path: Path, card: ModelCard) -> Path:
    """A model whose probability is the overlap."""
    columns = len(card.class_names)
    rows = helper.make_tensor_value_info("features", TensorProto.FLOAT, ["N", columns])
    result = helper.make_tensor_value_info("probability", TensorProto.FLOAT, ["N"])
    first = helper.make_tensor("first", TensorProto.INT64, [], [0])
    gather = helper.make_node("Gather", ["features", "first"], ["probability"], axis=1)
    graph = helper.make_graph([gather], "g", [rows], [result], [first])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    model.metadata_props.add(key=METADATA_KEY, value=card.to_json())
    onnx.save(model, path)
    return path


def test_features_of_one_pair() -> None:
    """A box of 20x40 that moves by 10 and 4 pixels in two frames and becomes half as wide."""
    boxes = np.array([[0, 0, 20, 40], [15, 4, 25, 44.0]])
    features = np.array([[1, 0], [0.6, 0.8]])
    pairs = pair_features(boxes, features, np.array([0]), np.array([1]), np.array([2]))
    rows = feature_rows(pairs, "extended")
    shared = 5 * 36
    overlap = shared / (800 + 400 - shared)
    expected = [overlap, 0.4, 2, np.log(2), 0, 10 / 40 / 2, 4 / 40 / 2]
    assert rows.dtype == np.float32
    np.testing.assert_allclose(rows, [expected], rtol=1e-6)
    np.testing.assert_allclose(feature_rows(pairs, "thesis"), [expected[:2]], rtol=1e-6)


def test_left_and_right_are_alike() -> None:
    rng = np.random.default_rng(0)
    corner = rng.uniform(0, 100, (40, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(5, 50, (40, 2))], axis=1)
    mirrored = np.stack([-boxes[:, 2], boxes[:, 1], -boxes[:, 0], boxes[:, 3]], axis=1)
    i, j, gap = np.arange(20), np.arange(20, 40), rng.integers(1, 9, 20)
    there, back = (feature_rows(pair_features(b, None, i, j, gap), "extended") for b in (boxes, mirrored))
    np.testing.assert_allclose(there, back, rtol=1e-4)


def test_cost_is_minus_log_probability() -> None:
    probability = np.array([0, 1e-9, 0.2, 0.5, 1])
    cost = transition_cost(probability)
    np.testing.assert_allclose(cost[2:4], -np.log([0.2, 0.5]))
    assert np.isfinite(cost).all()
    assert (cost > 0).all()
    assert (np.diff(cost) <= 0).all()


def test_a_pair_costs_the_same_wherever_it_stands() -> None:
    affinity = Affinity(WEIGHTS / "affinity_people.onnx", threads=1)
    rng = np.random.default_rng(0)
    corner = rng.uniform(0, 60, (400, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(20, 50, (400, 2))], axis=1)
    looks = rng.normal(size=(400, 4))
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    looks[::7] = np.nan
    i, j = np.arange(200), np.arange(200, 400)
    pairs = replace(pair_features(boxes, looks, i, j, rng.integers(1, 9, 200)), action=rng.random(200))
    alone = [affinity.probability(pairs.select(np.array([k])))[0] for k in range(200)]
    assert len(set(alone)) > 50
    # The sigmoid at the end of the trees rounds differently in a vector of floats and in what is left beside it.
    np.testing.assert_allclose(affinity.probability(pairs), alone, rtol=0, atol=np.finfo(np.float32).eps)


def test_prices_pairs(tmp_path: Path) -> None:
    affinity = Affinity(write_iou_model(tmp_path / "a.onnx", CARD), threads=1)
    boxes = np.array([[0, 0, 2, 1], [1, 0, 3, 1], [0, 0, 2, 1.0]])
    pairs = pair_features(boxes, None, np.array([0, 0]), np.array([1, 2]), np.array([1, 2]))
    np.testing.assert_allclose(affinity.probability(pairs), [1 / 3, 1], rtol=1e-6)
    np.testing.assert_allclose(affinity(pairs), [np.log(3), 0], atol=1e-5)
    assert affinity.window == 7
    np.testing.assert_allclose(affinity.observation(np.array([1.0])), [-0.5 + 1 - 2])


def test_no_pairs(tmp_path: Path) -> None:
    affinity = Affinity(write_iou_model(tmp_path / "a.onnx", CARD))
    none = np.empty(0, np.int64)
    assert affinity(pair_features(np.empty((0, 4)), None, none, none, none)).shape == (0,)


@pytest.mark.parametrize(
    ("card", "expected"),
    [
        (
            replace(CARD, class_names=("iou", "weather")),
            r"features of thesis, extended, .*got iou, weather",
        ),
        (replace(CARD, settings=CARD.settings | {"features": "extended"}), "expected the features"),
        (replace(CARD, settings=CARD.settings | {"alpha": "high"}), "expected numbers window, alpha, beta and b"),
        (replace(CARD, settings={"features": "thesis"}), "expected numbers window, alpha, beta and b"),
        (replace(CARD, kind="detector"), "expected a model of kind 'affinity', got 'detector'"),
    ],
    ids=["unknown feature", "other set", "no number", "no settings", "other kind"],
)
def test_refuses_foreign_files(tmp_path: Path, card: ModelCard, expected: str) -> None:
    with pytest.raises(RequestError, match=expected):
        Affinity(write_iou_model(tmp_path / "a.onnx", card))


def test_unknown_feature_set() -> None:
    none = np.empty(0, np.int64)
    pairs = pair_features(np.empty((0, 4)), None, none, none, none)
    with pytest.raises(RequestError, match=r"expected features of thesis, extended, .*; got 'smell'"):
        feature_rows(pairs, "smell")  # type: ignore[arg-type]
