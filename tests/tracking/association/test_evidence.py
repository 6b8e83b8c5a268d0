"""Features of detections, links and joins: known values, bounds, and what does not change them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.chain_motion import beliefs_along
from tsuiseki.tracking.association.costs import ActionCost
from tsuiseki.tracking.association.detection_tables import DetectionTable
from tsuiseki.tracking.association.evidence import (
    DETECTION_FEATURES,
    JOIN_FEATURES,
    LINK_FEATURES,
    LinkParts,
    LinkWeigher,
    detection_evidence,
    link_evidence,
)
from tsuiseki.tracking.association.inference_times import InferenceTimes
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.association.tracklets import evidence_of_joins, join_parts
from tsuiseki.tracking.people.flow_input import FlowInput, InputSettings
from tsuiseki.tracking.types import Detections

COST = LinkCost()


def seen_of(boxes: list[list[list[float]]], size: tuple[int, int] | None = (640, 480)) -> DetectionTable:
    """Detections of each frame at 30 frames a second."""
    prepared = FlowInput(InputSettings(follow_camera=False), InferenceTimes(30.0), size)
    return prepared.rows([Detections(np.array(frame).reshape(-1, 4), np.ones(len(frame))) for frame in boxes])[0]


def parts_of(seen: DetectionTable, i: list[int], j: list[int], cost: LinkCost = COST) -> LinkParts:
    beliefs = beliefs_along(np.full(len(seen), -1), seen.measured, COST.motion)
    return LinkWeigher(seen, cost, beliefs).parts((np.array(i, np.int64), np.array(j, np.int64)), np.inf)[1]


def test_features_of_detections() -> None:
    seen = seen_of([[[100, 100, 140, 200], [120, 100, 160, 200]], [[100, 100, 140, 200]]])
    rows = detection_evidence(seen, np.array([-3.0, -2, -1]), np.array([2.0, 1, 0]))
    table = dict(zip(DETECTION_FEATURES, rows.T, strict=True))
    np.testing.assert_allclose(table["cost"], [-3, -2, -1])
    np.testing.assert_allclose(table["left"], [1, 1.2, 1])
    np.testing.assert_allclose(table["bottom"], 2)  # 2.8 heights away is far
    np.testing.assert_allclose(table["overlap_after"], [1, 1 / 3, 0])
    np.testing.assert_allclose(table["overlap_before"], [0, 0, 1])
    np.testing.assert_allclose(table["overlap_now"], [1 / 3, 1 / 3, 0])
    np.testing.assert_allclose(table["neighbours"], np.log([2, 2, 1]))
    np.testing.assert_allclose(table["interval"], 0)


def test_the_larger_of_two_overlapping_boxes_is_overlapped_too() -> None:
    detections = seen_of([[[100, 100, 300, 500], [270, 100, 290, 140]]])
    rows = detection_evidence(detections, np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(rows[:, DETECTION_FEATURES.index("overlap_now")], 800 / 80_000)


def test_borders_are_far_where_the_image_has_no_size() -> None:
    seen = seen_of([[[0, 0, 10, 20]]], size=None)
    table = dict(zip(DETECTION_FEATURES, detection_evidence(seen, np.zeros(1), np.zeros(1)).T, strict=True))
    assert table["left"] == table["top"] == 2


def test_features_of_links() -> None:
    seen = seen_of([[[100, 100, 140, 200]], [[102, 100, 142, 200], [150, 100, 190, 200]]])
    parts = parts_of(seen, [0, 0], [1, 2])
    table = dict(zip(LINK_FEATURES, link_evidence(seen, parts, COST.motion).T, strict=True))
    np.testing.assert_allclose(table["cost"], parts.cost)
    np.testing.assert_allclose(table["seconds"], 1 / 30)
    np.testing.assert_allclose(table["gap"], 0)
    np.testing.assert_allclose(table["overlap"], [38 / 42, 0])
    np.testing.assert_allclose(table["speed"], 0)
    assert table["ahead_x"][0] < table["ahead_x"][1]
    # Each is above the other by as much as the other is below it.
    np.testing.assert_allclose(table["above_tail"][0], -table["above_tail"][1])
    # Nothing else leads to either head.
    np.testing.assert_allclose(table["above_head"], -12)


def test_a_link_is_described_the_same_wherever_it_lies() -> None:
    boxes = [[[100, 100, 140, 200]], [[105, 103, 146, 201]]]
    moved = [[[x + 60 for x in box] for box in frame] for frame in boxes]
    rows = [link_evidence(s, parts_of(s, [0], [1]), COST.motion) for s in (seen_of(boxes), seen_of(moved))]
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-9)


def test_unlike_looks_are_seen() -> None:
    seen = seen_of([[[100, 100, 140, 200]], [[102, 100, 142, 200]]])
    seen = replace(seen, features=np.array([[1.0, 0], [0, 1]]))
    table = dict(zip(LINK_FEATURES, link_evidence(seen, parts_of(seen, [0], [1]), COST.motion).T, strict=True))
    assert table["appearance"] == table["appearance_known"] == 1


def acting(least: float = 0.0) -> tuple[DetectionTable, LinkParts, LinkCost]:
    """One who goes on with what they did and one who does something else, where actions have a price."""
    seen = seen_of([[[100, 100, 140, 200]], [[102, 100, 142, 200], [104, 100, 144, 200]]])
    seen = replace(seen, actions=np.array([[0.9, 0.1], [0.9, 0.1], [0.1, 0.9]]))
    cost = replace(COST, action=ActionCost(least=least))
    return seen, parts_of(seen, [0, 0], [1, 2], cost), cost


def test_unlike_actions_are_seen() -> None:
    seen, parts, cost = acting()
    assert cost.action is not None
    table = dict(zip(LINK_FEATURES, link_evidence(seen, parts, COST.motion).T, strict=True))
    distance = 1 - 0.18 / 0.82
    expected = cost.action.weight[0] * (np.array([0, distance]) - cost.action.neutral[0])
    np.testing.assert_allclose(table["action"], expected)
    np.testing.assert_allclose(table["action_known"], 1)
    # It is a part of the cost by default, which stays what it was.
    without = parts_of(replace(seen, actions=None), [0, 0], [1, 2], cost)
    np.testing.assert_allclose(parts.cost - without.cost, expected)


@pytest.mark.parametrize("why", ["nothing recognised", "no price"])
def test_actions_that_are_not_known_are_said_so(why: str) -> None:
    seen, _, cost = acting()
    seen, cost = (replace(seen, actions=None), cost) if why == "nothing recognised" else (seen, COST)
    table = dict(zip(LINK_FEATURES, link_evidence(seen, parts_of(seen, [0], [2], cost), COST.motion).T, strict=True))
    assert table["action"] == table["action_known"] == 0


def test_joins_see_what_people_do() -> None:
    seen, _, cost = acting()
    labels = np.array([0, 1, 2])
    parts = join_parts(seen, labels, None, cost)
    unlike = dict(zip(zip(parts.i.tolist(), parts.j.tolist(), strict=True), parts.action, strict=True))
    assert unlike[0, 2] > unlike[0, 1] + 5


def test_features_of_joins() -> None:
    seen = seen_of([[[100, 100, 140, 200]] if k % 10 == 0 or k == 31 else [] for k in range(32)])
    labels = np.array([0, 0, 0, 0, 1])
    rows = evidence_of_joins(seen, labels, parts_of(seen, [3], [4]), COST)
    np.testing.assert_allclose(rows[0, -4:], [np.log(4), 0, np.log(2), 0])


@pytest.mark.parametrize("boxes", [[[]], [[[0, 0, 10, 20]]]], ids=["nothing", "one box"])
def test_nothing_to_link(boxes: list[list[list[float]]]) -> None:
    seen = seen_of(boxes)
    count = len(seen)
    assert detection_evidence(seen, np.zeros(count), np.zeros(count)).shape == (count, len(DETECTION_FEATURES))
    none: list[int] = []
    if count:
        parts = parts_of(seen, none, none)
        alone = np.full(count, -1)
        assert link_evidence(seen, parts, COST.motion).shape == (0, len(LINK_FEATURES))
        assert evidence_of_joins(seen, alone, parts, COST).shape == (0, len(JOIN_FEATURES))
