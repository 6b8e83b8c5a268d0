"""Tracks of all people at once as one minimum-cost flow (thesis 2.3.2, eq. 2.11-2.17).

Every detection i is a pair of nodes u_i, v_i joined by an observation arc; transition arcs v_i → u_j lead to later
detections, entry arcs come from the source s and exit arcs go to the sink z. A unit of flow is a person; every arc
has capacity 1, so no two people share a detection (eq. 2.16).

The number of people is not known: the minimum of eq. 2.17 is over all numbers of tracks.

Since all capacities are 1, a flow is a matching (`_matching`): each detection takes one other as its predecessor, or
its own birth, or itself when it is in no track. The cheapest matching is found by shortest augmenting paths over the
sparse matrix of these choices (Jonker and Volgenant, 1987; SciPy), where the thesis names cost-scaling push-relabel.
Both are exact. On the windows of a tracker they take about the same time; on a long video at once the matching takes
longer (docs/methods/flow.md).

Costs are rounded to multiples of ``1 / SCALE``, so that equal costs stay equal however they are added up. A solution of
N detections is within ``2 * N / SCALE`` of the optimum of the costs as given.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Steps of a cost of 1.
SCALE = 1_000_000
# The solver adds whole numbers up in double precision: a path of 90,000 arcs of SCALE * LARGEST_COST stays below 2**53.
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

    def with_transitions(self, mask: BoolArray) -> FlowGraph:
        """The network with those transitions only at a mask ``(P,)``."""
        return replace(self, tail=self.tail[mask], head=self.head[mask], transition=self.transition[mask])

    def at_potentials(self, first: FloatArray, second: FloatArray) -> FlowGraph:
        """The network at reduced costs, which has the same cheapest flows.

        Args:
            first: ``(N,)`` potential of each u_i.
            second: ``(N,)`` of each v_i; source and sink have 0.
        """
        observation, transition = self.observation + first - second, self.transition + second[self.tail]
        transition -= first[self.head]
        return FlowGraph(observation, self.entry - first, self.exit + second, self.tail, self.head, transition)

    def part(self, mask: BoolArray) -> FlowGraph:
        """The network of the detections at a mask ``(N,)``, which are counted anew."""
        within, place = self.with_transitions(mask[self.tail] & mask[self.head]), np.cumsum(mask) - 1
        costs = self.observation[mask], self.entry[mask], self.exit[mask]
        return FlowGraph(*costs, place[within.tail], place[within.head], within.transition)


@dataclass(frozen=True)
class FlowSolution:
    """The cheapest set of disjoint tracks: the flow F of Eq. (2.11).

    Attributes:
        used: ``(N,)`` detections that belong to a track: f_obsv.
        follower: ``(N,)`` index of the next detection of the same track, -1 at a track's end or where not used.
        cost: the objective of eq. 2.17; NaN where only the tracks are known.
    """

    used: BoolArray
    follower: IntArray
    cost: float = np.nan


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
        transitions: arrays of tails, heads and costs; in parts, so that not all candidates are held at once.
        entry: cost of a track's start.
        exit: cost of a track's end.
    """
    none = np.empty(0, dtype=np.int64)
    parts = [(none, none, np.empty(0))]
    for tail, head, cost in transitions:
        worth = np.flatnonzero(cost < entry + exit)
        parts.append((tail[worth], head[worth], cost[worth]))
    arcs = (np.concatenate(column) for column in zip(*parts, strict=True))
    costs = np.asarray(observation, dtype=np.float64), *(np.full(len(observation), float(c)) for c in (entry, exit))
    return FlowGraph(*costs, *arcs)


def solve(graph: FlowGraph, inflow: BoolArray | None = None) -> FlowSolution:
    """The minimum over all flows, Eqs. (2.16)-(2.17), exact up to the rounding of the costs.

    Args:
        graph: the network.
        inflow: ``(N,)`` detections that continue a track from before the network: they are used whatever they cost,
            and pay no entry. By default none.

    Raises:
        ValueError: a pair of detections has two transitions.
    """
    count = len(graph)
    if count == 0:
        return FlowSolution(np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.int64), 0.0)
    continued = np.zeros(count, dtype=np.bool_) if inflow is None else inflow
    fresh = np.flatnonzero(~continued)
    matrix = _matching(graph, fresh)
    rows, columns = scipy.sparse.csgraph.min_weight_full_bipartite_matching(matrix)
    # `_matching` numbers backwards.
    predecessor = np.empty(len(rows), dtype=np.int64)
    predecessor[len(rows) - 1 - rows] = len(rows) - 1 - columns
    predecessor = predecessor[: len(fresh)]
    linked = (predecessor < count) & (predecessor != fresh)
    follower = np.full(count, -1, dtype=np.int64)
    follower[predecessor[linked]] = fresh[linked]
    used = np.ones(count, dtype=np.bool_)
    used[fresh[predecessor == fresh]] = False
    return solution_of(graph, continued, used, follower)


