"""Two detections on one track or on two, against all flows of small networks."""

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.network_flow import FlowGraph, FlowSolution, solve, track_labels
from tsuiseki.tracking.association.pair_constraints import Pair, holds, satisfy
from tsuiseki.tracking.association.residual_flow import FORBIDDEN, InfeasibleError, ResidualFlow


def network(seed):
    rng = np.random.default_rng(seed)
    frames = np.sort(rng.integers(0, 4, 7))
    gap = frames[None] - frames[:, None]
    tail, head = np.nonzero((gap >= 1) & (gap <= 2))
    costs = rng.uniform(-3, 0.5, 7), rng.uniform(0, 2, 7), rng.uniform(0, 2, 7)
    return frames, FlowGraph(*costs, tail, head, rng.uniform(-1, 3, len(tail)))


def every_flow(graph):
    """Used detections and followers of all flows, one transition after the other."""
    flows = [({}, set())]
    for i in range(len(graph)):
        choices = [-1, *graph.head[graph.tail == i].tolist()]
        flows = [
            (flow | {i: j}, taken | {j} if j >= 0 else taken)
            for flow, taken in flows
            for j in choices
            if j not in taken
        ]
    for flow, _ in flows:
        linked = {i for i, j in flow.items() if j >= 0} | {j for j in flow.values() if j >= 0}
        alone = [i for i in range(len(graph)) if i not in linked]
        follower = np.array([flow[i] for i in range(len(graph))])
        yield np.array([i in linked for i in range(len(graph))]), follower, alone


def cost_of(graph, used, follower):
    link = {(i, j): c for i, j, c in zip(graph.tail, graph.head, graph.transition, strict=True)}
    heads = set(follower[follower >= 0].tolist())
    total = 0.0
    for i in np.flatnonzero(used):
        total += graph.observation[i] + (graph.entry[i] if i not in heads else 0)
        total += graph.exit[i] if follower[i] < 0 else link[i, follower[i]]
    return total


def cheapest(graph, pair):
    best = np.inf
    for used, follower, alone in every_flow(graph):
        used = used.copy()
        # A detection that is linked to none is used where that saves something.
        for i in alone:
            used[i] = graph.observation[i] + graph.entry[i] + graph.exit[i] < 0
        labels = track_labels(FlowSolution(used, follower))
        together = labels[pair.first] == labels[pair.last] >= 0
        if together == pair.same:
            best = min(best, cost_of(graph, used, follower))
    return best


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("same", [True, False])
def test_the_cheapest_flow_in_which_two_detections_are_together_or_apart(seed, same):
    frames, graph = network(seed)
    graph = replace(graph, **{n: getattr(graph, n).round(5) for n in ("observation", "entry", "exit", "transition")})
    rng = np.random.default_rng(seed)
    first, last = sorted(rng.choice(7, 2, replace=False).tolist())
    flow, pair = ResidualFlow(graph, solve(graph)), Pair(first, last, same)
    best = cheapest(graph, pair)
    if holds(flow, [pair])[0]:
        assert flow.total == pytest.approx(best, abs=1e-9)
        return
    if best == np.inf:
        with pytest.raises(InfeasibleError):
            satisfy(flow, pair, frames)
        return
    status, exact = satisfy(flow, pair, frames)
    flow.constrain(status)
    assert exact
    assert holds(flow, [pair])[0]
    assert flow.total == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_a_network_that_grows_keeps_its_cheapest_flow(seed):
    _, graph = network(seed)
    old = np.flatnonzero((graph.tail < 5) & (graph.head < 5))[::2]
    rest = np.setdiff1d(np.arange(len(graph.tail)), old)
    links = np.append(old, rest)
    whole = replace(graph, tail=graph.tail[links], head=graph.head[links], transition=graph.transition[links])
    part = FlowGraph(
        graph.observation[:5], graph.entry[:5], graph.exit[:5], graph.tail[old], graph.head[old], graph.transition[old]
    )
    flow = ResidualFlow(part, solve(part)).grown(whole)
    assert (flow.status[5:7] == FORBIDDEN).all()
    assert not flow.used[5:7].any()
    flow.constrain(np.zeros_like(flow.status))
    assert flow.total == pytest.approx(solve(whole).cost, abs=1e-5)
