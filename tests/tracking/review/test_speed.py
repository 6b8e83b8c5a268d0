"""Corrections of long and of dense results: their time grows with the length, not with its square."""

import time

import numpy as np
import pytest

from tests.tracking.review.test_resolving import anew, street
from tsuiseki.tracking.association import near_links
from tsuiseki.tracking.association.corrected_flow import CorrectedFlow
from tsuiseki.tracking.association.network_flow import track_labels
from tsuiseki.tracking.association.residual_flow import FORBIDDEN, ResidualFlow
from tsuiseki.tracking.association.sliding_flow import solve_in_windows
from tsuiseki.tracking.formats.correction_log import Correction, boxes_of


def longest(flow):
    """Rows of the longest track."""
    labels = track_labels(flow.solution())
    return np.flatnonzero(labels == np.bincount(labels[labels >= 0]).argmax())


def delete(network, rows):
    return Correction("delete", boxes_of(network.frames[rows].tolist(), network.boxes[rows].tolist()))


def test_a_deleted_track_is_solved_once(monkeypatch):
    counts = []
    reroute = ResidualFlow._reroute
    monkeypatch.setattr(ResidualFlow, "_reroute", lambda *words: counts.append(1) or reroute(*words))
    for frames in (150, 600):
        network = street(frames, 6)
        corrected = CorrectedFlow(network)
        rows = longest(corrected.flow)
        assert len(rows) > frames / 2
        counts.clear()
        corrected.correct([delete(network, rows)])
        assert len(counts) <= 2
        assert not corrected.flow.used[rows].any()
        assert corrected.flow.total == pytest.approx(anew(corrected.flow), abs=1e-4)
        counts.clear()
        corrected.correct([])
        assert not counts
        assert corrected.flow.used[rows].all()


@pytest.mark.slow
def test_the_time_of_a_deleted_track_grows_with_the_length():
    seconds = []
    for frames in (500, 2000):
        network = street(frames, 10)
        corrected = CorrectedFlow(network)
        correction = delete(network, longest(corrected.flow))
        begin = time.process_time()
        corrected.correct([correction])
        corrected.correct([])
        seconds.append(time.process_time() - begin)
    # Four times the length: four times the time, and not sixteen.
    assert seconds[1] < 8 * seconds[0]


@pytest.mark.parametrize("seed", range(6))
def test_detections_that_leave_together_leave_the_cheapest_flow(seed):
    network, rng = street(60, 6, seed), np.random.default_rng(seed)
    flow = ResidualFlow(network.graph, solve_in_windows(network.graph))
    status = flow.status.copy()
    # Whole tracks, beginnings, ends and holes.
    used = np.flatnonzero(flow.used[: flow.count])
    begin = int(rng.integers(len(used) // 2))
    status[used[begin : begin + len(used) // 4]] = FORBIDDEN
    status[rng.choice(used, 20, replace=False)] = FORBIDDEN
    status[longest(flow)[3:]] = FORBIDDEN
    flow.constrain(status)
    assert flow.total == pytest.approx(anew(flow), abs=1e-4)
    reduced = np.where(flow.used, -flow.reduced, flow.reduced)
    assert (reduced[flow.status == 0] >= 0).all()
    flow.constrain(np.zeros_like(status))
    assert flow.total == pytest.approx(anew(flow), abs=1e-4)


def test_a_dense_network_is_solved_on_few_links_and_exactly(monkeypatch):
    monkeypatch.setattr(near_links, "FEW", 2)
    monkeypatch.setattr(near_links, "FIRST", 1)
    monkeypatch.setattr(near_links, "NEAR", 0.5)
    graph = street(120, 8).graph
    near, flow = near_links.solved_on_near_links(graph)
    assert 0 < near.sum() < len(near)
    assert flow.total == pytest.approx(solve_in_windows(graph).cost, abs=1e-4)
    cost = near_links.scaled(graph.transition)
    reduced = cost + flow.potential[2 * graph.tail + 1] - flow.potential[2 * graph.head]
    assert (reduced[~near] >= 0).all()


def test_a_correction_that_fails_changes_nothing():
    network = street(60, 4)
    corrected = CorrectedFlow(network)
    rows = longest(corrected.flow)
    first = [delete(network, rows)]
    corrected.correct(first)
    labels, size = corrected.labels(), len(corrected.network)
    boxes = boxes_of(network.frames[rows[:1]].tolist(), network.boxes[rows[:1]].tolist())
    with pytest.raises(ValueError, match="right"):
        corrected.correct([Correction("not_person", boxes), Correction("real", boxes)])
    assert len(corrected.network) == size
    assert np.array_equal(corrected.labels(), labels)
