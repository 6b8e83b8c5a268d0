"""The crowd under a roof: what is labelled, hidden and detected, and that its table compares like with like."""

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.acting_tracks import OKUTAMA_ACTIONS, WITH_OBJECTS
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.trainers.experiments.drone.crowd import CrowdScene, compare, draw_crowd, reproduce
from tsuiseki.trainers.experiments.experiment import Bench, Watch
from tsuiseki.trainers.experiments.store import Store

SCENE = CrowdScene(people=4, seconds=6)


@pytest.fixture
def bench(tmp_path):
    return Bench(Store(tmp_path / "cache"), Watch())


def test_nobody_is_seen_under_the_roof_and_everybody_acts():
    clip = draw_crowd(SCENE, 3)
    assert len(clip.seen) == 18
    assert set(clip.truth.ids.tolist()) == {1, 2, 3, 4}
    middle = clip.truth.boxes[:, [0, 2]].mean(axis=1) - SCENE.size[0] / 2
    np.testing.assert_array_equal(clip.truth.evaluated, np.abs(middle) >= SCENE.roof / 2 * SCENE.pixels)
    for detections in clip.seen:
        assert detections.actions is not None
        assert (detections.actions.sum(axis=1) >= 1).all()  # false boxes, too


def test_everybody_keeps_one_thing_of_their_own():
    clip, as_drawn = draw_crowd(replace(SCENE, own_actions=WITH_OBJECTS), 3), draw_crowd(SCENE, 3)
    np.testing.assert_array_equal(clip.truth.boxes, as_drawn.truth.boxes)
    columns = [OKUTAMA_ACTIONS.index(name) for name in WITH_OBJECTS]
    kept = {}
    for frame, detections in enumerate(clip.seen):
        assert (detections.actions[:, columns].sum(axis=1) == 1).all()
        there = np.flatnonzero((clip.truth.frames == frame) & clip.truth.evaluated)
        found, labels = assign_overlaps(iou_matrix(detections.boxes, clip.truth.boxes[there]), 0.3)
        for row, label in zip(found, clip.truth.ids[there[labels]], strict=True):
            kept.setdefault(int(label), set()).add(int(detections.actions[row, columns].argmax()))
    assert kept.keys() == {1, 2, 3, 4}
    assert all(len(things) == 1 for things in kept.values())


def test_the_same_seed_draws_the_same_clip():
    one, other = draw_crowd(SCENE, 5), draw_crowd(SCENE, 5)
    np.testing.assert_array_equal(one.truth.boxes, other.truth.boxes)
    for first, second in zip(one.seen, other.seen, strict=True):
        np.testing.assert_array_equal(first.boxes, second.boxes)
        np.testing.assert_array_equal(first.actions, second.actions)


def test_a_row_a_method_with_the_cost_chosen_elsewhere(bench):
    values, table = compare(bench.store, 1, SCENE)
    assert [row[0] for row in table.rows] == [
        "flow", "flow-SAF", "flow-MAF, centred windows", "flow-MAF, one-sided windows"
    ]  # fmt: skip
    found, flow = values["flow-SAF"], values["flow"]
    expected = found["id_switches"] - flow["id_switches"]
    assert found["against_flow"]["id_switches"]["difference"] == expected


def test_a_frame_rate_that_does_not_divide_thirty_is_refused(bench):
    with pytest.raises(RequestError, match="divisor of 30"):
        reproduce(bench, 1, 7)
