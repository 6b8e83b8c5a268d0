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

# Numbers in a table of distances that are held at once, and rows of it.
AT_ONCE, MOST_ROWS = 4_000_000, 4_000


@dataclass(frozen=True)
class Marginals:
    """What it costs to decide otherwise.

    Attributes:
        flow: the cheapest flow; it must not change as long as `cycle` is asked.
        cost: ``(3 N + P,)`` by arc as in `ResidualFlow`: how much more the cheapest flow costs in which it is used
            exactly if it is not used now; at least ``limit`` stands as that, forced and forbidden arcs are inf.
        limit: as asked for.
        through: ``(3 N + P,)`` the same of ways through G alone.
    """

    flow: ResidualFlow
    cost: FloatArray
    limit: float
    through: FloatArray
    _trees: tuple[IntArray, IntArray]
    _centred: FloatArray

    def cycle(self, arc: int) -> IntArray:
        """Numbers of all arcs that change where this one does, for a cost below the limit."""
        flow, used = self.flow, bool(self.flow.used[arc])
        tail, head = int(flow.tail[arc]), int(flow.head[arc])
        first, last = (tail, head) if used else (head, tail)
        if self.through[arc] <= self.cost[arc]:
            ground = 2 * flow.count
            nodes = [*_up(self._trees[1], first, ground), *_up(self._trees[0], last, ground)[-2::-1]]
            nodes = _without_loops(nodes)
        else:
            inside, place = self._local
            _, before = scipy.sparse.csgraph.dijkstra(
                inside, indices=place[first], return_predecessors=True, limit=self.limit * SCALE
            )
            nodes = [self._part[1][n] for n in _up(before, int(place[last]), int(place[first]))[::-1]]
        arcs = [flow.arc_between(a, b) for a, b in itertools.pairwise(nodes)]
        return np.unique([arc, *arcs])

    @cached_property
    def _part(self) -> tuple[scipy.sparse.csr_array, IntArray]:
        return _without_ground(self.flow, self._centred, self.limit * SCALE)

    @property
    def _local(self) -> tuple[scipy.sparse.csr_array, IntArray]:
        matrix, nodes = self._part
        place = np.full(2 * self.flow.count + 1, -1)
        place[nodes] = np.arange(len(nodes))
        return matrix, place


def _up(before: IntArray, node: int, root: int) -> list[int]:
    """Nodes from one to the root of a tree of predecessors."""
    nodes = [node]
    while nodes[-1] != root:
        nodes.append(int(before[nodes[-1]]))
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


def marginals(flow: ResidualFlow, limit: float = 8.0, which: BoolArray | None = None) -> Marginals:
    """The min-marginals of all arcs, exact below the limit.

    Args:
        flow: the cheapest flow.
        limit: above 0; the higher, the longer it takes.
        which: ``(3 N + P,)`` arcs whose ways around G are searched; by default all.
    """
    weights, ground = flow.weights(), 2 * flow.count
    search = scipy.sparse.csgraph.dijkstra
    out, leaving = search(weights, indices=ground, return_predecessors=True, limit=LARGEST)
    into, entering = search(weights.T.tocsr(), indices=ground, return_predecessors=True, limit=LARGEST)
    reduced, used = flow.reduced, flow.used
    least = np.abs(reduced)
    first, last = np.where(used, flow.tail, flow.head), np.where(used, flow.head, flow.tail)
    through = least + into[first] + out[last]
    through[flow.status != FREE] = np.inf
    # Unreachable nodes keep a potential that is high or low enough.
    most = max(limit * SCALE, *(float(d[np.isfinite(d)].max(initial=0.0)) for d in (out, into)))
    centred = np.asarray(flow.potential + (np.minimum(out, most) - np.minimum(into, most)) / 2)
    slack = np.abs(flow.cost + centred[flow.tail] - centred[flow.head])
    cost = np.minimum(through, limit * SCALE)
    asked = np.flatnonzero((slack < cost) & (first != ground) & (last != ground) & (flow.status == FREE))
    asked = asked if which is None else asked[which[asked]]
    if len(asked):
        around = _distances(flow, centred, limit * SCALE, first[asked], last[asked])
        cost[asked] = np.minimum(cost[asked], slack[asked] + around)
    cost[flow.status != FREE] = np.inf
    return Marginals(flow, cost / SCALE, limit, through / SCALE, (leaving, entering), centred)


