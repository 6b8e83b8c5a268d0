"""The part of a video that is not decided yet: its detections, its links, and the rounds of flow and costs over it."""

from __future__ import annotations

from copy import copy
from dataclasses import field
from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.chain_motion import RUN_UP, TrackMotion, followed
from tsuiseki.tracking.association.costs import TransitionCost
from tsuiseki.tracking.association.detection_tables import DetectionTable, rows_of_numbers
from tsuiseki.tracking.association.evidence import LinkWeigher, detection_evidence
from tsuiseki.tracking.association.flow_rounds import (
    AVERAGED,
    DEAREST,
    NEAR,
    WINDOW,
    FirstCosts,
    Links,
    candidates,
    mean_features,
    with_known_velocity,
    with_new_costs,
)
from tsuiseki.tracking.association.learnt_costs import LARGEST, CostNetwork
from tsuiseki.tracking.association.link_cost import MOST_WORTH, LinkCost
from tsuiseki.tracking.association.nearby import Pairs, gaps
from tsuiseki.tracking.association.network_flow import FlowGraph, FlowSolution, track_labels
from tsuiseki.tracking.association.places import (
    MEMORY,
    MOST_BY_PLACE,
    NO_COUNTS,
    UNKNOWN,
    EntryCounts,
    place_costs,
    starts_and_ends,
)
from tsuiseki.tracking.association.sliding_flow import Decision, SlidingFlow
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Seconds of decided detections that the estimates at undecided ones need.
CONTEXT = 1.0


@pydantic_dataclass(frozen=True, config=SETTINGS)
class FlowCosts:
    """Costs of the flow over detections, nats.

    Attributes:
        link: costs of links.
        entry: cost of a track's start, c_entr.
        exit: cost of a track's end, c_exit.
        rounds: how often costs are computed along tracks at most; 0 keeps the costs of pairs.
        places: starts and ends cost by where tracks begin and end (`places`); otherwise all places are alike.
    """

    link: LinkCost = field(default_factory=LinkCost)
    entry: NonNegativeFloat = 5.0
    exit: NonNegativeFloat = 5.0
    rounds: Annotated[int, Field(ge=0, le=1000)] = 5
    places: bool = True


