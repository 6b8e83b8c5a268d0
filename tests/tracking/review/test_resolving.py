"""Corrections of a whole street: the same flow as one that is solved anew, and soon."""

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.corrected_flow import CorrectedFlow
from tsuiseki.tracking.association.network_flow import FlowGraph
from tsuiseki.tracking.association.residual_flow import FORCED
from tsuiseki.tracking.association.sliding_flow import solve_in_windows
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.formats.correction_log import Correction, boxes_of


def street(frames=1000, people=30, seed=0):
    """A network of people who walk on circles, some detections missing."""
    rng = np.random.default_rng(seed)
    t, n = np.meshgrid(np.arange(frames), np.arange(people), indexing="ij")
    angle = 0.01 * t * (1 + n % 3) + n
    place = np.stack([600 + 400 * np.cos(angle) + 5 * n, 400 + 200 * np.sin(angle) + n], axis=-1)
    seen = rng.random(t.shape) < 0.9
    frame, place = t[seen], place[seen] + rng.normal(0, 1.5, (int(seen.sum()), 2))
    boxes = np.concatenate([place, place + np.array([30, 80])], axis=1)
    tail, head = [], []
    edges = np.searchsorted(frame, np.arange(frames + 1))
    for gap in (1, 2, 3):
        for f in range(frames - gap):
            a, b = np.arange(edges[f], edges[f + 1]), np.arange(edges[f + gap], edges[f + gap + 1])
            near = np.hypot(*(place[a][:, None] - place[b][None]).transpose(2, 0, 1)) < 40
            i, j = np.nonzero(near)
            tail.append(a[i])
            head.append(b[j])
    tail, head = np.concatenate(tail), np.concatenate(head)
    far = np.hypot(*(place[tail] - place[head]).T)
    cost = (far**2 / 200 + 0.8 * (frame[head] - frame[tail] - 1)).round(6)
    count = len(frame)
    graph = FlowGraph(np.full(count, -2.0), np.full(count, 4.0), np.full(count, 4.0), tail, head, cost)
    nobody = np.zeros(count, np.int64)
    origin = np.zeros((count, 2), np.int64)
    return SolvedNetwork(frame, boxes, np.ones(count), origin, graph, nobody, 1, 10, 25.0)


@pytest.fixture(scope="module")
def network():
    return street()


def anew(flow):
    """What the flow costs, solved from scratch with all that is forced and forbidden."""
    force, graph = 1024.0, flow.graph
    parts = np.split(flow.status.astype(float), [len(graph), 2 * len(graph), 3 * len(graph)])
    names = ("observation", "entry", "exit", "transition")
    changed = replace(graph, **{n: getattr(graph, n) - force * p for n, p in zip(names, parts, strict=True)})
    solution = solve_in_windows(changed)
    return solution.cost + force * (flow.status == FORCED).sum()


@pytest.mark.slow
def test_a_correction_of_a_thousand_frames_is_the_flow_that_is_solved_anew(network):
    corrected = CorrectedFlow(network)
    follower = corrected.flow.solution().follower
    rng = np.random.default_rng(1)
    rows = np.sort(rng.choice(np.flatnonzero(follower >= 0), 6, replace=False))

    def boxes(*n):
        return boxes_of(network.frames[list(n)].tolist(), network.boxes[list(n)].tolist())

    said = []
    for n in rows.tolist():
        said.append(Correction("not_person", boxes(int(follower[n]))))
        corrected.correct(said)
        assert corrected.flow.total == pytest.approx(anew(corrected.flow), abs=1e-4)
    assert corrected.flow.solution().follower[rows[0]] != follower[rows[0]]