def _without_ground(flow: ResidualFlow, potential: FloatArray, limit: float) -> tuple[scipy.sparse.csr_array, IntArray]:
    """Reduced costs of the residual network below a limit without G, where it leads in circles; and its nodes."""
    reduced = flow.cost + potential[flow.tail] - potential[flow.head]
    ground = 2 * flow.count
    kept = np.flatnonzero(
        (flow.status == FREE) & (np.abs(reduced) < limit) & (flow.tail != ground) & (flow.head != ground)
    )
    used = flow.used[kept]
    a, b = np.where(used, flow.head[kept], flow.tail[kept]), np.where(used, flow.tail[kept], flow.head[kept])
    matrix = scipy.sparse.csr_array((np.abs(reduced[kept]), (a, b)), shape=(ground, ground))
    part = scipy.sparse.csgraph.connected_components(matrix, connection="strong")[1]
    # Parts one after the other; a node alone is in no circle.
    size = np.bincount(part)
    nodes = np.flatnonzero(size[part] > 1)
    nodes = nodes[np.argsort(part[nodes], kind="stable")]
    inside = part[a] == part[b]
    place = np.full(ground, -1)
    place[nodes] = np.arange(len(nodes))
    weight = (np.abs(reduced[kept[inside]]), (place[a[inside]], place[b[inside]]))
    return scipy.sparse.csr_array(weight, shape=(len(nodes),) * 2), nodes


def _distances(flow: ResidualFlow, potential: FloatArray, limit: float, first: IntArray, last: IntArray) -> FloatArray:
    """``(K,)`` shortest ways without G from ``(K,)`` nodes to others, inf from the limit on."""
    matrix, nodes = _without_ground(flow, potential, limit)
    found = np.full(len(first), np.inf)
    place = np.full(2 * flow.count, -1)
    place[nodes] = np.arange(len(nodes))
    part = scipy.sparse.csgraph.connected_components(matrix, connection="strong")[1]
    a, b = place[first], place[last]
    asked = np.flatnonzero((a >= 0) & (b >= 0))
    asked = asked[part[a[asked]] == part[b[asked]]]
    asked = asked[np.argsort(a[asked], kind="stable")]
    # Nodes of a part lie together, so that a few parts at a time are a slice.
    edges = np.append(np.flatnonzero(np.append(True, np.diff(part) != 0)[: len(part)]), len(part))
    start = 0
    while start < len(asked):
        low = int(edges[np.searchsorted(edges, a[asked[start]], side="right") - 1])
        end = _slice_end(a[asked[start : start + MOST_ROWS]], edges, low) + start
        rows = asked[start:end]
        high = int(edges[np.searchsorted(edges, a[rows[-1]], side="right")])
        sources, back = np.unique(a[rows], return_inverse=True)
        table = scipy.sparse.csgraph.dijkstra(matrix[low:high, low:high], indices=sources - low, limit=limit)
        found[rows] = table[back, b[rows] - low]
        start = end
    return found


def _slice_end(sources: IntArray, edges: IntArray, low: int) -> int:
    """Up to which row sources are processed together: whole parts while they are small, some sources of a large one."""
    ends = edges[np.searchsorted(edges, sources, side="right")]
    rows = np.arange(1, len(ends) + 1)
    fits = rows * (ends - low) <= AT_ONCE
    return max(int(np.argmin(fits)) if not fits.all() else len(fits), 1)
