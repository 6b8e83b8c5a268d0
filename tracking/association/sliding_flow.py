"""The minimum-cost flow of a video that is longer than memory, solved window by window and still exact.

**Overlap rule.** No transition may span ``overlap`` frames or more. Detections of the last ``overlap - 1`` frames are
the frontier: only from them can a transition lead into frames that have not come yet. After every window, the
detections that no future can change any more are decided and forgotten; all others, at least the frontier, overlap
into the next window.

**What is guaranteed.** As long as nothing was settled early (``exact``), the decided tracks are those of a cheapest
flow of the whole video among the flows without a gap of ``overlap`` frames or more. If every gap of the whole video's
optimum is shorter than the overlap, they have its cost, and they are its tracks where it is the only one. A fixed
overlap alone would not do: a choice between two matchings can hang in the balance over any number of frames.

**Memory.** What is kept is the undecided part. Usually that is little more than the frontier, whatever the length of
the video; people who stay inseparable for long can make it grow.

**Settling.** Where answers may not wait, detections that were answered are settled as the window has them. What follows
the last one of a track stays open, for as long as a transition can reach the frames to come.

**Safety.** Dual solutions of the residual network show which detections no future frame can change. Merge source
and sink into a hub. Let ``y`` be the length of the shortest path from the hub to each node of the residual network.
This is an optimal dual solution.

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

from dataclasses import dataclass, fields, replace

import numpy as np

from tsuiseki.tracking.association.network_flow import FlowGraph, FlowSolution, solution_of, solve
from tsuiseki.tracking.association.residual_network import MANY_LINKS, ResidualNetwork, near_potentials, solve_near
from tsuiseki.tracking.types import BoolArray, IntArray

# A network of up to so many windows is solved at once.
AT_ONCE = 8


@dataclass(frozen=True)
class Decision:
    """Detections whose place is final.

    Attributes:
        numbers: ``(K,)`` their numbers, counted over the whole video.
        used: ``(K,)`` whether they belong to a track.
        follower: ``(K,)`` number of the next detection of the track, -1 where there is none. It may not be decided
            itself yet; that it follows is final.
    """

    numbers: IntArray
    used: BoolArray
    follower: IntArray


class SlidingFlow:
    """Solves a flow network that arrives piece by piece in the order of the frames.

    Args:
        overlap: transitions span fewer frames than this; at least 2.
        most_saving: the most that it can save to continue a track: the highest entry cost of any detection to come
            minus the lowest cost of a transition, if that is negative.

    Attributes:
        undecided: ``(K,)`` increasing numbers of the detections that are still kept.
        graph: their network; its indices count them.
        exact: False once a detection was settled that frames to come might have changed.

    Raises:
        ValueError: the overlap is too short.
    """

    def __init__(self, overlap: int, most_saving: float) -> None:
        if overlap < 2:
            raise ValueError(f"expected an overlap of at least 2 frames, got {overlap}")
        self.overlap = overlap
        self.most_saving = most_saving
        self.exact = True
        self._count = 0
        self.undecided = np.empty(0, dtype=np.int64)
        self._frames = np.empty(0, dtype=np.int64)
        self._inflow = np.empty(0, dtype=np.bool_)
        nothing, none = np.empty(0), np.empty(0, dtype=np.int64)
        self.graph = FlowGraph(nothing, nothing, nothing, none, none, nothing)
        self._solution: FlowSolution | None = None
        # The network of the same detections at the costs before, with its solution; and potentials near theirs.
        self._previous: tuple[FlowGraph, FlowSolution] | None = None
        self._potential: IntArray | None = None

    def extend(self, frames: IntArray, graph: FlowGraph, inflow: BoolArray | None = None) -> None:
        """Add the detections of the next frames.

        Args:
            frames: ``(N,)`` frame of each new detection, all later than those before.
            graph: observation, entry and exit costs of the N new detections, and all transitions that end at them.
                Its indices are numbers over the whole video; transitions of ``overlap`` frames or more and those
                from detections that are decided are left out.
            inflow: ``(N,)`` those that continue a track from before the network; by default none.

        Raises:
            ValueError: a frame is not later, or continuing a track can save more than ``most_saving``.
        """
        if len(frames) and len(self._frames) and frames.min() <= self._frames.max():
            raise ValueError(f"expected frames after {self._frames.max()}, got {frames.min()}")
        self._check(graph)
        old, self._solution, self._previous, self._potential = self.graph, None, None, None
        self.undecided = np.append(self.undecided, np.arange(self._count, self._count + len(frames)))
        self._count += len(frames)
        self._frames = np.append(self._frames, frames)
        self._inflow = np.append(self._inflow, np.zeros(len(frames), dtype=np.bool_) if inflow is None else inflow)
        tail, head = (np.searchsorted(self.undecided, ends) for ends in (graph.tail, graph.head))
        linkable = self.undecided[tail] == graph.tail
        linkable &= self._frames[head] - self._frames[tail] < self.overlap
        new = replace(graph, tail=tail, head=head).with_transitions(linkable)
        names = [column.name for column in fields(FlowGraph)]
        self.graph = FlowGraph(*(np.append(getattr(old, name), getattr(new, name)) for name in names))

    def replace(self, graph: FlowGraph) -> None:
        """Take other costs and transitions for the detections that are not decided.

        Args:
            graph: of the undecided detections; its indices count them.

        Raises:
            ValueError: the number of detections differs, or continuing a track can save more than ``most_saving``.
        """
        if len(graph) != len(self.undecided):
            raise ValueError(f"expected costs of {len(self.undecided)} detections, got {len(graph)}")
        self._check(graph)
        if self._solution is not None:
            self._previous = self.graph, self._solution
        self.graph, self._solution = graph, None

    def solution(self) -> FlowSolution:
        """The cheapest flow as it is if the video ends here; its indices count the undecided detections."""
        if self._solution is None:
            self._solution = self._solved()
        return self._solution

    def _solved(self) -> FlowSolution:
        """The cheapest flow, by potentials of the one before where costs have changed."""
        if self._previous is None or len(self.graph.tail) < MANY_LINKS:
            return solve_in_windows(self.graph, self._inflow)
        network, solution = self._previous
        if self._potential is None:
            self._potential = near_potentials(network, solution, self._inflow)
        self._potential = near_potentials(self.graph, solution, self._inflow, self._potential)
        return solve_near(self.graph, self._inflow, self._potential)

    def decide(self, last_frame: int, end: int | None = None) -> Decision:
        """Decide and forget what no frame after ``last_frame`` can change.

        Args:
            last_frame: the last frame that has come, with or without detections.
            end: decide nothing from this frame on.
        """
        frontier = self._frames > last_frame + 1 - self.overlap
        if end is not None:
            frontier |= self._frames >= end
        solution = self.solution()
        done = safe_detections(self.graph, solution, self._inflow, frontier, self.most_saving)
        # Only those whose track is done all the way up to them.
        broken = np.flatnonzero(~done)
        while len(broken):
            following = solution.follower[broken]
            broken = following[following >= 0]
            broken = broken[done[broken]]
            done[broken] = False
        decision = self._decision(done, solution)
        self._forget(done, solution)
        return decision

    def settle(self, settled: IntArray, end: int, last_frame: int, closed: IntArray) -> None:
        """Settle that detections are used and how they follow each other; forget what nothing can change any more.

        The last one of each track stays until no frame after ``last_frame`` is within its reach; what follows it is
        open. So do detections that are not settled, of which those of no track are forgotten then.

        Args:
            settled: numbers of detections that the solution uses; with each of them all before it on its track.
            end: nothing from this frame on is forgotten.
            last_frame: the last frame that has come.
            closed: numbers of settled detections that nothing shall follow.
        """
        solution = self.solution()
        certain = np.isin(self.undecided, settled)
        follower = solution.follower
        # Index -1, a track's end, picks the appended False.
        passed = np.append(certain, False)[follower] & (follower >= 0)
        old = (self._frames + self.overlap <= last_frame + 1) & (self._frames < end)
        done = certain & (passed | ((follower < 0) & old) | np.isin(self.undecided, closed))
        done |= ~solution.used & old
        self.exact = self.exact and bool(done.all())
        self._inflow = self._inflow | certain
        self._forget(done, solution)

    def remainder(self) -> Decision:
        """All that is not decided, as it is if the video ends here; nothing is forgotten."""
        return self._decision(np.ones(len(self._frames), dtype=np.bool_), self.solution())

    def _check(self, graph: FlowGraph) -> None:
        saving = graph.entry.max(initial=0.0) - min(graph.transition.min(initial=0.0), 0.0)
        if saving > self.most_saving:
            raise ValueError(f"expected that continuing a track saves at most {self.most_saving:g}, got {saving:g}")

    def _decision(self, done: BoolArray, solution: FlowSolution) -> Decision:
        # Index -1, a track's end, picks the appended -1.
        follower = np.append(self.undecided, -1)[solution.follower[done]]
        return Decision(self.undecided[done], solution.used[done], follower)

    def _forget(self, done: BoolArray, solution: FlowSolution) -> None:
        self._solution = self._previous = self._potential = None
        self._inflow[solution.follower[done & (solution.follower >= 0)]] = True
        self.graph = self.graph.part(~done)
        self.undecided, self._frames, self._inflow = self.undecided[~done], self._frames[~done], self._inflow[~done]


def solve_in_windows(graph: FlowGraph, inflow: BoolArray | None = None, detections: int = 4000) -> FlowSolution:
    """The same as `solve`, in a time that grows with the length of the video and not faster.

    The matching of a long video has long augmenting paths. So detections come a few thousand at a time, those that the
    following ones cannot change are decided, and the others stay. Where transitions reach over more detections than
    that, as in crowds of thousands, as many come at a time as they reach over: fewer would decide nothing.

    Args:
        graph: the network; each transition leads to a detection further on.
        inflow: ``(N,)`` see `solve`.
        detections: that come at a time at least, from 1 on; a network of up to eight times as many is solved at once.
    """
    count = len(graph)
    overlap = max(int((graph.head - graph.tail).max(initial=1)) + 1, 2)
    detections = max(detections, overlap)
    if count <= AT_ONCE * detections:
        return solve(graph, inflow)
    inflow = np.zeros(count, dtype=np.bool_) if inflow is None else inflow
    saving = float(graph.entry.max() - min(graph.transition.min(initial=0.0), 0.0))
    flow = SlidingFlow(overlap, saving)
    order = np.argsort(graph.head, kind="stable")
    used, follower = np.zeros(count, dtype=np.bool_), np.full(count, -1, dtype=np.int64)
    for start in range(0, count, detections):
        new = np.arange(start, min(start + detections, count))
        links = order[slice(*np.searchsorted(graph.head, [new[0], new[-1] + 1], sorter=order))]
        costs = graph.observation[new], graph.entry[new], graph.exit[new]
        part = FlowGraph(*costs, graph.tail[links], graph.head[links], graph.transition[links])
        flow.extend(new, part, inflow[new])
        last = new[-1] == count - 1
        decision = flow.remainder() if last else flow.decide(int(new[-1]))
        used[decision.numbers], follower[decision.numbers] = decision.used, decision.follower
    return solution_of(graph, inflow, used, follower)


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
    unpaid = ResidualNetwork(graph, solution, inflow)
    offered = np.where(frontier, np.minimum(graph.exit, -most_saving), graph.exit)
    generous = replace(graph, exit=offered)
    paid = ResidualNetwork(generous, solve(generous, inflow), inflow)
    low, high = unpaid.distances(), paid.distances()
    unsafe = low != high
    unsafe[1::2] |= frontier
    unpaid.spread_to_tails(unsafe, low, np.maximum(low, high))
    return np.asarray(~(unsafe[0::2] | unsafe[1::2]))
