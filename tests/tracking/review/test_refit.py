"""Costs of links fitted to answers: kept where answers that were held out agree."""

from dataclasses import replace

import numpy as np

from tsuiseki.tracking.association.corrected_flow import refitted
from tsuiseki.tracking.association.network_flow import FlowGraph
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.formats.correction_log import Correction, boxes_of

COUNT = 40


def pairs(cost):
    """Detections two by two, far from each other, each pair linked at some cost."""
    frames = np.tile([0, 1], COUNT)
    order = np.argsort(frames, kind="stable")
    boxes = np.array([[50.0 * (n // 2), 0, 50.0 * (n // 2) + 20, 40] for n in range(2 * COUNT)])[order]
    tail, head = np.arange(COUNT), COUNT + np.arange(COUNT)
    alone = np.full(2 * COUNT, -4.0), np.full(2 * COUNT, 5.0), np.full(2 * COUNT, 5.0)
    graph = FlowGraph(*alone, tail, head, np.broadcast_to(cost, COUNT).astype(float))
    nobody = np.zeros(2 * COUNT, np.int64)
    return SolvedNetwork(frames[order], boxes, np.ones(2 * COUNT), np.zeros((2 * COUNT, 2), np.int64), graph, nobody)


def said(network, right):
    kinds = np.where(right, "next", "not_same").tolist()
    rows = [[n, COUNT + n] for n in range(COUNT)]
    return [
        Correction(kind, boxes_of(network.frames[r].tolist(), network.boxes[r].tolist()))
        for kind, r in zip(kinds, rows, strict=True)
    ]


def test_links_that_are_wrong_more_often_than_they_cost_become_dearer():
    network = pairs(8.0)
    right = np.random.default_rng(0).random(COUNT) < 0.3
    fitted = refitted(network, said(network, right))
    assert 10.3 < fitted.graph.transition.mean() < 11.5
    assert np.ptp(fitted.graph.transition) < 1e-9


def test_what_the_costs_say_already_leaves_them():
    rng = np.random.default_rng(1)
    logit = rng.normal(0, 2, COUNT)
    network = pairs(10 - logit)
    right = rng.random(COUNT) < 1 / (1 + np.exp(-logit))
    fitted = refitted(network, said(network, right))
    assert np.abs(fitted.graph.transition - network.graph.transition).max() < 1.5


def test_a_few_answers_and_answers_of_one_kind_change_nothing():
    network = pairs(8.0)
    assert refitted(network, said(network, np.ones(COUNT, bool))) is network
    assert refitted(network, said(network, np.arange(COUNT) > 1)[:3]) is network
    empty = replace(network, graph=replace(network.graph, tail=network.graph.tail[:0], head=network.graph.head[:0],
                                           transition=network.graph.transition[:0]))  # fmt: skip
    assert refitted(empty, said(network, np.arange(COUNT) % 2 > 0)) is empty


def test_what_chance_alone_may_do_changes_nothing():
    network = pairs(8.0)
    right = np.arange(COUNT) % 5 > 1
    assert refitted(network, said(network, right)) is network
