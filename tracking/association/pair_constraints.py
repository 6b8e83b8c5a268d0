"""Two detections on one track, or on two, with frames between them: constraints that a flow cannot express.

What breaks such a wish is first mended by hand: the cheapest way between the two is forced, or the weakest link between
them is cut. That bounds the cost, so that only arcs of small reduced cost can still differ; over these a mixed integer
program (HiGHS) finds the cheapest flow of all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from tsuiseki.tracking.association.network_flow import SCALE, track_labels
from tsuiseki.tracking.association.residual_flow import FORBIDDEN, FORCED, FREE, LARGEST, InfeasibleError, ResidualFlow
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Arcs of a program at most. Unlike seconds, they bound it alike on fast and slow machines.
MOST_ARCS = 20_000
# Branches of its search at most, likewise.
MOST_BRANCHES = 100
# Longest wait for it, seconds.
TIME_LIMIT = 10.0


@dataclass(frozen=True)
class Pair:
    """Two detections, the earlier one first, and whether they are of one track."""

    first: int
    last: int
    same: bool


def holds(flow: ResidualFlow, pairs: list[Pair]) -> BoolArray:
    """``(K,)`` which of the pairs are as they should be; what no track uses is apart from everything."""
    labels = track_labels(flow.solution())
    first, last = (labels[[getattr(pair, end) for pair in pairs]] for end in ("first", "last"))
    together = (first == last) & (first >= 0)
    return np.asarray(together == np.array([pair.same for pair in pairs], dtype=np.bool_))


def satisfy(flow: ResidualFlow, pair: Pair, frames: IntArray, *, exact: bool = True) -> tuple[IntArray, bool]:
    """Arcs to force (1) and forbid (-1) beyond the status of a flow, so that a pair is as it should be.

    Args:
        flow: the cheapest flow under its constraints; it stays as it is.
        pair: that is not so yet.
        frames: ``(N,)`` of the detections.
        exact: look for the cheapest flow; or take the first way, or cut.

    Returns:
        ``(3 N + P,)`` the status, and whether no flow that satisfies flow and pair costs less.

    Raises:
        InfeasibleError: it cannot be.
    """
    mended, status = flow.copy(), flow.status.copy()
    while not holds(mended, [pair])[0]:
        # A way that is forced is kept; a cut may ask for another one.
        if pair.same:
            status[_way(mended, pair, frames)] = FORCED
        else:
            status[_weakest(mended, pair)] = FORBIDDEN
        mended.constrain(status)
    gap = round((mended.total - flow.total) * SCALE)
    free = np.flatnonzero((flow.status == FREE) & (np.abs(flow.reduced) <= gap))
    if gap == 0 or not exact or len(free) > MOST_ARCS:
        return status, gap == 0
    used = _cheapest(flow, pair, frames, free, gap)
    if used is None:
        return status, False
    best = flow.status.copy()
    if used[pair.first]:
        best[_kept(flow, used, pair, frames)] = FORCED
    else:
        best[pair.first] = FORBIDDEN
    return best, True


def _inner_arcs(flow: ResidualFlow, pair: Pair, frames: IntArray) -> IntArray:
    """Observations and links from the first detection of a pair to the last, without those two's observations."""
    count = flow.count
    start, end = frames[pair.first], frames[pair.last]
    between = np.flatnonzero((frames > start) & (frames < end))
    tail, head = flow.graph.tail, flow.graph.head
    inside = ((frames[tail] > start) | (tail == pair.first)) & ((frames[head] < end) | (head == pair.last))
    arcs = np.append(between, 3 * count + np.flatnonzero(inside & (frames[tail] < end) & (frames[head] > start)))
    return np.asarray(arcs[flow.status[arcs] != FORBIDDEN])


def _way(flow: ResidualFlow, pair: Pair, frames: IntArray) -> IntArray:
    """Arcs of the cheapest way from the first detection to the last by reduced costs, both observations included."""
    arcs = _inner_arcs(flow, pair, frames)
    cost = np.where(flow.used[arcs], 0.0, np.maximum(flow.reduced[arcs], 0))
    size = 2 * flow.count + 1
    ways = scipy.sparse.csr_array((cost, (flow.tail[arcs], flow.head[arcs])), shape=(size, size))
    start, node = 2 * pair.first + 1, 2 * pair.last
    distance, predecessor = scipy.sparse.csgraph.dijkstra(ways, indices=start, return_predecessors=True, limit=LARGEST)
    if not np.isfinite(distance[node]):
        raise InfeasibleError
    way = [pair.first, pair.last]
    while node != start:
        way.append(flow.arc_between(int(predecessor[node]), node))
        node = int(predecessor[node])
    return np.array(way, dtype=np.int64)


def _weakest(flow: ResidualFlow, pair: Pair) -> int:
    """The link on the track between two detections whose absence costs least by reduced costs."""
    links = np.array(_links(flow, flow.used, pair.first, pair.last), dtype=np.int64)
    links = links[flow.status[links] == FREE]
    if len(links) == 0:
        raise InfeasibleError
    return int(links[np.argmax(flow.reduced[links])])


