"""Flows, assignments and their marginals against enumeration and against a linear programme."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from tests.properties.drawn import matchings, seeds
from tsuiseki.tracking.association.assignment import assign, assign_overlaps
from tsuiseki.tracking.association.marginals import Marginals
from tsuiseki.tracking.association.network_flow import FlowGraph, build_graph, solve, track_labels
from tsuiseki.tracking.association.residual_flow import FORBIDDEN, FORCED, FREE, ResidualFlow
from tsuiseki.tracking.filters.finite_sets.pairs import association_marginals

# Costs of graphs are rounded to a millionth; there are twenty of them at most.
EXACT = 5e-5
counts = st.integers(1, 5)


def graph_of(seed: int, count: int) -> FlowGraph:
    """A network of so many detections in order, some of whose links are there; costs of either sign."""
    rng = np.random.default_rng(seed)
    tail, head = np.array(list(itertools.combinations(range(count), 2)), dtype=np.int64).reshape(-1, 2).T
    there = rng.random(len(tail)) < 0.7
    entry, exit_ = rng.uniform(0, 2, (2, count))
    return FlowGraph(rng.uniform(-4, 1, count), entry, exit_, tail[there], head[there], rng.normal(0, 2, there.sum()))


def flows_of(graph: FlowGraph) -> Iterator[tuple[float, np.ndarray]]:
    """Cost of each set of disjoint tracks, and which arcs it uses: observations, entries, exits and links."""
    count, links = len(graph), list(zip(graph.tail.tolist(), graph.head.tolist(), strict=True))
    costs = np.concatenate([graph.observation, graph.entry, graph.exit, graph.transition])
    for chosen in itertools.product([False, True], repeat=len(links)):
        taken = [link for link, there in zip(links, chosen, strict=True) if there]
        tails, heads = {i for i, _ in taken}, {j for _, j in taken}
        if len(tails) < len(taken) or len(heads) < len(taken):
            continue
        linked = tails | heads
        for others in itertools.product([False, True], repeat=count - len(linked)):
            free = [i for i in range(count) if i not in linked]
            used = linked | {i for i, there in zip(free, others, strict=True) if there}
            arcs = [[i in used for i in range(count)], [i in used - heads for i in range(count)],
                    [i in used - tails for i in range(count)], chosen]  # fmt: skip
            flow = np.concatenate([np.array(part, dtype=np.bool_) for part in arcs])
            yield float(costs[flow].sum()), flow


@given(seed=seeds, count=counts)
def test_the_flow_is_the_cheapest_of_all(seed: int, count: int) -> None:
    """The solver's tracks cost as little as the best of all sets of disjoint tracks, and cost what it says."""
    graph = graph_of(seed, count)
    solution = solve(graph)
    assert solution.cost == pytest.approx(min(cost for cost, _ in flows_of(graph)), abs=EXACT)


@given(seed=seeds, count=st.integers(6, 20))
def test_the_flow_is_the_optimum_of_a_linear_programme(seed: int, count: int) -> None:
    """On larger networks it costs what the relaxed programme does, whose corners are whole."""
    graph = graph_of(seed, count)
    links, each = len(graph.tail), np.eye(count)
    leaving, entering = np.zeros((count, links)), np.zeros((count, links))
    leaving[graph.tail, np.arange(links)] = entering[graph.head, np.arange(links)] = 1
    none = np.zeros((count, count))
    balance = np.block([[-each, each, none, entering], [-each, none, each, leaving]])
    costs = np.concatenate([graph.observation, graph.entry, graph.exit, graph.transition])
    optimum = linprog(costs, A_eq=balance, b_eq=np.zeros(2 * count), bounds=(0, 1))
    assert solve(graph).cost == pytest.approx(optimum.fun, abs=EXACT)


@given(seed=seeds, count=st.integers(1, 12))
def test_tracks_of_a_flow_are_disjoint_and_in_order(seed: int, count: int) -> None:
    """Each used detection has one label, labels count the beginnings, and a track goes from each to its follower."""
    graph = graph_of(seed, count)
    solution = solve(graph)
    labels, followers = track_labels(solution), solution.follower
    assert ((labels >= 0) == solution.used).all()
    linked = np.flatnonzero(followers >= 0)
    assert (labels[linked] == labels[followers[linked]]).all()
    assert (followers[linked] > linked).all()
    firsts = np.setdiff1d(np.flatnonzero(solution.used), followers)
    assert labels[firsts].tolist() == list(range(len(firsts)))


@given(seed=seeds, count=st.integers(1, 12))
def test_links_too_dear_to_be_used_change_nothing(seed: int, count: int) -> None:
    """A graph without links that cost as much as an end and a start has the same cheapest flow."""
    graph = graph_of(seed, count)
    columns = graph.tail, graph.head, graph.transition
    built = build_graph(graph.observation, [columns], 0.7, 0.9)
    whole = FlowGraph(graph.observation, np.full(count, 0.7), np.full(count, 0.9), *columns)
    assert (built.transition < 0.7 + 0.9).all()
    assert solve(built).cost == pytest.approx(solve(whole).cost, abs=EXACT)


