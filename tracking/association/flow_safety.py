"""Which detections of a flow no future frame can change, by the dual solutions of its residual network.

Merge source and sink into a hub. Let ``y`` be the length of the shortest path from the hub to each node of the residual
network. This is an optimal dual solution.

Future frames can only pay for units of flow that arrive at frontier nodes v_i. The least they pay is nothing. The most
is what continuing a track saves: the track's entry cost, less the cheapest transition if its cost is negative. Let
``y'`` be the dual solution of the window in which every frontier node is paid the most.

The dual problem maximises a supermodular function under lower bounds on the frontier. So its solutions grow with those
bounds, and the final dual solution lies between ``y`` and ``y'``.

The optimum of the whole video differs from that of the window only along residual paths from the hub to the frontier
that are tight under the final dual solution. Each node of such a path has at least one of these properties:

* ``y < y'``;
* it is a frontier node;
* it has a residual arc to a node of the path, and the arc is tight for some dual solution between ``y`` and ``y'``.

Nodes with none of them are safe. Costs are integers, so the comparisons are exact.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.network_flow import FlowGraph, FlowSolution, scaled, solve
from tsuiseki.tracking.types import BoolArray, IntArray

FAR = np.int64(2**60)


def safe_detections(
    graph: FlowGraph, solution: FlowSolution, inflow: BoolArray, frontier: BoolArray, most_saving: float
) -> BoolArray:
    """``(N,)`` the detections that no future can change.

    Args:
        graph: the network of the window.
        solution: its cheapest flow.
        inflow: ``(N,)`` detections that continue a track from before.
        frontier: ``(N,)`` detections from which transitions can lead into frames to come.
        most_saving: the most that it can save to continue a track.
    """
    least = _Residual(graph, solution, inflow)
    offered = np.where(frontier, np.minimum(graph.exit, -most_saving), graph.exit)
    generous = FlowGraph(graph.observation, graph.entry, offered, graph.tail, graph.head, graph.transition)
    most = _Residual(generous, solve(generous, inflow), inflow)
    low, high = least.distances(), most.distances()
    unsafe = low != high
    unsafe[1::2] |= frontier
    least.spread_to_tails(unsafe, low, np.maximum(low, high))
    return np.asarray(~(unsafe[0::2] | unsafe[1::2]))


class _Residual:
    """The residual network of a solution, without the arcs into the hub; node 2i is u_i, node 2i + 1 is v_i.

    Transitions need no capacity of their own, since the observation arcs have one.
    """

    def __init__(self, graph: FlowGraph, solution: FlowSolution, inflow: BoolArray) -> None:
        self._nodes = 2 * len(graph)
        observation, transition = scaled(graph.observation), scaled(graph.transition)
        u = np.arange(0, self._nodes, 2)
        linked = solution.follower[graph.tail] == graph.head
        self._tails = np.concatenate(
            [np.where(solution.used, u + 1, u), 2 * graph.tail + 1, 2 * graph.head[linked]], dtype=np.int64
        )
        self._heads = np.concatenate(
            [np.where(solution.used, u, u + 1), 2 * graph.head, 2 * graph.tail[linked] + 1], dtype=np.int64
        )
        self._costs = np.concatenate(
            [np.where(solution.used, -observation, observation), transition, -transition[linked]]
        )
        self._start = np.full(self._nodes, FAR)
        self._start[0::2] = np.where(inflow, FAR, scaled(graph.entry))
        ends = solution.used & (solution.follower < 0)
        self._start[1::2] = np.where(ends, -scaled(graph.exit), FAR)

    def distances(self) -> IntArray:
        """``(2N,)`` lengths of the shortest paths from the hub (Bellman-Ford, all active nodes at a time)."""
        order = np.argsort(self._tails, kind="stable")
        heads, costs = self._heads[order], self._costs[order]
        first = np.searchsorted(self._tails[order], np.arange(self._nodes + 1))
        distance = self._start.copy()
        active = np.flatnonzero(distance < FAR)
        while len(active):
            counts = first[active + 1] - first[active]
            arcs = np.arange(counts.sum()) + np.repeat(first[active] - np.cumsum(counts) + counts, counts)
            reached, length = heads[arcs], np.repeat(distance[active], counts) + costs[arcs]
            shorter = length < distance[reached]
            reached = reached[shorter]
            np.minimum.at(distance, reached, length[shorter])
            active = np.unique(reached)
        return distance

    def spread_to_tails(self, marked: BoolArray, low: IntArray, high: IntArray) -> None:
        """Mark all nodes with a path to a marked one along arcs that some dual from ``low`` to ``high`` has tight."""
        tight = low[self._tails] + self._costs <= high[self._heads]
        tails, heads = self._tails[tight], self._heads[tight]
        while True:
            found = tails[marked[heads] & ~marked[tails]]
            if not len(found):
                return
            marked[found] = True
