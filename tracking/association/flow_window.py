"""The part of a video that is not decided yet: its detections, its links, and the rounds of flow and costs over it."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.association.chain_motion import RUN_UP, TrackMotion, followed
from tsuiseki.tracking.association.costs import TransitionCost
from tsuiseki.tracking.association.detection_tables import (
    DetectionTable,
    rows_of_numbers,
)
from tsuiseki.tracking.association.evidence import LinkChange, LinkModel, detection_evidence, link_costs, link_evidence
from tsuiseki.tracking.association.flow_rounds import (
    AVERAGED,
    DEAREST,
    FirstCosts,
    Links,
    RoundSettings,
    candidates,
    with_known_velocity,
    with_new_costs,
)
from tsuiseki.tracking.association.learnt_costs import LARGEST, CostChanges
from tsuiseki.tracking.association.link_cost import MOST_WORTH, LinkCost
from tsuiseki.tracking.association.nearby import Pairs, gaps
from tsuiseki.tracking.association.network_flow import FlowGraph, FlowSolution, track_labels
from tsuiseki.tracking.association.places import (
    MEMORY,
    NO_COUNTS,
    UNKNOWN,
    EntryCounts,
    EntryPlaces,
    place_costs,
    starts_and_ends,
)
from tsuiseki.tracking.association.sliding_flow import Decision, SlidingFlow
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Seconds of decided detections that the estimates at undecided ones need.
CONTEXT = 1.0


@dataclass(frozen=True)
class FlowCosts:
    """Costs of the flow over detections, nats.

    Attributes:
        link: costs of links.
        rounds: which links there are, and how often their costs are computed.
        entry: cost of a track's start, c_entr.
        exit: cost of a track's end, c_exit.
        places: changes of both by the places where tracks begin and end; None takes all places alike.
    """

    link: LinkCost = field(default_factory=LinkCost)
    rounds: RoundSettings = field(default_factory=RoundSettings)
    entry: float = 5.0
    exit: float = 5.0
    places: EntryPlaces | None = field(default_factory=EntryPlaces)

    def __post_init__(self) -> None:
        if not (0 <= self.entry < np.inf and 0 <= self.exit < np.inf):
            raise ValueError("expected finite entry and exit costs of 0 or more")


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
    """

    def __init__(
        self,
        costs: FlowCosts,
        frame_rate: float,
        size: tuple[int, int] | None,
        transition: TransitionCost | None = None,
        changes: CostChanges | None = None,
    ) -> None:
        self.costs = costs
        self.overlap = gaps(costs.rounds.window, frame_rate) + 1
        most = costs.entry + MOST_WORTH + (0.0 if changes is None else LARGEST)
        most += 0.0 if costs.places is None else costs.places.most
        self._flow = SlidingFlow(self.overlap, most)
        self._transition = transition
        self.changes = changes
        self._table = DetectionTable.empty(frame_rate, size)
        self._links = Links()
        self._known = TrackMotion.alone(self._table, costs.link.motion)
        # Of decided detections: what follows them. Of undecided ones: what followed them in the last round.
        self._follower = np.empty(0, dtype=np.int64)
        # Where decided tracks begin and end.
        self._counts = NO_COUNTS

    @property
    def exact(self) -> bool:
        """False once a detection was settled that frames to come might have changed."""
        return self._flow.exact

    @property
    def table(self) -> DetectionTable:
        """The detections that are kept, undecided and decided ones."""
        return self._table

    @property
    def links(self) -> Links:
        """All links between undecided detections with their last costs."""
        return self._links

    @property
    def follower(self) -> IntArray:
        """``(N,)`` numbers of the next detections on their tracks, by the last solution; -1 for none."""
        return self._follower

    def add(self, new: DetectionTable) -> None:
        """Take the detections of the next frames."""
        if len(new) == 0:
            return
        self._table = self._table.and_then(new)
        self._follower = np.append(self._follower, np.full(len(new), -1))
        nothing, none = np.empty(0), np.empty(0, dtype=np.int64)
        entry, exit = (np.full(len(new), cost) for cost in (self.costs.entry, self.costs.exit))
        self._flow.extend(new.frames, FlowGraph(np.zeros(len(new)), entry, exit, none, none, nothing))
        table, rounds = self._table, self.costs.rounds
        free = np.flatnonzero(self.free())
        fresh = np.flatnonzero(table.numbers >= new.numbers[0])
        longest = gaps(min(rounds.near, rounds.window), table.frame_rate)
        i, j = candidates(table, free, fresh, 1, longest, self.costs.link)
        link = self.costs.link
        alone = TrackMotion.alone(table, link.motion)
        self._known = self._known.and_then(alone.select(table.numbers >= new.numbers[0]))
        kept, cost, hidden = link_costs(
            table,
            (i, j),
            (alone.past, alone.future),
            self._link_model(),
            mismatch=link.mismatch_alone(table.measured, 1 / table.frame_rate),
        )
        tail, head = table.numbers[i[kept]], table.numbers[j[kept]]
        found = Links(tail, head, cost, np.full(len(kept), np.nan), hidden)
        self._links = self._links.and_then(found)

    def _lowered(
        self, observation: FloatArray, ends: tuple[FloatArray, FloatArray], first_costs: FirstCosts
    ) -> FloatArray:
        """Costs of detections with which the flow is solved, and links likewise: lower ones where first costs are."""
        used, links = self._flow.solution().used, self._links
        if not first_costs.left_out(used):
            return observation
        self._links = with_known_velocity(links, self.costs.link, self._table.frame_rate)
        self._flow.replace(self.graph(observation + first_costs.change, *ends))
        if first_costs.adds_right(used, self._flow.solution().used):
            return observation + first_costs.change
        self._links = links
        self._flow.replace(self.graph(observation, *ends))
        return observation

    def solve(
        self,
        observation: FloatArray,
        start: FloatArray | None = None,
        end: FloatArray | None = None,
        rounds: int | None = None,
        first_costs: FirstCosts | None = None,
    ) -> None:
        """Alternate between the flow and the costs of its links.

        Args:
            observation: ``(U,)`` costs of the undecided detections.
            start: ``(U,)`` changes of the cost of a track's start at each; none by default.
            end: ``(U,)`` likewise of its end.
            rounds: how often costs are computed along tracks at most; by default see the settings.
            first_costs: test whether first costs are too high; by default they are not.
        """
        free, table, places = self.free(), self._table, self.costs.places
        nothing = np.zeros(int(free.sum()))
        start, end = (nothing if change is None else change for change in (start, end))
        here = nothing, nothing
        if places is not None:
            here = place_costs(self._counts, table.image[free], table.size, places)
        before: set[bytes] = set()
        rounds = self.costs.rounds.rounds if rounds is None else rounds
        for number in range(rounds + 1):
            self._flow.replace(self.graph(observation, start + here[0], end + here[1]))
            if number == 0 and first_costs is not None:
                observation = self._lowered(observation, (start + here[0], end + here[1]), first_costs)
            solution = self._flow.solution()
            undecided = self._flow.undecided
            # Index -1, a track's end, picks the appended -1.
            self._follower[free] = np.append(undecided, -1)[solution.follower]
            key = self._follower.tobytes()
            if number == rounds or key in before:
                return
            before.add(key)
            if places is not None:
                here = self.place_costs(table.image[free])
            labels, costs = self.labels(), self.costs
            reach = max(RUN_UP, gaps(AVERAGED, table.frame_rate))
            known, changed = followed(self._known, table, labels, self._follower, costs.link.motion, reach)
            self._links, self._known = with_new_costs(
                self._links,
                table,
                labels,
                known,
                changed,
                costs.rounds,
                free,
                self._link_model(),
            )

    def place_costs(self, boxes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``(N,)`` changes of entry and of exit costs at ``(N, 4)`` boxes in the image, by the tracks found so far."""
        if self.costs.places is None:
            return np.zeros(len(boxes)), np.zeros(len(boxes))
        counts = self._counts.and_then(self._starts_and_ends().select(self.free() & (self.labels() >= 0)))
        return place_costs(counts, boxes, self._table.size, self.costs.places)

    def _starts_and_ends(self) -> EntryCounts:
        """What the last solution says of where tracks begin and end, of the detections that are kept."""
        table = self._table
        margin = UNKNOWN * table.frame_rate
        known = (margin, float(table.frames.max(initial=0)) - margin)
        return EntryCounts(table.image, *starts_and_ends(self.labels(), table.frames, known))

    def decide(self, last_frame: int, before: int) -> Decision:
        """Decide what lies before a frame and no frame after ``last_frame`` can change."""
        flow = self._flow
        counts = None if self.costs.places is None else self._starts_and_ends()
        decision = flow.decide(last_frame, before)
        if counts is not None:
            counts = counts.select(np.isin(self._table.numbers, decision.numbers[decision.used]))
            self._counts = self._counts.and_then(counts).select(slice(-MEMORY, None))
        place = np.searchsorted(self._table.numbers, decision.numbers)
        self._follower[place] = np.where(decision.used, decision.follower, -1)
        self._forget()
        return decision

    def settle(self, settled: IntArray, before: int, last_frame: int, joins: Pairs, kept: int) -> None:
        """Settle detections; see `SlidingFlow.settle`.

        Args:
            settled: their numbers.
            before: nothing from this frame on is forgotten.
            last_frame: the last frame that has come.
            joins: numbers of last detections of tracks, and of what follows them, beyond what the flow says.
            kept: of the forgotten detections those from this frame on are kept for what is known of their tracks.
        """
        tails, heads = joins
        self._flow.settle(settled, before, last_frame, tails)
        self._follower[np.searchsorted(self._table.numbers, tails)] = heads
        # What leads to a settled detection is settled, too.
        self._links = self._links.select(~np.isin(self._links.head, settled))
        self._keep(kept)

    def remainder(self) -> Decision:
        """All that is not decided, as it is if the video ends here; nothing is forgotten."""
        return self._flow.remainder()

    def undecided(self) -> IntArray:
        """``(U,)`` numbers of the detections that are not decided."""
        return self._flow.undecided

    def solved(self) -> FlowGraph:
        """The network of these, as it was last solved."""
        return self._flow.graph

    def copy(self) -> FlowWindow:
        """A copy that goes on by itself."""
        other = copy(self)
        other._flow, other._follower = copy(self._flow), self._follower.copy()
        return other

    def free(self) -> BoolArray:
        """``(N,)`` which of the detections that are kept are not decided."""
        return np.isin(self._table.numbers, self._flow.undecided, assume_unique=True)

    def graph(
        self, observation: FloatArray, start: FloatArray | None = None, end: FloatArray | None = None
    ) -> FlowGraph:
        """The network of what is undecided, without the links that no cheapest flow can use."""
        numbers, links = self._flow.undecided, self._links
        entry, exit = (
            np.full(len(numbers), cost) + (0.0 if change is None else change)
            for cost, change in ((self.costs.entry, start), (self.costs.exit, end))
        )
        worth = links.cost < exit.max(initial=0.0) + entry.max(initial=0.0)
        tail, head = (rows_of_numbers(numbers, part[worth]) for part in (links.tail, links.head))
        cost = links.cost[worth]
        worth = cost < exit[tail] + entry[head]
        return FlowGraph(observation, entry, exit, tail[worth], head[worth], cost[worth])

    def learnt(self, logit: FloatArray, observation: FloatArray) -> FloatArray:
        """``(U, 3)`` changes of the costs of the undecided detections: of use, of a start, of an end.

        Args:
            logit: ``(N,)`` of the probability that each kept detection is right.
            observation: ``(N,)`` their costs by default.
        """
        free = self.free()
        if self.changes is None:
            return np.zeros((int(free.sum()), 3))
        return self.changes.detections(detection_evidence(self._table, observation, logit)[free])

    def _link_model(self) -> LinkModel:
        return LinkModel(self.costs.link, DEAREST, self._transition, self._link_change())

    def _link_change(self) -> LinkChange | None:
        changes = self.changes
        if changes is None:
            return None
        motion = self.costs.link.motion
        return lambda table, parts: changes.links(link_evidence(table, parts, motion))

    def labels(self) -> IntArray:
        """``(N,)`` tracks of all detections that are kept, by the last solution; -1 for undecided ones of no track."""
        follower, solution = self._table.rows(self._follower), self._flow.solution()
        used = np.ones(len(follower), dtype=np.bool_)
        used[self.free()] = solution.used
        return track_labels(FlowSolution(used, follower, np.zeros(len(follower)), 0.0))

    def _forget(self) -> None:
        """Drop links of decided detections, and detections too old to matter."""
        frames, free = self._table.frames, self.free()
        oldest = frames[free].min() if free.any() else frames.max(initial=0)
        self._keep(oldest - self.overlap - round(CONTEXT * self._table.frame_rate))

    def _keep(self, first: int) -> None:
        """Keep the links of undecided detections, and of the decided ones those from a frame on."""
        numbers, links = self._flow.undecided, self._links
        ends = (rows_of_numbers(numbers, part) >= 0 for part in (links.tail, links.head))
        self._links = links.select(next(ends) & next(ends))
        recent = self.free() | (self._table.frames >= first)
        self._table = self._table.select(recent)
        self._follower, self._known = self._follower[recent], self._known.select(recent)
