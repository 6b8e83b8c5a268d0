"""Tracks of all people at once as one minimum-cost flow (thesis 2.3.2, eq. 2.11-2.17).

Every detection i is a pair of nodes u_i, v_i joined by an observation arc; transition arcs v_i → u_j lead to later
detections, entry arcs come from the source s and exit arcs go to the sink z. A unit of flow is a person; every arc
has capacity 1, so no two people share a detection (eq. 2.16).

The number of people is not known. An arc z → s of cost 0 turns the network into a circulation: each person is a cycle
through it, and the cheapest circulation uses exactly the cycles of negative cost. One solution of that circulation is
therefore the minimum of eq. 2.17 over all numbers of tracks.

The solver is OR-tools' cost-scaling push-relabel, the algorithm the thesis names; it works on integers. Costs are
rounded to multiples of ``1 / SCALE``, so a solution of N detections is within ``2 * N / SCALE`` of the optimum of the
costs as given.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from ortools.graph.python import min_cost_flow

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

SCALE = 1_000_000
# The solver multiplies costs by the number of nodes, in 64 bits: SCALE * LARGEST_COST * nodes stays far below 2**63.
LARGEST_COST = 1e5


@dataclass(frozen=True)
class FlowGraph:
    """The network of N detections with P transitions.

    Attributes:
        observation: ``(N,)`` c_obsv, of any sign.
        entry: ``(N,)`` c_entr.
        exit: ``(N,)`` c_exit.
        tail: ``(P,)`` index of the earlier detection of each transition.
        head: ``(P,)`` index of the later one.
        transition: ``(P,)`` c_tran, what missed frames cost included.
    """

    observation: FloatArray
    entry: FloatArray
    exit: FloatArray
    tail: IntArray
    head: IntArray
    transition: FloatArray

    def __post_init__(self) -> None:
        if not len(self.observation) == len(self.entry) == len(self.exit):
            raise ValueError("expected one observation, entry and exit cost a detection")
        if not len(self.tail) == len(self.head) == len(self.transition):
            raise ValueError("expected one tail, head and cost a transition")
        for name in ("observation", "entry", "exit", "transition"):
            costs = getattr(self, name)
            if not (np.isfinite(costs) & (np.abs(costs) <= LARGEST_COST)).all():
                raise ValueError(f"expected finite {name} costs within ±{LARGEST_COST:g}")

    def __len__(self) -> int:
        return len(self.observation)


@dataclass(frozen=True)
class FlowSolution:
    """The cheapest set of disjoint tracks.

    Attributes:
        used: ``(N,)`` detections that belong to a track: f_obsv.
        follower: ``(N,)`` index of the next detection of the same track, -1 at a track's end or where not used.
        link: ``(N,)`` cost of the transition to it, 0 where there is none.
        cost: the objective of eq. 2.17.
    """

    used: BoolArray
    follower: IntArray
    link: FloatArray
    cost: float


def build_graph(
    observation: FloatArray,
    transitions: Iterable[tuple[IntArray, IntArray, FloatArray]],
    entry: float,
    exit: float,
) -> FlowGraph:
    """The network of one video, without the transitions that no cheapest flow can use.

    Ending a track and starting another costs ``exit + entry``; a transition at least as dear is never needed, and
    leaving it out does not change the minimum.

    Args:
        observation: ``(N,)`` cost of each detection.
        transitions: arrays of tails, heads and costs; in pieces, so that not all candidates are held at once.
        entry: cost of a track's start.
        exit: cost of a track's end.
    """
    pieces = []
    for tail, head, cost in transitions:
        worth = np.flatnonzero(cost < entry + exit)
        pieces.append((tail[worth], head[worth], cost[worth]))
    count = len(observation)
    none = np.empty(0, dtype=np.int64)
    return FlowGraph(
        np.asarray(observation, dtype=np.float64),
        np.full(count, float(entry)),
        np.full(count, float(exit)),
        np.concatenate([none, *(tail for tail, _, _ in pieces)]),
        np.concatenate([none, *(head for _, head, _ in pieces)]),
        np.concatenate([np.empty(0), *(cost for _, _, cost in pieces)]),
    )


def solve(graph: FlowGraph, inflow: BoolArray | None = None) -> FlowSolution:
    """The minimum of eq. 2.17 over all flows, exact up to the rounding of the costs.

    Args:
        graph: the network.
        inflow: ``(N,)`` detections that continue a track from before the network: they are used whatever they cost,
            and pay no entry. By default none.

    Raises:
        RunError: the solver gave up.
    """
    count = len(graph)
    if count == 0:
        return FlowSolution(np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.int64), np.zeros(0), 0.0)
    solver = min_cost_flow.SimpleMinCostFlow()
    arcs = add_arcs(solver, graph)
    if inflow is not None and inflow.any():
        continued = np.flatnonzero(inflow)
        solver.set_nodes_supplies(
            np.append(2 * continued, 2 * count + 1), np.append(np.ones(len(continued), np.int64), -len(continued))
        )
    status = solver.solve()
    if status != solver.OPTIMAL:
        raise RunError(f"expected an optimal flow, the solver ended with {status.name} on {count} detections")
    flows = np.asarray(solver.flows(arcs), dtype=np.bool_)
    return _solution(graph, flows)


def add_arcs(solver: min_cost_flow.SimpleMinCostFlow, graph: FlowGraph) -> IntArray:
    """Fill the solver; returns the numbers of the observation, exit and transition arcs, then the entry arcs.

    Node 2i is u_i, node 2i + 1 is v_i; then come the source and the sink.
    """
    count = len(graph)
    u = np.arange(0, 2 * count, 2, dtype=np.int32)
    source, sink = np.full(count, 2 * count, np.int32), np.full(count, 2 * count + 1, np.int32)
    tails = np.concatenate([u, u + 1, 2 * graph.tail.astype(np.int32) + 1, source])
    heads = np.concatenate([u + 1, sink, 2 * graph.head.astype(np.int32), u])
    costs = np.concatenate([graph.observation, graph.exit, graph.transition, graph.entry])
    arcs = solver.add_arcs_with_capacity_and_unit_cost(tails, heads, np.ones(len(tails), dtype=np.int64), scaled(costs))
    solver.add_arc_with_capacity_and_unit_cost(2 * count + 1, 2 * count, count, 0)
    return np.asarray(arcs, dtype=np.int64)


def scaled(costs: FloatArray) -> IntArray:
    """Costs as whole multiples of ``1 / SCALE``."""
    return np.rint(costs * SCALE).astype(np.int64)


def _solution(graph: FlowGraph, flows: BoolArray) -> FlowSolution:
    count = len(graph)
    used, ends, links, starts = np.split(flows, np.cumsum([count, count, len(graph.tail)]))
    follower = np.full(count, -1, dtype=np.int64)
    follower[graph.tail[links]] = graph.head[links]
    link = np.zeros(count)
    link[graph.tail[links]] = graph.transition[links]
    cost = graph.observation[used].sum() + graph.entry[starts].sum() + graph.exit[ends].sum() + link.sum()
    return FlowSolution(used, follower, link, float(cost))


def track_labels(solution: FlowSolution) -> IntArray:
    """``(N,)`` 0-based track number of each detection in the order of the first detections, -1 where not used."""
    follower = solution.follower
    labels = np.full(len(follower), -1, dtype=np.int64)
    leads = np.ones(len(follower), dtype=np.bool_)
    leads[follower[follower >= 0]] = False
    current = np.flatnonzero(solution.used & leads)
    labels[current] = np.arange(len(current))
    # All tracks advance together: as many steps as the longest track has detections.
    while len(current):
        linked = follower[current] >= 0
        current, following = current[linked], follower[current[linked]]
        labels[following] = labels[current]
        current = following
    return labels