def _matching(graph: FlowGraph, fresh: IntArray) -> scipy.sparse.csr_array:
    """Costs of the choices, as a square sparse matrix whose cheapest full matching is the cheapest flow.

    Of N detections, F are fresh: they may start a track. Columns are the N detections as predecessors, then the F
    births. Rows are the F fresh detections, which take a predecessor, a birth or themselves (in no track), then the N
    ends of tracks. The birth that a linked detection does not need goes to the end that its predecessor does not
    need, which is why every transition stands there a second time, free of charge (Ramshaw and Tarjan, 2012).

    Rows and columns are numbered backwards in time: with the last detection first, the augmenting paths are short.
    """
    count, born = len(graph), len(fresh)
    size = count + born
    place = np.full(count, -1)
    place[fresh] = np.arange(born)
    open_link = place[graph.head] >= 0
    tail, head = graph.tail[open_link], place[graph.head[open_link]]
    detections, birth, ending = np.arange(count), count + np.arange(born), born + np.arange(count)
    choices = (
        (head, tail, scaled(graph.transition[open_link])),
        (place[fresh], fresh, -scaled(graph.observation[fresh])),
        (place[fresh], birth, scaled(graph.entry[fresh])),
        (ending, detections, scaled(graph.exit)),
        (ending[fresh], birth, np.zeros(born, dtype=np.int64)),
        (ending[tail], birth[head], np.zeros(len(tail), dtype=np.int64)),
    )
    rows, columns, costs = (np.concatenate(parts) for parts in zip(*choices, strict=True))
    # A cost of 0 would mean that there is no such choice.
    positive = (costs - costs.min() + 1).astype(np.float64)
    matrix = scipy.sparse.csr_array((positive, (size - 1 - rows, size - 1 - columns)), shape=(size, size))
    if matrix.nnz != len(costs):
        raise ValueError("expected one transition at most from a detection to another")
    return matrix


def scaled(costs: FloatArray) -> IntArray:
    """Costs as whole multiples of ``1 / SCALE``."""
    return np.rint(costs * SCALE).astype(np.int64)


def solution_of(graph: FlowGraph, inflow: BoolArray, used: BoolArray, follower: IntArray) -> FlowSolution:
    """The solution that uses these detections in this order, with what it costs; arguments as in `FlowSolution`."""
    link = np.zeros(len(graph))
    chosen = follower[graph.tail] == graph.head
    link[graph.tail[chosen]] = graph.transition[chosen]
    starts, ends = used & ~inflow & (predecessors(follower) < 0), used & (follower < 0)
    cost = graph.observation[used].sum() + graph.entry[starts].sum() + graph.exit[ends].sum() + link.sum()
    return FlowSolution(used, follower, float(cost))


def predecessors(follower: IntArray) -> IntArray:
    """``(N,)`` index of what comes before each detection, -1 for nothing, by ``(N,)`` what follows each."""
    predecessor = np.full(len(follower), -1)
    linked = np.flatnonzero(follower >= 0)
    predecessor[follower[linked]] = linked
    return predecessor


def track_labels(solution: FlowSolution) -> IntArray:
    """``(N,)`` 0-based track number of each detection in the order of the first detections, -1 where not used."""
    before = predecessors(solution.follower)
    starts = solution.used & (before < 0)
    first = np.where(before < 0, np.arange(len(before)), before)
    # Twice as far back each time.
    while not np.array_equal(further := first[first], first):
        first = further
    return np.where(solution.used[first], np.cumsum(starts)[first] - 1, -1)


@dataclass(frozen=True)
class Ends:
    """First and last detection of M tracks.

    Attributes:
        track: ``(M,)`` increasing numbers of the tracks.
        first: ``(M,)`` index of its first detection.
        last: ``(M,)`` index of its last one.
    """

    track: IntArray
    first: IntArray
    last: IntArray

    @classmethod
    def of(cls, labels: IntArray) -> Ends:
        """The ends of all tracks in ``labels``."""
        used = np.flatnonzero(labels >= 0)
        order = used[np.argsort(labels[used], kind="stable")]
        track, first = np.unique(labels[order], return_index=True)
        last = np.append(first[1:], len(order))[: len(first)] - 1
        return cls(track, order[first], order[last])
