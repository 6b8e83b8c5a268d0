"""Links priced by what people do: closed forms, and a flow that only actions can tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.costs import ActionCost, action_distances
from tsuiseki.tracking.association.flow_window import FlowCosts
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.types import Detections


def test_the_distance_is_the_cosines_and_the_cost_a_line() -> None:
    actions = np.array([[1.0, 0.0], [0.0, 0.5], [0.6, 0.8]])
    i, j = np.array([0, 0, 1]), np.array([1, 2, 2])
    np.testing.assert_allclose(action_distances(actions, actions, i, j), [1, 0.4, 0.2])
    cost = ActionCost(weight=(2.0, 5.0), neutral=(0.1, 0.2))
    np.testing.assert_allclose(cost(actions, actions, i, j, np.ones(3), averaged=False), [1.8, 0.6, 0.2])
    np.testing.assert_allclose(cost(actions, actions, i, j, np.ones(3), averaged=True), [4, 1, 0], atol=1e-12)


def test_windows_look_where_they_should() -> None:
    frames, labels = np.arange(5), np.zeros(5, np.int64)
    actions = np.arange(5.0)[:, None]
    single = ActionCost("single").means(frames, labels, actions, 10.0)
    np.testing.assert_array_equal(single, [actions, actions])
    before, after = ActionCost("one-sided", window=0.4).means(frames, labels, actions, 10.0)
    np.testing.assert_allclose(before.ravel(), [0, 0.5, 1, 2, 3])
    np.testing.assert_allclose(after.ravel(), [1, 2, 3, 3.5, 4])
    centred, same = ActionCost("centred", window=0.2).means(frames, labels, actions, 10.0)
    np.testing.assert_allclose(centred.ravel(), [0.5, 1, 2, 3, 3.5])
    assert same is centred


def test_what_cannot_be_a_cost_is_refused() -> None:
    with pytest.raises(ValueError, match="window"):
        ActionCost(window=-1.0)


def meeting(noise: float, seed: int) -> list[Detections]:
    """Two people run towards each other, embrace unseen, and run back; one reads, the other phones."""
    rng, frames = np.random.default_rng(seed), []
    for t in range(60):
        away = 60 - 3.0 * t if t < 20 else (3.0 * (t - 40) if t >= 40 else 0.0)
        if 20 <= t < 40:
            frames.append(Detections(np.empty((0, 4)), np.empty(0), None, np.empty((0, 2))))
            continue
        x = np.array([300 - away, 310 + away])
        boxes = np.column_stack([x - 12, np.full(2, 100.0), x + 12, np.full(2, 160.0)])
        actions = np.clip(np.eye(2) + rng.normal(0, noise, (2, 2)), 0, 1)
        frames.append(Detections(boxes, np.full(2, 0.9), None, actions))
    return frames


def straight_on(action: ActionCost | None, seed: int) -> bool:
    """Whether the flow has both go on in the direction that they came from, as motion has it."""
    costs = FlowCosts(link=LinkCost(action=action))
    tracker = FlowTracker(replace(FlowSettings(), costs=costs), frame_rate=25.0)
    for found in meeting(0.3, seed):
        tracker.update(found)
    first, _ = tracker.tracks()
    return bool((first.boxes[0, 0] < 300) != (first.boxes[-1, 0] < 300))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_actions_tell_apart_whom_motion_confuses(seed: int) -> None:
    assert straight_on(None, seed)
    assert not straight_on(ActionCost(weight=(6.0, 12.0)), seed)