class FlowWindow:
    """Takes detections, decides them, and forgets decided ones that no estimate needs any more.

    Args:
        costs: of the flow.
        frame_rate: frames a second.
        size: width and height of the image; None where not known.
        transition: learnt costs of pairs, taken beside the motion; None for none.
        changes: differences of costs learnt on whole tracks from these; None for none.

    Attributes:
        overlap: links span fewer frames than this.
        changes: see the argument.
        flow: what is not decided, and its network as it was last solved.
        table: the detections that are kept, undecided and decided ones.
        links: all links between undecided detections with their last costs.
        follower: ``(N,)`` numbers of the next detections on their tracks, by the last solution; -1 for none.
    """

    def __init__(
        self,
        costs: FlowCosts,
        frame_rate: float,
        size: tuple[int, int] | None,
        transition: TransitionCost | None = None,
        changes: CostNetwork | None = None,
    ) -> None:
        self.costs = costs
        self.overlap = gaps(WINDOW, frame_rate) + 1
        most_saving = costs.entry + MOST_WORTH + (0.0 if changes is None else LARGEST)
        most_saving += MOST_BY_PLACE if costs.places else 0.0
        self.flow = SlidingFlow(self.overlap, most_saving)
        self._transition = transition
        self.changes = changes
        self.table = DetectionTable.empty(frame_rate, size)
        self.links = Links()
        self._known = TrackMotion.alone(self.table, costs.link.motion)
        # Of decided detections: what follows them. Of undecided ones: what followed them in the last round.
        self.follower = np.empty(0, dtype=np.int64)
        # Where decided tracks begin and end.
        self._counts = NO_COUNTS

    def add(self, new: DetectionTable) -> None:
        """Take the detections of the next frames."""
        if len(new) == 0:
            return
        self.table = table = self.table.and_then(new)
        self.follower = np.append(self.follower, np.full(len(new), -1))
        nothing, none = np.empty(0), np.empty(0, dtype=np.int64)
        entry, exit = (np.full(len(new), cost) for cost in (self.costs.entry, self.costs.exit))
        self.flow.extend(new.frames, FlowGraph(np.zeros(len(new)), entry, exit, none, none, nothing))
        link, fresh = self.costs.link, table.numbers >= new.numbers[0]
        longest = gaps(NEAR, table.frame_rate)
        pairs = candidates(table, np.flatnonzero(self.free()), np.flatnonzero(fresh), 1, longest, link)
        alone = TrackMotion.alone(table, link.motion)
        self._known = self._known.and_then(alone.select(fresh))
        mismatch = link.mismatch_alone(table.measured, 1 / table.frame_rate)
        weigher = LinkWeigher(table, link, (alone.past, alone.future), self._transition, mismatch=mismatch)
        chosen, cost, hidden = weigher.costs(pairs, DEAREST, None, None if self.changes is None else self.changes.links)
        tail, head = (table.numbers[ends[chosen]] for ends in pairs)
        self.links = self.links.and_then(Links(tail, head, cost, np.full(len(chosen), np.nan), hidden))

    def _lowered(
        self, observation: FloatArray, ends: tuple[FloatArray, FloatArray], first_costs: FirstCosts
    ) -> FloatArray:
        """Costs of detections to solve the flow with; they and those of links are lower where first costs are."""
        used, links = self.flow.solution().used, self.links
        if not first_costs.left_out(used):
            return observation
        self.links = with_known_velocity(links, self.costs.link, self.table.frame_rate)
        self.flow.replace(self.graph(observation + first_costs.change, *ends))
        if first_costs.adds_right(used, self.flow.solution().used):
            return observation + first_costs.change
        self.links = links
        self.flow.replace(self.graph(observation, *ends))
        return observation

    def solve(
        self,
        observation: FloatArray,
        logit: FloatArray | None = None,
        rounds: int | None = None,
        first_costs: FirstCosts | None = None,
    ) -> None:
        """Alternate between the flow and the costs of its links.

        Args:
            observation: ``(N,)`` costs of the detections that are kept.
            logit: ``(N,)`` of the probability that each is right, which learnt changes need.
            rounds: how often costs are computed along tracks at most; by default see `FlowCosts`.
            first_costs: test whether first costs are too high; by default they are not.
        """
        free, table = self.free(), self.table
        change = np.zeros((int(free.sum()), 3))
        if self.changes is not None and logit is not None:
            change = self.changes.detections(detection_evidence(table, observation, logit)[free])
        observation, start, end = observation[free] + change[:, 0], change[:, 1], change[:, 2]
        by_place = place_costs(self._counts, table.image[free], table.size)
        past_keys: set[bytes] = set()
        rounds = self.costs.rounds if rounds is None else rounds
        for number in range(rounds + 1):
            ends = start + by_place[0], end + by_place[1]
            self.flow.replace(self.graph(observation, *ends))
            if number == 0 and first_costs is not None:
                observation = self._lowered(observation, ends, first_costs)
            # Index -1, a track's end, picks the appended -1.
            self.follower[free] = np.append(self.flow.undecided, -1)[self.flow.solution().follower]
            key = self.follower.tobytes()
            if number == rounds or key in past_keys:
                return
            past_keys.add(key)
            by_place = self.place_costs(table.image[free])
            self._weigh_along_tracks(free)

    def _weigh_along_tracks(self, free: BoolArray) -> None:
        """Give the links their costs along the tracks of the last solution."""
        labels, table, link = self.labels(), self.table, self.costs.link
        reach = max(RUN_UP, gaps(AVERAGED, table.frame_rate))
        motion, changed = followed(self._known, table, labels, self.follower, link.motion, reach)
        means = None if table.features is None else mean_features(table, labels, table.features, AVERAGED)
        weigher = LinkWeigher(table, link, (motion.past, motion.future), self._transition, means, labels)
        self.links, self._known = with_new_costs(self.links, weigher, labels, motion, changed, free, self.changes)

    def place_costs(self, boxes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``(N,)`` changes of entry and of exit costs at ``(N, 4)`` boxes in the image, by the tracks so far."""
        if not self.costs.places:
            return np.zeros(len(boxes)), np.zeros(len(boxes))
        counts = self._counts.and_then(self._starts_and_ends().select(self.free() & (self.labels() >= 0)))
        return place_costs(counts, boxes, self.table.size)

    def _starts_and_ends(self) -> EntryCounts:
        """What the last solution says of where tracks begin and end, of the detections that are kept."""
        table = self.table
        margin = UNKNOWN * table.frame_rate
        bounds = (margin, float(table.frames.max(initial=0)) - margin)
        return EntryCounts(table.image, *starts_and_ends(self.labels(), table.frames, bounds))

    def decide(self, last_frame: int, end: int) -> Decision:
        """Decide what lies before the frame ``end`` and no frame after ``last_frame`` can change."""
        counts = self._starts_and_ends()
        decision = self.flow.decide(last_frame, end)
        if self.costs.places:
            counts = counts.select(np.isin(self.table.numbers, decision.numbers[decision.used]))
            self._counts = self._counts.and_then(counts).select(slice(-MEMORY, None))
        place = np.searchsorted(self.table.numbers, decision.numbers)
        self.follower[place] = np.where(decision.used, decision.follower, -1)
        frames, free = self.table.frames, self.free()
        oldest = frames[free].min() if free.any() else frames.max(initial=0)
        self._keep(oldest - self.overlap - round(CONTEXT * self.table.frame_rate))
        return decision

    def settle(self, settled: IntArray, end: int, last_frame: int, joins: Pairs, context_start: int) -> None:
        """Settle detections; see `SlidingFlow.settle`.

        Args:
            settled: their numbers.
            end: nothing from this frame on is forgotten.
            last_frame: the last frame that has come.
            joins: numbers of last detections of tracks, and of what follows them, beyond what the flow says.
            context_start: of the forgotten detections those from this frame on are kept for the motion of their tracks.
        """
        tails, heads = joins
        self.flow.settle(settled, end, last_frame, tails)
        self.follower[np.searchsorted(self.table.numbers, tails)] = heads
        # What leads to a settled detection is settled, too.
        self.links = self.links.select(~np.isin(self.links.head, settled))
        self._keep(context_start)

    def copy(self) -> FlowWindow:
        """A copy that goes on by itself."""
        clone = copy(self)
        clone.flow, clone.follower = copy(self.flow), self.follower.copy()
        return clone

    def free(self) -> BoolArray:
        """``(N,)`` which of the detections that are kept are not decided."""
        return np.isin(self.table.numbers, self.flow.undecided, assume_unique=True)

    def graph(
        self, observation: FloatArray, start: FloatArray | float = 0.0, end: FloatArray | float = 0.0
    ) -> FlowGraph:
        """The network of what is undecided, without the links that no cheapest flow can use."""
        numbers, links = self.flow.undecided, self.links
        entry, exit = (np.full(len(numbers), c) + m for c, m in ((self.costs.entry, start), (self.costs.exit, end)))
        worth = links.cost < exit.max(initial=0.0) + entry.max(initial=0.0)
        tail, head = (rows_of_numbers(numbers, part[worth]) for part in (links.tail, links.head))
        graph = FlowGraph(observation, entry, exit, tail, head, links.cost[worth])
        return graph.with_transitions(graph.transition < exit[tail] + entry[head])

    def labels(self) -> IntArray:
        """``(N,)`` tracks of all detections that are kept, by the last solution; -1 for undecided ones of no track."""
        follower, solution = self.table.rows(self.follower), self.flow.solution()
        used = np.ones(len(follower), dtype=np.bool_)
        used[self.free()] = solution.used
        return track_labels(FlowSolution(used, follower))

    def _keep(self, first: int) -> None:
        """Keep the links of undecided detections, and of the decided ones those from a frame on."""
        numbers, links = self.flow.undecided, self.links
        ends = (rows_of_numbers(numbers, part) >= 0 for part in (links.tail, links.head))
        self.links = links.select(next(ends) & next(ends))
        recent = self.free() | (self.table.frames >= first)
        self.table = self.table.select(recent)
        self.follower, self._known = self.follower[recent], self._known.select(recent)
