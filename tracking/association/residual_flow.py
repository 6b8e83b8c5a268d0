"""The cheapest flow with what proves it: node potentials under which no arc of the residual network costs below 0.

The network is a circulation over u_i, v_i of each detection and one node G in place of source and sink. An arc that is
not used may be taken as it is, one that is used may be given back (its reverse, at minus its cost). Arcs may be forced
or forbidden: they are used or not, and leave the residual network. When that changes, the flow is mended by shortest
paths (Dijkstra on reduced costs, as of Edmonds and Karp, 1972), which is exact and touches only what the change costs.

Costs are whole multiples of ``1 / SCALE``, kept as floats, so that sums are exact.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from copy import copy

import numpy as np
import scipy

from tsuiseki.tracking.association.network_flow import SCALE, FlowGraph, FlowSolution, predecessors, scaled, solution_of
from tsuiseki.tracking.types import FloatArray, IntArray

# Status of an arc that the flow may use or not.
FREE = 0
# Status of an arc that the flow must not use.
FORBIDDEN = -1
# Status of an arc that the flow must use.
FORCED = 1
# No way through a network costs as much, multiples of ``1 / SCALE``.
LARGEST = 1e15


class InfeasibleError(ValueError):
    """No flow uses all forced arcs and none of the forbidden ones."""


class ResidualFlow:
    """A cheapest flow under forced and forbidden arcs, and its potentials.

    The arcs of N detections and P transitions are numbered: N observations, N entries, N exits, P transitions.

    Args:
        graph: the network.
        solution: its cheapest flow without constraints.

    Attributes:
        graph: as given.
        tail: ``(3 N + P,)`` node that each arc leaves: 2 i is u_i, 2 i + 1 is v_i, 2 N is G.
        head: ``(3 N + P,)`` node that it leads to.
        cost: ``(3 N + P,)`` in multiples of ``1 / SCALE``.
        used: ``(3 N + P,)``.
        status: ``(3 N + P,)`` 0 free, -1 forbidden, 1 forced.
        potential: ``(2 N + 1,)``.

    Raises:
        ValueError: a cheaper flow than the solution exists.
    """

    def __init__(self, graph: FlowGraph, solution: FlowSolution) -> None:
        self.graph, self.count = graph, len(graph)
        self._number_arcs()
        used, follower = solution.used, solution.follower
        starts, ends = used & (predecessors(follower) < 0), used & (follower < 0)
        self.used = np.concatenate([used, starts, ends, follower[graph.tail] == graph.head])
        self.status = np.zeros(len(self.cost), dtype=np.int64)
        self.potential = _first_potentials(self, solution)
        if (np.where(self.used, -self.reduced, self.reduced) < 0).any():
            raise ValueError("expected the cheapest flow, got one that can be made cheaper")

    def _number_arcs(self) -> None:
        """Ends and costs of all arcs, and rows and columns of both directions, so that only the weights change."""
        graph, count, indices = self.graph, self.count, np.arange(self.count)
        u, v, ground = 2 * indices, 2 * indices + 1, np.full(count, 2 * count)
        self.tail = np.concatenate([u, ground, v, 2 * graph.tail + 1])
        self.head = np.concatenate([v, u, ground, 2 * graph.head])
        costs = graph.observation, graph.entry, graph.exit, graph.transition
        self.cost = np.concatenate([scaled(cost) for cost in costs]).astype(np.float64)
        arcs, size = len(self.cost), 2 * self.count + 1
        ends = np.append(self.tail, self.head), np.append(self.head, self.tail)
        matrix = scipy.sparse.coo_array((np.arange(1.0, 2 * arcs + 1), ends), shape=(size, size)).tocsr()
        self._layout = matrix.indptr, matrix.indices
        # Which direction of which arc each entry is: below `arcs` forwards, from there on backwards.
        self._entry = matrix.data.astype(np.int64) - 1

    def copy(self) -> ResidualFlow:
        """A copy that can be changed by itself."""
        clone = copy(self)
        clone.used, clone.status, clone.potential = self.used.copy(), self.status.copy(), self.potential.copy()
        return clone

    def grown(self, graph: FlowGraph) -> ResidualFlow:
        """The same flow in a network that begins with this one's detections and transitions, and has more.

        New detections are forbidden, as in this flow.
        """
        larger, old_count, count = copy(self), self.count, len(graph)
        larger.graph, larger.count = graph, count
        larger._number_arcs()
        # Where this flow's arcs stand among the others.
        old = [k * count + np.arange(old_count) for k in range(3)]
        arcs = np.concatenate([*old, 3 * count + np.arange(len(self.graph.tail))])
        larger.used, larger.status = np.zeros(len(larger.cost), np.bool_), np.zeros(len(larger.cost), np.int64)
        larger.used[arcs], larger.status[arcs] = self.used, self.status
        larger.status[old_count:count] = FORBIDDEN
        ground = self.potential[-1]
        added = np.arange(old_count, count)
        potential = np.concatenate([self.potential[:-1], np.zeros(2 * len(added)), [ground]])
        potential[2 * added] = ground + larger.cost[count + added]
        potential[2 * added + 1] = ground - larger.cost[2 * count + added]
        new = np.arange(3 * count + len(self.graph.tail), len(larger.cost))
        tail, head, cost = larger.tail[new], larger.head[new], larger.cost[new]
        out, into = tail >= 2 * old_count, head >= 2 * old_count
        # Both ends of a link between two new detections hold as soon as the first one is high enough.
        np.minimum.at(potential, head[into & ~out], (potential[tail] + cost)[into & ~out])
        np.maximum.at(potential, tail[out], (potential[head] - cost)[out])
        larger.potential = potential
        # A new link between old detections is taken where it is worth it.
        status, larger.status = larger.status.copy(), larger.status.copy()
        wrong = new[(cost + potential[tail] - potential[head]) < 0]
        larger.status[wrong] = FORBIDDEN
        larger.constrain(status)
        return larger

    @property
    def reduced(self) -> FloatArray:
        """``(3 N + P,)`` reduced costs: 0 or more where a free arc is not used, 0 or less where it is."""
        return np.asarray(self.cost + self.potential[self.tail] - self.potential[self.head])

    @property
    def total(self) -> float:
        """Sum of the costs of the arcs in use."""
        return float(self.cost[self.used].sum() / SCALE)

    def weights(self) -> scipy.sparse.csr_array:
        """``(2 N + 1, 2 N + 1)`` reduced costs of the residual network; inf where an arc does not lead that way."""
        reduced, free = self.reduced, self.status == FREE
        forwards = np.where(free & ~self.used, reduced, np.inf)
        backwards = np.where(free & self.used, -reduced, np.inf)
        data = np.append(forwards, backwards)[self._entry]
        pointers, indices = self._layout
        return scipy.sparse.csr_array((data, indices, pointers), shape=(2 * self.count + 1,) * 2)

    def solution(self) -> FlowSolution:
        """The flow as the matching gives it."""
        count, graph = self.count, self.graph
        follower = np.full(count, -1, dtype=np.int64)
        links = self.used[3 * count :]
        follower[graph.tail[links]] = graph.head[links]
        return solution_of(graph, np.zeros(count, np.bool_), self.used[:count], follower)

    def constrain(self, status: IntArray) -> None:
        """Force, forbid and free arcs, and mend the flow.

        Args:
            status: ``(3 N + P,)`` as `status`.

        Raises:
            InfeasibleError: not all of it can hold; the flow is left as it was.
        """
        previous = self.used.copy(), self.status.copy(), self.potential.copy()
        leaving = np.flatnonzero(self.used[: self.count] & (status[: self.count] == FORBIDDEN))
        try:
            self._take_out(leaving)
            self._set_each(status)
        except InfeasibleError:
            self.used, self.status, self.potential = previous
            raise

    def _set_each(self, status: IntArray) -> None:
        changed = np.flatnonzero(status != self.status)
        # What is freed first makes room.
        for arc in changed[np.argsort(status[changed] != FREE, kind="stable")].tolist():
            self._set(arc, int(status[arc]))

    def _take_out(self, leaving: IntArray) -> None:
        """Forbid detections that tracks use; each hole in a track is mended once, however long it is.

        No arc leads on from the first node of such a detection, and none to its second: potentials there follow from
        those of its neighbours.
        """
        out = np.zeros(self.count + 1, np.bool_)
        out[leaving] = True
        from_out, to_out = out[self.tail // 2], out[self.head // 2]
        touched = self.count + np.flatnonzero((from_out | to_out)[self.count :])
        used = touched[self.used[touched]]
        following = dict(zip((self.tail[used] // 2).tolist(), self.head[used].tolist(), strict=True))
        begins, ends = Counter[int](), Counter[int]()
        for arc in used[~from_out[used]].tolist():
            end = int(self.head[arc])
            while out[end // 2]:
                end = following[end // 2]
            begins[int(self.tail[arc])] += 1
            ends[end] += 1
        self.used[leaving], self.used[used] = False, False
        self.status[leaving], self.status[used] = FORBIDDEN, FREE
        potential, into, onwards = self.potential.copy(), touched[to_out[touched]], touched[from_out[touched]]
        np.minimum.at(potential, self.head[into], (self.potential[self.tail] + self.cost)[into])
        np.maximum.at(potential, self.tail[onwards], (self.potential[self.head] - self.cost)[onwards])
        self.potential = potential
        # What comes to G there may leave it elsewhere.
        begins, ends = begins - ends, ends - begins
        for begin in begins.elements():
            ends[self._reroute(begin, [*+ends], np.inf)] -= 1

    def _set(self, arc: int, status: int) -> None:
        self.status[arc] = status
        reduced = self.cost[arc] + self.potential[self.tail[arc]] - self.potential[self.head[arc]]
        used = bool(self.used[arc])
        worse = reduced > 0 if used else reduced < 0
        if not (worse if status == FREE else used == (status == FORBIDDEN)):
            return
        self.used[arc] = not used
        if status == FREE:
            # It costs nothing to think of the arc as it was: then the flow is mended without it, or it is used again.
            self.status[arc] = FORCED
        ends = (int(self.tail[arc]), int(self.head[arc])) if used else (int(self.head[arc]), int(self.tail[arc]))
        gain = abs(reduced) if status == FREE else np.inf
        rerouted = self._reroute(ends[0], ends[1:], gain)
        self.status[arc] = status
        if rerouted < 0:
            self.used[arc] = used

    def _reroute(self, source: int, targets: Sequence[int], limit: float) -> int:
        """Send a unit from a node to the nearest of others by the cheapest way; -1 where that saves nothing."""
        distance, predecessor = scipy.sparse.csgraph.dijkstra(
            self.weights(), indices=source, return_predecessors=True, limit=min(limit, LARGEST)
        )
        target = min(targets, key=lambda node: float(distance[node]))
        if limit == np.inf and not np.isfinite(distance[target]):
            raise InfeasibleError
        mended = bool(distance[target] < limit)
        self.potential = self.potential + np.minimum(distance, min(distance[target], limit))
        node = target
        while mended and node != source:
            arc = self.arc_between(int(predecessor[node]), node)
            self.used[arc] = not self.used[arc]
            node = int(predecessor[node])
        return target if mended else -1

    def arc_between(self, tail: int, head: int) -> int:
        """The number of the arc that leads from a node to another or back; -1 where there is none."""
        pointers, indices = self._layout
        place = np.flatnonzero(indices[pointers[tail] : pointers[tail + 1]] == head)
        return int(self._entry[pointers[tail] + int(place[0])] % len(self.cost)) if len(place) else -1

    def link(self, i: int, j: int) -> int:
        """The number of the arc of the transition from one detection to another; -1 where there is none."""
        return self.arc_between(2 * i + 1, 2 * j)


def _first_potentials(flow: ResidualFlow, solution: FlowSolution) -> FloatArray:
    """``(2 N + 1,)`` lengths of the shortest ways from G (Bellman and Ford), a whole track taken in one step."""
    count = flow.count
    order, reach, piece = _backwards(flow, solution)
    distance = np.full(2 * count + 1, np.inf)
    distance[-1] = 0
    free = np.flatnonzero(~flow.used)
    tail, head, cost = flow.tail[free], flow.head[free], flow.cost[free]
    ends = np.flatnonzero(flow.used[2 * count : 3 * count])
    distance[2 * ends + 1] = -flow.cost[2 * count + ends]
    changed = np.isfinite(distance)
    for _ in range(2 * count + 2):
        previous = distance.copy()
        active = np.flatnonzero(changed[tail])
        np.minimum.at(distance, head[active], distance[tail[active]] + cost[active])
        distance[order] = reach + _running_minimum(distance[order] - reach, piece)
        changed = distance < previous
        if distance[-1] < 0 or not changed.any():
            break
    return distance


def _backwards(flow: ResidualFlow, solution: FlowSolution) -> tuple[IntArray, FloatArray, IntArray]:
    """Nodes of all tracks from their ends on, what the way back to each costs, and the number of its track."""
    count, follower = flow.count, solution.follower
    predecessor = predecessors(follower)
    link = np.zeros(count)
    links = np.flatnonzero(flow.used[3 * count :])
    link[flow.graph.tail[links]] = flow.cost[3 * count + links]
    # How many detections come after each, and whose track it is: tracks advance together, from their ends.
    current = np.flatnonzero(solution.used & (follower < 0))
    piece, rank, step = np.full(count, -1), np.zeros(count, np.int64), 0
    number = np.arange(len(current))
    while len(current):
        piece[current], rank[current] = number, step
        current, number = predecessor[current], number[current >= 0]
        number, current, step = number[current >= 0], current[current >= 0], step + 1
    used = np.flatnonzero(piece >= 0)
    used = used[np.lexsort((rank[used], piece[used]))]
    order = np.column_stack([2 * used + 1, 2 * used]).ravel()
    # From u of the follower to v, and from v to u.
    reach = np.cumsum(np.column_stack([-link[used], -flow.cost[used]]).ravel())
    pieces = np.repeat(piece[used], 2)
    return order, reach - reach[np.searchsorted(pieces, pieces)], pieces


def _running_minimum(values: FloatArray, piece: IntArray) -> FloatArray:
    """``(N,)`` the least value so far within each piece, pieces one after the other."""
    if len(values) == 0:
        return values
    finite = np.isfinite(values)
    if not finite.any():
        return values
    low, high = float(values[finite].min()), float(values[finite].max())
    apart = piece * (2 * (high - low) + 2)
    least = np.minimum.accumulate(np.where(finite, values, 2 * high - low + 1) - apart) + apart
    return np.where(least > high, np.inf, least)
