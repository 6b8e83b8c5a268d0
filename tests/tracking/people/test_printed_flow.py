"""The thesis's flow as printed: against a search through all flows, and what the averages along tracks mend."""

from __future__ import annotations

from itertools import pairwise, product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.association.costs import ObservationCost, PairFeatures
from tsuiseki.tracking.association.learnt_costs import FeatureSet
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.printed_flow import BIAS, ENTRY, PrintedFlow
from tsuiseki.tracking.types import Detections, FloatArray


class ByHand(SimpleNamespace):
    """Costs of links by the overlap, and by actions where there are any."""

    @property
    def acting(self) -> bool:
        return bool(self.features == "thesis_action")

    def __call__(self, pairs: PairFeatures) -> FloatArray:
        logit = 8 * pairs.iou - 4
        if pairs.action is not None:
            logit = logit - 60 * pairs.action
        return np.logaddexp(0, -logit)


def costs(features: FeatureSet = "thesis", window: int = 3) -> Any:
    return ByHand(features=features, window=window, observation=ObservationCost(alpha=4.0, beta=-16.0, b=0.0))


def boxes(xs: list[float]) -> FloatArray:
    return np.array([[x, 0, x + 20, 40] for x in xs], dtype=float).reshape(-1, 4)


def cheapest(frames: list[list[float]], score: float) -> float:
    """The objective of eq. 2.17 by trying every way to give detections to tracks in which at most one is missed."""
    price, rows = costs(), [(t, x) for t, xs in enumerate(frames) for x in xs]
    best, observed = 0.0, BIAS + 4.0 - 16.0 * score
    for labels in product(range(-1, len(rows)), repeat=len(rows)):
        total = 0.0
        for track in set(labels) - {-1}:
            own = [row for row, label in zip(rows, labels, strict=True) if label == track]
            if any(b[0] <= a[0] for a, b in pairwise(own)):
                break
            total += 2 * ENTRY + observed * len(own)
            for (t, x), (u, y) in pairwise(own):
                one = [np.zeros(1)] * 4
                overlap = max(0.0, 20 - abs(x - y)) / (40 - max(0.0, 20 - abs(x - y)))
                total += float(price(PairFeatures(np.array([u - t]), np.array([overlap]), np.zeros(1), *one))[0])
        else:
            best = min(best, total)
    return best


def objective(tracks: list[Any], score: float) -> float:
    price, total = costs(), 0.0
    for track in tracks:
        total += 2 * ENTRY + (BIAS + 4.0 - 16.0 * score) * len(track)
        for k in range(len(track) - 1):
            x, y = track.boxes[k, 0], track.boxes[k + 1, 0]
            overlap = max(0.0, 20 - abs(x - y)) / (40 - max(0.0, 20 - abs(x - y)))
            one = [np.zeros(1)] * 4
            gap = np.array([track.frames[k + 1] - track.frames[k]])
            total += float(price(PairFeatures(gap, np.array([overlap]), np.zeros(1), *one))[0])
    return total


@pytest.mark.parametrize("frames", [[[0, 30], [2, 28], [4]], [[0], [], [3, 60]], [[0, 12], [6, 14], [10]]])
def test_the_objective_is_that_of_the_best_of_all_flows(frames: list[list[float]]) -> None:
    tracker = PrintedFlow(costs())
    for xs in frames:
        tracker.update(Detections(boxes(xs), np.full(len(xs), 0.95)))
    assert objective(tracker.tracks(), 0.95) == pytest.approx(cheapest(frames, 0.95), abs=1e-6)


def acting(iterations: int) -> PrintedFlow:
    """One person, whom the action network takes for another at once, and for the same again by and by."""
    tracker = PrintedFlow(costs("thesis_action", window=1), iterations)
    for t in range(21):
        first = {10: 0.1, 11: 0.4, 12: 0.7}.get(t, 0.9)
        tracker.update(Detections(boxes([t]), np.full(1, 0.95), actions=np.array([[first, 1 - first]])))
    return tracker


def test_averages_along_tracks_link_what_single_frames_cut() -> None:
    single, averaged = acting(1), acting(6)
    assert [len(track) for track in single.tracks()] == [10, 11]
    assert [len(track) for track in averaged.tracks()] == [21]
    assert averaged.actions[0] is not None
    assert averaged.actions[0].shape == (21, 2)
    assert averaged.facts()["iterations"] == 6


def test_trees_of_other_features_and_missing_actions_are_refused() -> None:
    with pytest.raises(RequestError, match="thesis or thesis_action, got extended"):
        PrintedFlow(costs("extended"))
    with pytest.raises(RequestError, match="expected action features"):
        PrintedFlow(costs("thesis_action")).update(Detections(boxes([0]), np.ones(1)))


def test_nothing_detected_is_nobody() -> None:
    tracker = PrintedFlow(costs())
    assert tracker.tracks() == []
    tracker.update(Detections.empty())
    assert tracker.tracks() == []