def _links(flow: ResidualFlow, used: BoolArray, first: int, last: int) -> list[int]:
    """Links of a track from one detection to another, or to its end."""
    arcs = 3 * flow.count + np.flatnonzero(used[3 * flow.count :])
    following = dict(zip((flow.tail[arcs] // 2).tolist(), arcs.tolist(), strict=True))
    links = []
    while first != last and first in following:
        links.append(following[first])
        first = int(flow.head[links[-1]] // 2)
    return links


def _kept(flow: ResidualFlow, used: BoolArray, pair: Pair, frames: IntArray) -> IntArray:
    """Arcs that a flow has to use, so that the cheapest one that does satisfies the pair as this one."""
    links = _links(flow, used, pair.first, pair.last)
    if pair.same:
        return np.array([pair.first, pair.last, *links], dtype=np.int64)
    late = [n for n, arc in enumerate(links) if frames[flow.head[arc] // 2] > frames[pair.last]]
    if late:
        return np.array([pair.first, *links[: late[0] + 1]], dtype=np.int64)
    end = int(flow.head[links[-1]] // 2) if links else pair.first
    return np.array([pair.first, *links, 2 * flow.count + end], dtype=np.int64)


def _cheapest(flow: ResidualFlow, pair: Pair, frames: IntArray, free: IntArray, gap: float) -> BoolArray | None:
    """``(3 N + P,)`` the arcs of the cheapest flow that satisfies a pair, when only ``free`` arcs can change.

    Variables are the free arcs and, of arcs between the two detections: for one track, whether their way goes through
    (a unit that is sent along); for two, of nodes, whether the first detection's track comes by.
    """
    inner = _inner_arcs(flow, pair, frames)
    inner = inner[flow.used[inner] | np.isin(inner, free)]
    place = np.full(len(flow.cost), -1)
    place[free] = np.arange(len(free))
    rows, columns, values, low, high = _conservation(flow, free)
    count = len(low)
    nodes, back = np.unique(np.append(flow.tail[inner], flow.head[inner]), return_inverse=True)
    a, b = back[: len(inner)], back[len(inner) :]
    mine = len(free) + np.arange(len(inner) if pair.same else len(nodes))
    start, end = (np.searchsorted(nodes, node) for node in (2 * pair.first + 1, 2 * pair.last))
    if not (len(nodes) > max(start, end) and nodes[start] == 2 * pair.first + 1 and nodes[end] == 2 * pair.last):
        return None
    index, movable = np.arange(len(inner)), place[inner] >= 0
    lower, upper = np.zeros(len(free) + len(mine)), np.ones(len(free) + len(mine))
    if pair.same:
        # The way leaves one node more often than it comes there, at its start, and ends at the other.
        balance = np.zeros(len(nodes))
        balance[start], balance[end] = 1, -1
        rows = [*rows, count + a, count + b, count + len(nodes) + index[movable], count + len(nodes) + index[movable]]
        columns = [*columns, mine, mine, mine[movable], place[inner[movable]]]
        ones = np.ones(len(inner))
        values = [*values, ones, -ones, ones[movable], -ones[movable]]
        low = np.concatenate([low, balance, np.full(len(inner), -np.inf)])
        high = np.concatenate([high, balance, np.zeros(len(inner))])
    else:
        lower[mine[start]], upper[mine[end]] = 1, 0
        rows = [*rows, count + index, count + index, count + index[movable]]
        columns = [*columns, mine[b], mine[a], place[inner[movable]]]
        values = [*values, np.ones(len(inner)), -np.ones(len(inner)), -np.ones(int(movable.sum()))]
        low, high = np.append(low, np.where(movable, -1.0, 0.0)), np.append(high, np.full(len(inner), np.inf))
    matrix = scipy.sparse.csr_array(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(len(low), len(lower))
    )
    return _solved(flow, free, (matrix, low, high), (lower, upper), gap)


def _conservation(
    flow: ResidualFlow, free: IntArray
) -> tuple[list[IntArray], list[IntArray], list[FloatArray], FloatArray, FloatArray]:
    """Rows that keep as much leaving each node as comes there, as the other arcs are."""
    ground = 2 * flow.count
    balance = np.zeros(ground + 1)
    np.add.at(balance, flow.tail[free], flow.used[free].astype(float))
    np.subtract.at(balance, flow.head[free], flow.used[free].astype(float))
    touched = np.unique(np.append(flow.tail[free], flow.head[free]))
    touched = touched[touched != ground]
    row = np.full(ground + 1, -1)
    row[touched] = np.arange(len(touched))
    index = np.arange(len(free))
    out, into = row[flow.tail[free]] >= 0, row[flow.head[free]] >= 0
    rows = [row[flow.tail[free[out]]], row[flow.head[free[into]]]]
    values = [np.ones(int(out.sum())), -np.ones(int(into.sum()))]
    return rows, [index[out], index[into]], values, balance[touched], balance[touched]


def _solved(
    flow: ResidualFlow,
    free: IntArray,
    rows: tuple[scipy.sparse.csr_array, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    gap: float,
) -> BoolArray | None:
    """The arcs of the solution; None where its bounds were too narrow."""
    costs = np.append(flow.reduced[free] / SCALE, np.zeros(len(bounds[0]) - len(free)))
    integral = np.append(np.ones(len(free)), np.zeros(len(bounds[0]) - len(free)))
    solved = scipy.optimize.milp(
        costs,
        integrality=integral,
        bounds=scipy.optimize.Bounds(*bounds),
        constraints=scipy.optimize.LinearConstraint(*rows),
        options={"time_limit": TIME_LIMIT, "node_limit": MOST_BRANCHES, "mip_rel_gap": 0.0},
    )
    if solved.status != 0:
        return None
    used = flow.used.copy()
    used[free] = solved.x[: len(free)] > 0.5
    return used if flow.reduced[used].sum() - flow.reduced[flow.used].sum() <= gap else None
