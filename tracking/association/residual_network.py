"""The residual network of a flow, and its potentials: what the cheapest way from the hub to each node costs.

A network at reduced costs has the same cheapest flows, whatever the potentials. Near those of a cheapest flow, nearly
all of what it uses costs 0 and all else more: the matching (`solve`) begins nearly solved. So when costs have changed a
little, the flow before gives potentials to begin with.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.nearby import ranges
from tsuiseki.tracking.association.network_flow import SCALE, FlowGraph, FlowSolution, scaled, solution_of, solve
from tsuiseki.tracking.types import BoolArray, IntArray

# Distance of a node that cannot be reached, multiples of ``1 / SCALE``; sums with costs stay within 64 bits.
FAR = np.int64(2**60)


class ResidualNetwork:
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
            tails, arcs = ranges(first[active], first[active + 1] - first[active])
            reached, length = heads[arcs], distance[active[tails]] + costs[arcs]
            shorter = length < distance[reached]
            reached = reached[shorter]
            np.minimum.at(distance, reached, length[shorter])
            active = np.unique(reached)
        return distance

    def swept(self, potential: IntArray | None, sweeps: int) -> IntArray:
        """``(2N,)`` potentials, or lengths from the hub, after so many rounds of Bellman and Ford over all arcs."""
        swept = self._start.copy() if potential is None else np.minimum(potential, self._start)
        for _ in range(sweeps):
            np.minimum.at(swept, self._heads, swept[self._tails] + self._costs)
        return swept

    def spread_to_tails(self, marked: BoolArray, low: IntArray, high: IntArray) -> None:
        """Mark all nodes with a path to a marked one along arcs that some dual from ``low`` to ``high`` has tight."""
        tight = low[self._tails] + self._costs <= high[self._heads]
        tails, heads = self._tails[tight], self._heads[tight]
        while True:
            leading = tails[marked[heads] & ~marked[tails]]
            if not len(leading):
                return
            marked[leading] = True


# Links of a network from which on potentials save more than they cost.
MANY_LINKS = 5_000
# Rounds of Bellman and Ford from nothing.
SWEEPS = 10
# Rounds from potentials of a flow whose costs have changed.
SWEEPS_AGAIN = 2
# Potential of a node that no path has reached by then, nats.
UNREACHED = 100.0


def near_potentials(
    graph: FlowGraph, solution: FlowSolution, inflow: BoolArray, potential: IntArray | None = None
) -> IntArray:
    """``(2N,)`` potentials like those of a cheapest flow, multiples of ``1 / SCALE``.

    Args:
        graph: the network.
        solution: a flow that is nearly the cheapest.
        inflow: ``(N,)`` see `solve`.
        potential: ``(2N,)`` of a network with nearly the same costs; by default none.
    """
    residual = ResidualNetwork(graph, solution, inflow)
    sweeps = SWEEPS if potential is None else SWEEPS_AGAIN
    swept = np.minimum(residual.swept(potential, sweeps), round(UNREACHED * SCALE))
    # What is left out costs nothing.
    unused = np.flatnonzero(~solution.used)
    swept[2 * unused + 1] = swept[2 * unused] + scaled(graph.observation[unused])
    return swept


def solve_near(graph: FlowGraph, inflow: BoolArray, potential: IntArray) -> FlowSolution:
    """As `solve`, quicker the nearer ``(2N,)`` potentials are to those of the cheapest flow."""
    solution = solve(graph.at_potentials(*potential.reshape(-1, 2).T / SCALE), inflow)
    return solution_of(graph, inflow, solution.used, solution.follower)