@given(seed=seeds, count=st.integers(2, 4))
def test_marginals_are_those_of_all_flows(seed: int, count: int) -> None:
    """An arc's marginal is by how much the cheapest flow costs more in which it is used where it was not, or back."""
    graph, limit = graph_of(seed, count), 3.0
    flow = ResidualFlow(graph, solve(graph))
    marginals = Marginals(flow, limit)
    flows = list(flows_of(graph))
    best = min(cost for cost, _ in flows)
    for arc, (cost, used) in enumerate(zip(marginals.cost, flow.used, strict=True)):
        otherwise = min((total for total, arcs in flows if arcs[arc] != used), default=np.inf)
        assert cost == pytest.approx(min(otherwise - best, limit), abs=EXACT)


@given(seed=seeds, count=st.integers(2, 4), changes=st.integers(1, 3))
def test_constraints_give_the_cheapest_flow_that_holds_them(seed: int, count: int, changes: int) -> None:
    """With arcs forced and forbidden, the mended flow costs as little as the best of all flows that hold them."""
    graph, rng = graph_of(seed, count), np.random.default_rng(seed)
    flow = ResidualFlow(graph, solve(graph))
    status = np.full(len(flow.used), FREE)
    status[rng.integers(0, len(status), changes)] = rng.choice([FORBIDDEN, FORCED], changes)
    fixed = status != FREE
    costs = [cost for cost, used in flows_of(graph) if (used[fixed] == (status[fixed] == FORCED)).all()]
    assume(costs)
    flow.constrain(status)
    assert flow.total == pytest.approx(min(costs), abs=EXACT)
    flow.constrain(np.full(len(status), FREE))
    assert flow.total == pytest.approx(solve(graph).cost, abs=EXACT)


@settings(max_examples=100)
@given(seed=seeds, rows=st.integers(0, 4), columns=st.integers(0, 4), limit=st.floats(-1, 4))
def test_an_assignment_makes_all_pairs_it_can_at_the_least_cost(
    seed: int, rows: int, columns: int, limit: float
) -> None:
    """Of all matchings within the gate it takes one of the most pairs, and of these the cheapest."""
    costs = np.random.default_rng(seed).normal(0, 2, (rows, columns))
    costs[np.random.default_rng(seed + 1).random(costs.shape) < 0.1] = np.nan
    ways = [pairs for pairs in matchings(rows, columns) if all(costs[pair] <= limit for pair in pairs)]
    best = max(ways, key=lambda pairs: (len(pairs), -sum(costs[pair] for pair in pairs)))
    matched = assign(costs, limit)
    assert sorted(zip(*(ends.tolist() for ends in matched), strict=True)) == best


@given(seed=seeds, rows=st.integers(0, 4), columns=st.integers(0, 4), least=st.floats(0.05, 0.9))
def test_overlaps_are_matched_for_the_greatest_sum(seed: int, rows: int, columns: int, least: float) -> None:
    """Pairs that overlap too little count for nothing, and push none aside that overlaps enough."""
    overlaps = np.random.default_rng(seed).random((rows, columns))
    ways = [pairs for pairs in matchings(rows, columns) if all(overlaps[pair] >= least for pair in pairs)]
    best = max(ways, key=lambda pairs: sum(overlaps[pair] for pair in pairs))
    matched = assign_overlaps(overlaps, least)
    assert sorted(zip(*(ends.tolist() for ends in matched), strict=True)) == best


@given(seed=seeds, targets=st.integers(1, 3), measurements=st.integers(1, 3))
def test_association_marginals_are_those_of_all_associations(seed: int, targets: int, measurements: int) -> None:
    """Where the pairs form no loop, each probability is the share of the associations that have the pair."""
    rng = np.random.default_rng(seed)
    detected = rng.uniform(0.1, 2, (targets, measurements))
    # All pairs of one target and of one measurement: a tree.
    detected[1:, 1:] = 0
    missed, unclaimed = rng.uniform(0.1, 1, targets), rng.uniform(0.1, 1, measurements)
    total, expected = 0.0, np.zeros(detected.shape)
    for pairs in matchings(targets, measurements):
        weight = np.prod([detected[pair] for pair in pairs])
        weight *= np.prod(np.delete(missed, [i for i, _ in pairs])) * np.prod(
            np.delete(unclaimed, [j for _, j in pairs])
        )
        total += weight
        expected[tuple(np.array(pairs, dtype=int).reshape(-1, 2).T)] += weight
    claimed, none = association_marginals(detected, missed, unclaimed, tolerance=1e-12)
    np.testing.assert_allclose(claimed, expected / total, atol=1e-9)
    np.testing.assert_allclose(claimed.sum(axis=1) + none, 1)
