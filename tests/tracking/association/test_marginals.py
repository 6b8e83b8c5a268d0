"""Min-marginals and mended flows against flows that are solved anew with the decision forced."""

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.marginals import Marginals
from tsuiseki.tracking.association.network_flow import FlowGraph, solve
from tsuiseki.tracking.association.residual_flow import FORBIDDEN, FORCED, FREE, InfeasibleError, ResidualFlow

# So much that no other cost matters, and little enough that sums stay exact to 1e-9.
FORCE = 4096.0


def random_graph(seed, frames=6, most=5):
    rng = np.random.default_rng(seed)
    frame = np.repeat(np.arange(frames), rng.integers(1, most + 1, frames))
    tail, head = np.nonzero((frame[None] > frame[:, None]) & (frame[None] - frame[:, None] < 3))
    kept = rng.random(len(tail)) < 0.7

    def costs(low, high, count):
        return rng.uniform(low, high, count).round(int(rng.integers(0, 7)))

    count = len(frame)
    return FlowGraph(
        costs(-4, 1, count),
        costs(0, 4, count),
        costs(0, 4, count),
        tail[kept],
        head[kept],
        costs(-1, 6, int(kept.sum())),
    )


def forced(graph, status):
    """Cost of the cheapest flow with arcs forced (1) and forbidden (-1), all solved anew."""
    parts, counts = ("observation", "entry", "exit", "transition"), [len(graph)] * 3 + [len(graph.tail)]
    pieces = np.split(status, np.cumsum(counts)[:-1])
    changed = {name: getattr(graph, name) - FORCE * piece for name, piece in zip(parts, pieces, strict=True)}
    return solve(replace(graph, **changed)).cost + FORCE * (status == FORCED).sum()


def flow_of(graph):
    return ResidualFlow(graph, solve(graph))


@pytest.mark.parametrize("seed", range(25))
def test_min_marginals_are_those_of_flows_with_the_decision_forced(seed):
    graph = random_graph(seed)
    flow = flow_of(graph)
    found = Marginals(flow, limit=100.0)
    for arc in range(len(flow.cost)):
        status = np.zeros(len(flow.cost), dtype=int)
        status[arc] = FORBIDDEN if flow.used[arc] else FORCED
        assert found.cost[arc] == pytest.approx(forced(graph, status) - flow.total, abs=1e-9)
        other = flow.used.copy()
        other[found.cycle(arc)] ^= True
        assert other[arc] != flow.used[arc]
        assert flow.cost[other].sum() / 1e6 == pytest.approx(flow.total + found.cost[arc], abs=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_below_a_limit_they_are_exact_and_above_it_they_are_the_limit(seed):
    flow = flow_of(random_graph(seed))
    exact, cut = Marginals(flow, limit=100.0).cost, Marginals(flow, limit=1.5).cost
    assert cut == pytest.approx(np.minimum(exact, 1.5), abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_a_mended_flow_costs_what_one_solved_anew_costs(seed):
    graph, rng = random_graph(seed, frames=7), np.random.default_rng(seed)
    flow = flow_of(graph)
    status = np.zeros(len(flow.cost), dtype=int)
    for _ in range(12):
        wanted = status.copy()
        wanted[rng.integers(len(status), size=2)] = rng.choice([FREE, FREE, FORBIDDEN, FORCED], 2)
        before = flow.used.copy()
        try:
            flow.constrain(wanted)
        except InfeasibleError:
            assert (flow.used == before).all()
            assert (flow.status == status).all()
            # A flow that must break a demand pays for it.
            assert forced(graph, wanted) > FORCE / 2
            continue
        status = wanted
        assert flow.total == pytest.approx(forced(graph, status), abs=1e-9)
        assert flow.solution().cost == pytest.approx(flow.total, abs=1e-9)
        free = status == FREE
        assert (flow.reduced[free & ~flow.used] >= 0).all()
        assert (flow.reduced[free & flow.used] <= 0).all()


@pytest.mark.parametrize("seed", range(8))
def test_min_marginals_hold_under_constraints(seed):
    graph, rng = random_graph(seed), np.random.default_rng(100 + seed)
    flow = flow_of(graph)
    status = np.zeros(len(flow.cost), dtype=int)
    used = np.flatnonzero(flow.used[3 * len(graph) :]) + 3 * len(graph)
    status[rng.choice(used, 2, replace=False)] = FORBIDDEN
    status[rng.integers(len(graph))] = FORCED
    flow.constrain(status)
    found = Marginals(flow, limit=100.0)
    assert np.isinf(found.cost[status != FREE]).all()
    for arc in np.flatnonzero(status == FREE):
        other = status.copy()
        other[arc] = FORBIDDEN if flow.used[arc] else FORCED
        cost = forced(graph, other) - flow.total
        assert found.cost[arc] == pytest.approx(min(cost, 100.0), abs=1e-9)


def test_a_flow_that_is_not_the_cheapest_is_refused():
    graph = random_graph(3)
    best = solve(graph)
    with pytest.raises(ValueError, match="cheaper"):
        ResidualFlow(graph, replace(best, used=np.zeros_like(best.used), follower=np.full_like(best.follower, -1)))
