"""Candidate pairs against all pairs, and the hand-set costs in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.costs import ObservationCost, ProbabilityCost, cosine_distances, pair_features
from tsuiseki.tracking.association.pairwise_flow import GateSettings, HandSetCost, candidate_pairs


def _clutter(rng: np.random.Generator, count: int, frames: int) -> tuple[np.ndarray, np.ndarray]:
    corner, size = rng.uniform(-100, 300, (count, 2)), rng.uniform(20, 60, (count, 2))
    return rng.integers(5, 5 + frames, count), np.hstack([corner, corner + size])


@pytest.mark.parametrize("seed", range(4))
def test_candidates_are_all_pairs_within_the_gate(seed: int) -> None:
    frames, boxes = _clutter(np.random.default_rng(seed), 300, 20)
    gate = GateSettings(window=4, reach=0.7, speed=0.2, size_ratio=1.5)
    i, j, gap = candidate_pairs(frames, boxes, gate)
    centre, height = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 3] - boxes[:, 1]
    apart = np.linalg.norm(centre[:, None] - centre[None], axis=2)
    between = frames[None] - frames[:, None]
    ratio = height[None] / height[:, None]
    wanted = (between >= 1) & (between <= 4) & (apart <= height[:, None] * (0.7 + 0.2 * (between - 1)))
    wanted &= (ratio <= 1.5) & (1 / ratio <= 1.5)
    assert 0 < wanted.sum() < (between >= 1).sum()
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == set(zip(*np.nonzero(wanted), strict=True))
    np.testing.assert_array_equal(frames[j] - frames[i], gap)
    assert (np.diff(i) >= 0).all()


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_detections_make_no_pair(count: int) -> None:
    pairs = candidate_pairs(np.zeros(count, int), np.ones((count, 4)).cumsum(axis=1), GateSettings())
    assert all(len(part) == 0 for part in pairs)


def test_one_frame_makes_no_pair() -> None:
    _, boxes = _clutter(np.random.default_rng(0), 10, 1)
    assert len(candidate_pairs(np.full(10, 7), boxes, GateSettings())[0]) == 0


@pytest.mark.parametrize("wrong", [{"window": 0}, {"reach": 0.0}, {"size_ratio": 0.5}, {"speed": float("nan")}])
def test_the_gate_must_make_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        GateSettings(**wrong)  # type: ignore[arg-type]


def test_pair_features_by_hand() -> None:
    boxes = np.array([[0, 0, 10, 20.0], [5, 0, 15, 20], [0, 0, 20, 40]])
    looks = np.array([[1.0, 0], [0, 1], [np.nan, np.nan]])
    pairs = pair_features(boxes, looks, np.array([0, 0]), np.array([1, 2]), np.array([1, 3]))
    np.testing.assert_allclose(pairs.iou, [1 / 3, 1 / 4])
    np.testing.assert_allclose(pairs.dx, [5 / 20, 5 / 30])
    np.testing.assert_allclose(pairs.dy, [0, 10 / 30])
    np.testing.assert_allclose(pairs.dw, [0, np.log(2)])
    np.testing.assert_allclose(pairs.dh, [0, np.log(2)])
    np.testing.assert_allclose(pairs.appearance, [1, np.nan])
    assert pairs.gap.tolist() == [1, 3]


def test_distances_in_pieces_are_the_distances() -> None:
    rng = np.random.default_rng(0)
    looks = rng.normal(size=(50, 1_500_000 // 50))
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    i, j = rng.integers(0, 50, 200), rng.integers(0, 50, 200)
    np.testing.assert_allclose(cosine_distances(looks, i, j), 1 - (looks @ looks.T)[i, j], atol=1e-12)


def test_observation_cost_is_equations_2_12_and_2_13() -> None:
    alpha, beta, b, scores = 1.5, -4.0, -0.5, np.linspace(0, 1, 7)
    p = 1 / (1 + np.exp(alpha + beta * scores))
    np.testing.assert_allclose(ObservationCost(alpha, beta, b)(scores), b - np.log(p / (1 - p)), rtol=1e-12)


BY_HAND = HandSetCost(bias=-5.0, noise=0.06, speed=0.04, appearance=14.0, neutral=0.27)


def _pairs(**change: float) -> np.ndarray:
    """Costs of a pair and of one that differs more in one respect."""
    base = {"x": 0.0, "height": 50.0, "gap": 1, "turn": 0.3}
    costs = []
    for values in (base, {**base, **change}):
        h, x, angle = values["height"], values["x"], values["turn"]
        boxes = np.array([[0, 0, 20, 50.0], [x, 25 - h / 2, x + 20, 25 + h / 2]])
        looks = np.array([[1.0, 0], [np.cos(angle), np.sin(angle)]])
        pairs = pair_features(boxes, looks, np.array([0]), np.array([1]), np.array([int(values["gap"])]))
        costs.append(BY_HAND(pairs)[0])
    return np.array(costs)


@pytest.mark.parametrize("change", [{"x": 10.0}, {"height": 65.0}, {"gap": 9}, {"turn": 0.9}])
def test_the_less_alike_the_dearer(change: dict[str, float]) -> None:
    near, far = _pairs(**change)
    assert 0 < near < far < np.inf


def test_a_longer_gap_explains_a_longer_way() -> None:
    assert _pairs(x=40.0)[1] > _pairs(x=40.0, gap=10)[1]


def test_unknown_looks_count_as_neutral() -> None:
    boxes = np.array([[0, 0, 20, 50.0], [2, 0, 22, 50]])
    cost = replace(BY_HAND, neutral=0.25)
    arguments = np.array([0]), np.array([1]), np.array([1])
    looks = np.array([[1.0, 0], [0.75, np.sqrt(1 - 0.75**2)]])
    unknown = cost(pair_features(boxes, None, *arguments))
    np.testing.assert_allclose(unknown, cost(pair_features(boxes, looks, *arguments)))
    np.testing.assert_allclose(unknown, cost(pair_features(boxes, looks * np.nan, *arguments)))


def test_scores_that_are_probabilities_cost_their_logit() -> None:
    p = np.array([0.1, 0.5, 0.8])
    np.testing.assert_allclose(ProbabilityCost(b=-0.5)(p), -0.5 + np.log((1 - p) / p))
    assert np.isfinite(ProbabilityCost()(np.array([0.0, 1.0]))).all()
