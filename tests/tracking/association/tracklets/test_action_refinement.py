"""Averaging actions along tracks, and the alternation with the flow."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.costs import HandSetCost, ObservationCost, PairFeatures
from tsuiseki.tracking.association.flow.network_flow import build_graph, solve, track_labels
from tsuiseki.tracking.association.flow.repricing import action_distances
from tsuiseki.tracking.association.gating import GateSettings
from tsuiseki.tracking.association.rows import DetectionRows
from tsuiseki.tracking.association.tracklets.action_refinement import (
    Prices,
    RefinementSettings,
    refine,
    window_means,
)
from tsuiseki.tracking.types import FloatArray, IntArray

SIZE = np.array([8.0, 15.0])
SETTINGS = RefinementSettings(GateSettings(3, reach=3.0, speed=0.5), entry=5, exit=5, miss=0.1, windows="centred")


def slow_means(frames, labels, actions, window):
    """Eq. 5.3 word for word, with the number of frames present."""
    result = actions.copy()
    for k in range(len(frames)):
        if labels[k] >= 0:
            near = (labels == labels[k]) & (np.abs(frames - frames[k]) <= window // 2)
            result[k] = actions[near].mean(axis=0)
    return result


@pytest.mark.parametrize("window", [1, 3, 15])
def test_windows_are_means_over_the_frames_that_are_there(window: int) -> None:
    rng = np.random.default_rng(window)
    keys = rng.permutation(5 * 40)[:90]
    frames, labels = keys % 40 + 7, keys // 40 - 1
    actions = rng.random((90, 4))
    found = window_means(frames, labels, actions, frames, labels, (window // 2, window // 2))
    np.testing.assert_allclose(found, slow_means(frames, labels, actions, window), atol=1e-12)


def test_windows_at_frames_without_a_detection() -> None:
    frames, labels = np.array([0, 1, 8]), np.zeros(3, np.int64)
    actions = np.array([[0.0], [2.0], [4.0]])
    found = window_means(frames, labels, actions, np.array([2, 5, 30, 2]), np.array([0, 0, 0, -1]), (3, 3))
    np.testing.assert_allclose(found.ravel(), [1, 4, np.nan, np.nan])


def test_action_distance_is_the_cosine_s() -> None:
    actions = np.array([[1, 0], [0, 0.2], [3, 0], [0, 0.0]])
    np.testing.assert_allclose(
        action_distances(actions, actions, np.zeros(4, int), np.arange(4)), [0, 1, 0, 1], atol=1e-12
    )


class Priced:
    """Distance of places plus that of actions; counts what it is asked."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __call__(self, pairs: PairFeatures) -> FloatArray:
        self.asked.append(len(pairs))
        action = 0.0 if pairs.action is None else pairs.action
        return np.abs(pairs.dx) + np.abs(pairs.dy) + 6 * action


def walkers(seed: int, frames: int = 40, people: int = 4) -> tuple[DetectionRows, FloatArray]:
    """People who stand close together, a quarter of the detections missing, actions noisy."""
    rng = np.random.default_rng(seed)
    at = np.array([(t, k) for t in range(frames) for k in range(people) if rng.random() < 0.75])
    centre = np.column_stack([20.0 * at[:, 1], np.full(len(at), 50.0)]) + rng.normal(0, 6, (len(at), 2))
    boxes = np.concatenate([centre - SIZE, centre + SIZE], axis=1)
    actions = np.full((len(at), 4), 0.1)
    actions[np.arange(len(at)), at[:, 1] % 4] = 0.6
    actions = np.clip(actions + rng.normal(0, 0.25, actions.shape), 0.01, 1)
    return DetectionRows(np.arange(len(at)), at[:, 0], boxes, np.full(len(at), 0.9), None), actions


def prices() -> Prices:
    return Prices(ObservationCost(0, -3, 0), Priced())


def test_the_first_flow_is_that_of_single_frame_features() -> None:
    rows, actions = walkers(0)
    first = next(refine(rows, actions, prices(), SETTINGS))
    from tsuiseki.tracking.association.costs import pair_features
    from tsuiseki.tracking.association.gating import candidate_pairs

    i, j, gap = candidate_pairs(rows.frames, rows.boxes, SETTINGS.gate)
    pairs = replace(pair_features(rows.boxes, None, i, j, gap), action=action_distances(actions, actions, i, j))
    graph = build_graph(ObservationCost(0, -3, 0)(rows.scores), [(i, j, Priced()(pairs) + 0.1 * (gap - 1))], 5, 5)
    solution = solve(graph)
    assert first.solution.cost == pytest.approx(solution.cost)
    np.testing.assert_array_equal(first.labels, track_labels(solution))


