"""Min-marginals of a flow: how much more the cheapest flow costs that decides one thing otherwise.

To use an arc that is not used, or not to use one that is, a flow must change along a cycle of the residual network. The
cheapest such cycle is the arc and the shortest way back from its one end to the other (Kohli and Torr, 2008, for cuts).
Ways through G, where tracks begin and end, follow from two trees of shortest paths for all arcs at once. All others lie
in a strongly connected part of what remains without G and without arcs that cost as much as the limit.

Potentials halfway between the two trees make most reduced costs large, so that these parts are small.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from tsuiseki.tracking.association.network_flow import SCALE
from tsuiseki.tracking.association.residual_flow import FREE, LARGEST, ResidualFlow
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Numbers in a table of distances that are held at once.
AT_ONCE = 4_000_000
# Ways that are searched together, rows of such a table at most.
MOST_ROWS = 4_000


class Marginals:
    """What it costs to decide otherwise: the min-marginals of all arcs, exact below a limit.

    Args:
        flow: the cheapest flow; it must not change as long as `cycle` is asked.
        limit: above 0; the higher, the longer it takes.
        which: ``(3 N + P,)`` arcs whose ways around G are searched; by default all.

    Attributes:
        cost: ``(3 N + P,)`` by arc as in `ResidualFlow`: how much more the cheapest flow costs in which it is used
            exactly if it is not used now; at least ``limit`` stands as that, forced and forbidden arcs are inf.
        through: ``(3 N + P,)`` the same of ways through G alone.
    """

    def __init__(self, flow: ResidualFlow, limit: float, which: BoolArray | None = None) -> None:
        self._flow, self._limit, ground = flow, limit * SCALE, 2 * flow.count
        weights, search = flow.weights(), scipy.sparse.csgraph.dijkstra
        out, self._leaving = search(weights, indices=ground, return_predecessors=True, limit=LARGEST)
        into, self._entering = search(weights.T.tocsr(), indices=ground, return_predecessors=True, limit=LARGEST)
        used, free = flow.used, flow.status == FREE
        first, last = np.where(used, flow.tail, flow.head), np.where(used, flow.head, flow.tail)
        through = np.abs(flow.reduced) + into[first] + out[last]
        through[~free] = np.inf
        # Unreachable nodes keep a potential that is high or low enough.
        farthest = max(self._limit, *(float(d[np.isfinite(d)].max(initial=0.0)) for d in (out, into)))
        self._centred = flow.potential + (np.minimum(out, farthest) - np.minimum(into, farthest)) / 2
        slack = np.abs(flow.cost + self._centred[flow.tail] - self._centred[flow.head])
        cost = np.minimum(through, self._limit)
        ways = np.flatnonzero((slack < cost) & (first != ground) & (last != ground) & free)
        ways = ways if which is None else ways[which[ways]]
        if len(ways):
            cost[ways] = np.minimum(cost[ways], slack[ways] + self._distances(first[ways], last[ways]))
        cost[~free] = np.inf
        self.cost, self.through = cost / SCALE, through / SCALE

    def cycle(self, arc: int) -> IntArray:
        """Numbers of all arcs that change where this one does, for a cost below the limit."""
        flow, used = self._flow, bool(self._flow.used[arc])
        tail, head = int(flow.tail[arc]), int(flow.head[arc])
        first, last = (tail, head) if used else (head, tail)
        if self.through[arc] <= self.cost[arc]:
            ground = 2 * flow.count
            nodes = [*_up(self._entering, first, ground), *_up(self._leaving, last, ground)[-2::-1]]
            nodes = _without_loops(nodes)
        else:
            circles, place = self._circles, self._circles.place
            _, predecessor = scipy.sparse.csgraph.dijkstra(
                circles.matrix, indices=place[first], return_predecessors=True, limit=self._limit
            )
            nodes = [circles.nodes[n] for n in _up(predecessor, int(place[last]), int(place[first]))[::-1]]
        arcs = [flow.arc_between(a, b) for a, b in itertools.pairwise(nodes)]
        return np.unique([arc, *arcs])

    @cached_property
    def _circles(self) -> _Circles:
        """Reduced costs of the residual network below the limit without G, where it leads in circles."""
        flow, ground = self._flow, 2 * self._flow.count
        reduced = np.abs(flow.cost + self._centred[flow.tail] - self._centred[flow.head])
        around = (flow.status == FREE) & (flow.tail != ground) & (flow.head != ground)
        arcs = np.flatnonzero(around & (reduced < self._limit))
        used, costs = flow.used[arcs], reduced[arcs]
        a, b = np.where(used, flow.head[arcs], flow.tail[arcs]), np.where(used, flow.tail[arcs], flow.head[arcs])
        matrix = scipy.sparse.csr_array((costs, (a, b)), shape=(ground, ground))
        part = scipy.sparse.csgraph.connected_components(matrix, connection="strong")[1]
        # Parts one after the other; a node alone is in no circle.
        nodes = np.flatnonzero(np.bincount(part)[part] > 1)
        nodes = nodes[np.argsort(part[nodes], kind="stable")]
        inside = part[a] == part[b]
        place = np.full(ground, -1)
        place[nodes] = np.arange(len(nodes))
        weight = (costs[inside], (place[a[inside]], place[b[inside]]))
        return _Circles(scipy.sparse.csr_array(weight, shape=(len(nodes),) * 2), nodes, place, part[nodes])

    def _distances(self, first: IntArray, last: IntArray) -> FloatArray:
        """``(K,)`` shortest ways without G from ``(K,)`` nodes to others, inf from the limit on."""
        circles, distances = self._circles, np.full(len(first), np.inf)
        a, b = circles.place[first], circles.place[last]
        ways = np.flatnonzero((a >= 0) & (b >= 0))
        ways = ways[circles.part[a[ways]] == circles.part[b[ways]]]
        ways = ways[np.argsort(a[ways], kind="stable")]
        # Nodes of a part lie together, so that a few parts at a time are a slice.
        edges = np.append(np.flatnonzero(np.diff(circles.part, prepend=-1)), len(circles.part))
        start = 0
        while start < len(ways):
            low = int(edges[np.searchsorted(edges, a[ways[start]], side="right") - 1])
            end = _slice_end(a[ways[start : start + MOST_ROWS]], edges, low) + start
            rows = ways[start:end]
            high = int(edges[np.searchsorted(edges, a[rows[-1]], side="right")])
            sources, back = np.unique(a[rows], return_inverse=True)
            within = circles.matrix[low:high, low:high]
            table = scipy.sparse.csgraph.dijkstra(within, indices=sources - low, limit=self._limit)
            distances[rows] = table[back, b[rows] - low]
            start = end
        return distances


@dataclass(frozen=True)
class _Circles:
    """A network of K of the nodes: its costs, the nodes, the place ``(2 N,)`` of each, and the part that each is in."""

    matrix: scipy.sparse.csr_array
    nodes: IntArray
    place: IntArray
    part: IntArray


def _up(predecessor: IntArray, node: int, root: int) -> list[int]:
    """Nodes from one to the root of a tree of predecessors."""
    nodes = [node]
    while nodes[-1] != root:
        nodes.append(int(predecessor[nodes[-1]]))
    return nodes


def _without_loops(nodes: list[int]) -> list[int]:
    """A way on which each node stands once; two trees may lead back and forth along the same track."""
    visited: dict[int, int] = {}
    way: list[int] = []
    for node in nodes:
        if node in visited:
            for left in way[visited[node] + 1 :]:
                del visited[left]
            way = way[: visited[node] + 1]
        else:
            visited[node] = len(way)
            way.append(node)
    return way


def _slice_end(sources: IntArray, edges: IntArray, low: int) -> int:
    """Up to which row sources are processed together: whole parts while they are small, some sources of a large one."""
    ends = edges[np.searchsorted(edges, sources, side="right")]
    rows = np.arange(1, len(ends) + 1)
    fits = rows * (ends - low) <= AT_ONCE
    return max(int(np.argmin(fits)) if not fits.all() else len(fits), 1)