@pytest.mark.parametrize("seed", range(4))
def test_every_flow_is_the_cheapest_under_the_features_of_the_one_before(seed: int) -> None:
    """Prices that are taken over from the iteration before give the same flow as pricing all pairs anew."""
    rows, actions = walkers(seed)
    flows = list(refine(rows, actions, prices(), SETTINGS))
    assert len(flows) >= 2
    for before, after in itertools.pairwise(flows):
        assert before.actions is not None
        anew = next(refine(rows, before.actions, prices(), SETTINGS))
        # Distances that change by less than a thousandth keep their price: 6e-3 a pair at most.
        assert after.solution.cost == pytest.approx(anew.solution.cost, abs=6e-3 * len(rows))


def test_it_stops_when_tracks_come_again_and_prices_only_what_changed() -> None:
    rows, actions = walkers(1)
    cost = Priced()
    flows = list(refine(rows, actions, Prices(ObservationCost(0, -3, 0), cost), replace(SETTINGS, iterations=30)))
    assert len(flows) < 30
    keys = [flow.labels.tobytes() for flow in flows]
    assert keys[-1] in keys[:-1]
    assert len(set(keys[:-1])) == len(keys) - 1
    assert cost.asked[-1] < cost.asked[0]


def jerked(seed: int, frames: int = 60, people: int = 3) -> tuple[DetectionRows, FloatArray, IntArray]:
    """People who do one thing all the time; three frames in every twenty are bad: places and actions are noise."""
    rng = np.random.default_rng(seed)
    at = np.array([(t, k) for t in range(frames) for k in range(people) if rng.random() < 0.85])
    frame, person = at.T
    bad = (frame % 20 >= 10) & (frame % 20 < 13)
    centre = np.column_stack([25.0 * person, np.full(len(at), 50.0)]) + rng.normal(0, 2, (len(at), 2))
    centre[bad] += rng.normal(0, 15, (bad.sum(), 2))
    actions = np.full((len(at), 4), 0.1)
    actions[np.arange(len(at)), person] = 0.7
    actions = np.clip(actions + rng.normal(0, 0.2, actions.shape), 0.01, 1)
    actions[bad] = rng.random((bad.sum(), 4))
    boxes = np.concatenate([centre - SIZE, centre + SIZE], axis=1)
    return DetectionRows(np.arange(len(at)), frame, boxes, np.full(len(at), 0.9), None), actions, person


def switches(labels: IntArray, person: IntArray) -> int:
    """Times that somebody's track changes."""
    tracks = [labels[(person == k) & (labels >= 0)] for k in np.unique(person)]
    return int(sum((np.diff(track) != 0).sum() for track in tracks))


def test_averages_carry_people_over_frames_that_say_nothing() -> None:
    """The situation of thesis Fig. 5.5, many times over; one-sided windows see more of it than centred ones."""
    single = replace(SETTINGS, iterations=1)
    settings = {"single": single, "centred": SETTINGS, "one-sided": replace(SETTINGS, windows="one-sided")}
    count = dict.fromkeys(settings, 0)
    for seed in range(12):
        rows, actions, person = jerked(seed)
        for name, chosen in settings.items():
            *_, last = refine(rows, actions, prices(), chosen)
            count[name] += switches(last.labels, person)
    assert count["centred"] < 0.97 * count["single"]
    assert count["one-sided"] < 0.9 * count["centred"]


def test_without_actions_there_is_one_flow() -> None:
    rows, _ = walkers(2)
    flows = list(refine(rows, None, Prices(ObservationCost(), HandSetCost()), SETTINGS))
    assert len(flows) == 1
    assert flows[0].actions is None


def test_other_prices_for_the_repetitions_price_all_pairs_once() -> None:
    rows, actions = walkers(3)
    single, multi = Priced(), Priced()
    list(refine(rows, actions, Prices(ObservationCost(0, -3, 0), single, multi), SETTINGS))
    assert len(single.asked) == 1
    assert multi.asked[0] == single.asked[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [({"window": 4}, "odd window"), ({"iterations": 0}, "iteration"), ({"entry": -1.0}, "entry")],
)
def test_impossible_settings(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(SETTINGS, **change)  # type: ignore[arg-type]
