"""Tracks solved again under what a person decided, at costs fitted to it: the cheapest flow that does all of it."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from tsuiseki.tracking.association.correction_demands import NOTHING, Demands, Finder, corners, demands_of, unmet_boxes
from tsuiseki.tracking.association.near_links import solved_on_near_links
from tsuiseki.tracking.association.network_flow import FlowGraph, track_labels
from tsuiseki.tracking.association.pair_constraints import Pair, holds, satisfy
from tsuiseki.tracking.association.residual_flow import FORBIDDEN, FORCED, InfeasibleError, ResidualFlow
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.correction_log import Box, Correction
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Deviation of the place of a box that a person drew from its neighbours on the track, heights; also of its log height.
DRAWN = 0.1
# By how much that deviation grows, heights a frame.
DRIFT = 0.03
# Longest gap of a link of `returns`, seconds.
LONGEST = 30.0
# What such a link costs more than the end of one track and the start of another, nats.
RETURN = 2.5
# The same where a person parted two tracks, nats: their ends look for other partners.
PARTED = 0.5
# What each second of the gap adds to it, nats.
WAITING = 0.15
# Deviation of the place at once, heights.
NEAR = 0.5
# By how much that deviation grows, heights a second.
WALK = 0.5
# Seconds after which it grows no more: people arrive somewhere.
SETTLED = 4.0
# Deviation of the log height of one person over such a gap.
RESIZED = 0.3
# Links whose extra cost reaches this are left out, nats.
LEAST_LIKELY = 4.0
# How often pairs are handled, since one way may break another.
MOST_ROUNDS = 50
# States that can be gone back to without solving; each may take 100 MB for hours of video.
MOST_STATES = 4
# Deleted detections from which taking back begins at such a state instead of the present flow.
MANY = 20


class _State(NamedTuple):
    """A `CorrectedFlow` as it was under some corrections."""

    corrections: tuple[Correction, ...]
    network: SolvedNetwork
    flow: ResidualFlow
    demands: Demands
    notes: list[str]
    dropped: BoolArray
    ways: dict[Pair, tuple[IntArray, IntArray]]


class CorrectedFlow:
    """The cheapest flow of a network under corrections.

    Args:
        network: of a result.

    Attributes:
        network: with a detection for each box that was drawn where none is; of a dense one its near links.
        flow: of it.
        demands: of the corrections.
        notes: how pairs of boxes were handled, and which corrections do not apply.
    """

    def __init__(self, network: SolvedNetwork) -> None:
        near, self.flow = solved_on_near_links(network.graph)
        self.network = network if near.all() else replace(network, graph=self.flow.graph)
        self.demands = Demands(network.frames)
        self.notes: list[str] = []
        self._detected = len(network)
        self._dropped = self.flow.used[: len(network)] & (network.track == 0)
        # What was forced and forbidden for pairs: arcs and their status.
        self._ways: dict[Pair, tuple[IntArray, IntArray]] = {}
        self._grow_returns()
        self._state = self._kept(())
        self._states = [self._state]

    def correct(self, corrections: Sequence[Correction]) -> None:
        """Solve under exactly these corrections.

        It goes on from the present flow, or from one that was kept where that is nearer.

        Raises:
            ContradictionError: two of them contradict each other.
            RequestError: they cannot all hold; the message names the last one and one that it contradicts.
        """
        present = self._state
        self._go_on_from(self._nearest(tuple(corrections)))
        if self._state.corrections == tuple(corrections):
            return
        try:
            self._solve_under(corrections)
        except RequestError:
            self._go_on_from(present)
            raise
        self._state = self._kept(tuple(corrections))
        # The first state, without corrections, stays.
        self._states = [*self._states[:1], *self._states[1:][1 - MOST_STATES :], self._state]

    def _solve_under(self, corrections: Sequence[Correction]) -> None:
        network = self.network
        self._grow_detections(unmet_boxes(corrections, network.frames, network.boxes))
        demands = demands_of(corrections, self.network.frames, self.network.boxes)
        self._grow_links([(i, j) for i, j in demands.followers.items() if j != NOTHING])
        previous = self._ways, self.flow, self.network
        try:
            notes = self._solve(demands)
        except InfeasibleError:
            self._ways, self.flow, self.network = previous
            raise RequestError(f"{self._refused(corrections)}; take one back") from None
        self.demands, self.notes = demands, notes + demands.left_out
        self._grow_returns()

    def _kept(self, corrections: tuple[Correction, ...]) -> _State:
        return _State(corrections, self.network, self.flow, self.demands, self.notes, self._dropped, dict(self._ways))

    def _go_on_from(self, state: _State) -> None:
        self._state = state
        _, self.network, self.flow, self.demands, self.notes, self._dropped, ways = state
        self._ways = dict(ways)

    def _nearest(self, corrections: tuple[Correction, ...]) -> _State:
        """The state from which these corrections are solved soonest."""
        earlier = [state for state in self._states if state.corrections == corrections[: len(state.corrections)]]
        longest, present = max(earlier, key=lambda state: len(state.corrections)), self._state.corrections
        pairs = itertools.takewhile(lambda pair: pair[0] == pair[1], zip(present, corrections, strict=False))
        undone = present[sum(1 for _ in pairs) :]
        deleted = (part for correction in undone for part in correction.parts or (correction,) if part.kind == "delete")
        many = sum(len(part.boxes) for part in deleted) > MANY
        return longest if many or longest.corrections == corrections else self._state

    def _refused(self, corrections: Sequence[Correction]) -> str:
        """The last correction, and the first one with which, and those before, it cannot hold."""
        *earlier, last = corrections
        previous, many = (self._ways, self.flow, self.network), len(earlier)

        def fails(count: int) -> bool:
            try:
                self._solve(demands_of([*earlier[:count], last], self.network.frames, self.network.boxes))
            except InfeasibleError:
                return True
            finally:
                self._ways, self.flow, self.network = previous
            return False

        count = bisect.bisect_left(range(many), True, key=fails)
        conflict = f" together with {earlier[count - 1]}, and what was decided before that" if count else ""
        return f"this cannot hold{conflict}: {last}"

    def labels(self) -> IntArray:
        """``(N,)`` number of the track of each detection, -1 for none; what is taken for clutter counts as none."""
        labels = track_labels(self.flow.solution())
        used = labels >= 0
        count = int(labels.max(initial=-1)) + 1
        length = np.bincount(labels[used], minlength=count)
        dropped = np.bincount(labels[used & self._dropped], minlength=count)
        certain = np.zeros(count, dtype=np.bool_)
        confirmed = [i for i, is_person in self.demands.used.items() if is_person]
        certain[labels[confirmed]] = True
        reported = certain | ((length >= self.network.fewest) & (2 * dropped <= length))
        return np.where(np.append(reported, False)[labels], labels, -1)

    def settled(self) -> ResidualFlow:
        """The flow in which all that was answered is excluded: no question is asked twice."""
        flow = self.flow.copy()
        follower, status = flow.solution().follower, flow.status.copy()
        for (i, j), same in self.demands.pairs.items():
            while same and i not in (j, NOTHING):
                status[flow.link(i, int(follower[i]))] = FORCED
                i = int(follower[i])
        flow.constrain(status)
        return flow

    def _solve(self, demands: Demands) -> list[str]:
        """Solve, and note how pairs were handled."""
        pairs, unconstrained, network = demands.wanted_pairs(), self.flow, self.network
        ways = {pair: way for pair, way in self._ways.items() if pair in pairs}
        # Ways that were found before may not suit any more, and exact ones may not suit each other.
        for self._ways, exact in [(ways, True), ({}, True), ({}, False)]:
            self.flow, self.network = unconstrained.copy(), network
            try:
                self.flow.constrain(self._status(demands))
                return self._see_to(demands, pairs, exact=exact)
            except InfeasibleError:
                continue
        raise InfeasibleError

    def _see_to(self, demands: Demands, pairs: list[Pair], *, exact: bool) -> list[str]:
        """Handle pairs until all hold; where not exactly, those of one person first, then the others by cuts."""
        notes = list[str]()
        pairs = pairs if exact else sorted(pairs, key=lambda pair: not pair.same)
        for _ in range(MOST_ROUNDS):
            held = holds(self.flow, pairs) if pairs else np.ones(1, np.bool_)
            if held.all():
                return notes
            pair = pairs[int(held.argmin())]
            if self._ways.pop(pair, None) is not None:
                self.flow.constrain(self._status(demands))
            alone = not self._ways
            try:
                status, optimal = satisfy(self.flow, pair, self.network.frames, exact=exact)
            except InfeasibleError:
                if not pair.same:
                    raise
                # No way leads from one to the other: they follow each other.
                self._grow_links([(pair.first, pair.last)])
                status, optimal = self.flow.status.copy(), False
                status[[pair.first, pair.last, self.flow.link(pair.first, pair.last)]] = FORCED
            arcs = np.flatnonzero(status != self.flow.status)
            self._ways[pair] = (arcs, status[arcs])
            self.flow.constrain(status)
            notes.append(self._note(pair, exact=optimal and alone))
        raise InfeasibleError

    def _note(self, pair: Pair, *, exact: bool) -> str:
        first, last = self.network.frames[[pair.first, pair.last]] + 1
        how = "solved exactly" if exact else "by the cheapest way" if pair.same else "by cutting the weakest link"
        return f"frames {first} and {last}: {'the same' if pair.same else 'not the same'}, {how}"

    def _status(self, demands: Demands) -> IntArray:
        """What is forced and forbidden of the arcs: what is demanded first, then the ways of pairs."""
        count, graph = len(self.network), self.network.graph
        status = np.zeros(3 * count + len(graph.tail), dtype=np.int64)
        drawn = np.arange(count) >= self._detected
        status[np.flatnonzero(drawn)] = FORBIDDEN
        for i, is_person in demands.used.items():
            status[i] = FORCED if is_person else FORBIDDEN
        link = self.flow.link
        for i, j in demands.followers.items():
            status[2 * count + i if j == NOTHING else link(i, j)] = FORCED
        for j, i in demands.predecessors.items():
            if i == NOTHING:
                status[count + j] = FORCED
        for (i, j), same in demands.pairs.items():
            if not same and link(i, j) >= 0:
                status[link(i, j)] = FORBIDDEN
        for arcs, values in self._ways.values():
            free = status[arcs] == 0
            status[arcs[free]] = values[free]
        return status

    def _grow_detections(self, boxes: Sequence[Box]) -> None:
        """Add a detection for each box, with links by how far it is from others."""
        if not boxes:
            return
        old, graph = self.network, self.network.graph
        frames = np.append(old.frames, [box.frame for box in boxes])
        all_boxes = np.concatenate([old.boxes, [corners(box) for box in boxes]])
        place, height = centres(all_boxes), all_boxes[:, 3] - all_boxes[:, 1]
        # A pair of drawn boxes stands once, with the later number.
        n, others = np.nonzero(np.tri(len(boxes), len(all_boxes), len(old) - 1, dtype=np.bool_))
        n += len(old)
        gap = np.abs(frames[others] - frames[n])
        near = (gap > 0) & (gap <= max(old.fill, 1) + 1)
        n, others, gap = n[near], others[near], gap[near]
        far = np.hypot(*(place[others] - place[n]).T) / (height[n] * (DRAWN + DRIFT * gap))
        cost = (far**2 + (np.log(height[others] / height[n]) / DRAWN) ** 2) / 2
        likely = cost < _usual(graph.entry) + _usual(graph.exit)
        n, others, cost = n[likely], others[likely], cost[likely]
        later = frames[others] > frames[n]
        self._grow(np.where(later, n, others), np.where(later, others, n), cost, boxes)

    def _grow_links(self, links: Sequence[tuple[int, int]]) -> None:
        """Add the links that are not there: for all that is known they cost what one track's end and start do."""
        missing = [pair for pair in links if self.flow.link(*pair) < 0]
        tail, head = np.array(missing, dtype=np.int64).reshape(-1, 2).T
        self._grow(tail, head, self.network.graph.exit[tail] + self.network.graph.entry[head])

    def _grow_returns(self) -> None:
        self._grow(*returns(self.network, self.labels(), np.array([*self.parted()], dtype=np.int64)))

    def _grow(self, tail: IntArray, head: IntArray, cost: FloatArray, boxes: Sequence[Box] = ()) -> None:
        if not len(tail) and not boxes:
            return
        network, graph, added = self.network, self.network.graph, len(boxes)
        graph = FlowGraph(
            np.append(graph.observation, np.zeros(added)),
            np.append(graph.entry, np.full(added, _usual(graph.entry))),
            np.append(graph.exit, np.full(added, _usual(graph.exit))),
            np.append(graph.tail, tail),
            np.append(graph.head, head),
            np.append(graph.transition, cost),
        )
        self.network = replace(
            network,
            frames=np.append(network.frames, np.array([box.frame for box in boxes], dtype=np.int64)),
            boxes=np.concatenate([network.boxes, np.array([corners(box) for box in boxes]).reshape(-1, 4)]),
            scores=np.append(network.scores, np.ones(added)),
            origin=np.concatenate([network.origin, np.full((added, 2), -1)]),
            graph=graph,
            track=np.append(network.track, np.zeros(added, np.int64)),
        )
        # The arcs of each kind move by as many as there are new ones of the kinds before.
        count = max(self.flow.count, 1)
        self._ways = {
            pair: (arcs + np.minimum(arcs // count, 3) * added, status) for pair, (arcs, status) in self._ways.items()
        }
        self._dropped = np.append(self._dropped, np.zeros(added, np.bool_))
        self.flow = self.flow.grown(graph)

    def parted(self) -> set[int]:
        """Ends and starts of tracks at which a person parted one from another."""
        labels, pairs = track_labels(self.flow.solution()), self.demands.pairs.items()
        ends = set[int]()
        for (i, j), same in pairs:
            if not same and labels[i] >= 0 and labels[j] >= 0:
                frames = self.network.frames
                left, right = np.flatnonzero(labels == labels[i]), np.flatnonzero(labels == labels[j])
                ends |= {int(left[frames[left].argmax()]), int(right[frames[right].argmin()])}
        return ends


def _usual(cost: FloatArray) -> float:
    return float(np.median(cost)) if len(cost) else 5.0


def returns(network: SolvedNetwork, labels: IntArray, parted: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Tails, heads and costs of new links from ends of tracks to starts of others too long after to be weighed.

    They cost more than to end one track and start another, so that they change nothing until a person says so; less at
    detections that were ``parted``. ``labels`` are ``(N,)`` numbers of tracks, -1 for none.
    """
    graph, frames, boxes = network.graph, network.frames, network.boxes
    order = np.lexsort((frames, labels))
    order = order[labels[order] >= 0]
    if len(order) == 0:
        return order, order, np.empty(0)
    cut = np.flatnonzero(np.diff(labels[order]))
    starts, ends = order[np.append(0, cut + 1)], order[np.append(cut, len(order) - 1)]
    starts = starts[np.argsort(frames[starts], kind="stable")]
    first = np.searchsorted(frames[starts], frames[ends], side="right")
    count = np.searchsorted(frames[starts], frames[ends] + LONGEST * network.rate, side="right") - first
    i = np.repeat(ends, count)
    j = starts[np.arange(len(i)) - np.repeat(np.cumsum(count) - count - first, count)]
    # Of the links that are there only those between such detections need comparing.
    is_end, is_start = (np.bincount(numbers, minlength=len(network)) > 0 for numbers in (ends, starts))
    old = np.flatnonzero(is_end[graph.tail] & is_start[graph.head])
    new = ~np.isin(i * len(network) + j, graph.tail[old] * len(network) + graph.head[old])
    i, j = i[new], j[new]
    place, height = centres(boxes), boxes[:, 3] - boxes[:, 1]
    waited = (frames[j] - frames[i]) / network.rate
    seconds = np.minimum(waited, SETTLED)
    far = np.hypot(*(place[j] - place[i]).T) / ((height[i] + height[j]) / 2 * (NEAR + WALK * seconds))
    extra_cost = np.where(np.isin(i, parted) | np.isin(j, parted), PARTED, RETURN)
    extra_cost = extra_cost + WAITING * waited + (far**2 + (np.log(height[j] / height[i]) / RESIZED) ** 2) / 2
    likely = extra_cost < LEAST_LIKELY
    i, j = i[likely], j[likely]
    return i, j, graph.exit[i] + graph.entry[j] + extra_cost[likely]


# After so many corrections, and every time as many more, costs are fitted anew.
EVERY = 20
# Parts of the answers that are held out in turn; also the fewest right, and the fewest wrong links to fit to.
PARTS = 4
# How strongly the fit holds to the costs as they were: precision of the weights about 0.
PRIOR = 2.0
# Highest probability that chance alone decides so many more of the held-out answers better than worse (sign test).
CHANCE = 0.01


def refitted(network: SolvedNetwork, corrections: Sequence[Correction]) -> SolvedNetwork:
    """The network with costs fitted to corrections; the same one where held-out corrections do not agree.

    That two detections follow each other has the logit of what ending one track and starting another costs more than
    their link (eq. 2.14). The fit adds a constant, a share of that, and a share of the doublings of the gap.

    Args:
        network: as it was solved.
        corrections: whose answers the costs are fitted to.
    """
    arcs, right, answer = _answers(network, corrections)
    if min(right.sum(), (~right).sum()) < PARTS:
        return network
    graph = network.graph
    gap = np.log2(np.maximum(network.frames[graph.head] - network.frames[graph.tail], 1))
    usual = graph.exit[graph.tail] + graph.entry[graph.head] - graph.transition
    evidence = np.column_stack([np.ones(len(gap)), usual / 10, gap / 3])
    logit, part = usual[arcs], answer % PARTS
    for held in (part == number for number in range(PARTS)):
        logit[held] += evidence[arcs[held]] @ _fit(evidence[arcs[~held]], usual[arcs[~held]], right[~held])
    # An answer about several links is right where all are.
    usual_wrong, fitted_wrong = (np.bincount(answer, (logits > 0) != right) > 0 for logits in (usual[arcs], logit))
    better, worse = int((usual_wrong & ~fitted_wrong).sum()), int((fitted_wrong & ~usual_wrong).sum())
    if better == 0 or scipy.special.bdtrc(better - 1, better + worse, 0.5) > CHANCE:
        return network
    # No question was asked about links that are surer than these.
    change = np.where(usual <= usual[arcs].max(), evidence @ _fit(evidence[arcs], usual[arcs], right), 0.0)
    return replace(network, graph=replace(graph, transition=graph.transition - change))


def _answers(network: SolvedNetwork, corrections: Sequence[Correction]) -> tuple[IntArray, BoolArray, IntArray]:
    """Links that corrections decide, whether they are right, and the number of the correction of each."""
    find, rows = Finder(network.frames, network.boxes), list[tuple[int, int, bool, int]]()
    numbered = ((n, part) for n, correction in enumerate(corrections) for part in correction.parts or (correction,))
    for number, single in numbered:
        nodes = [find(box) for box in single.there]
        if NOTHING not in nodes and single.kind in ("next", "right"):
            rows += [(a, b, True, number) for a, b in itertools.pairwise(nodes)]
        elif NOTHING not in nodes and single.kind == "not_same":
            rows.append((min(nodes), max(nodes), False, number))
    tail, head, right, answer = np.array(rows, dtype=np.int64).reshape(-1, 4).T
    links, count = network.graph.tail * len(network) + network.graph.head, len(network.graph.tail)
    order, links_asked = np.argsort(links), tail * len(network) + head
    place = np.append(order, count)[np.searchsorted(links, links_asked, sorter=order)]
    existing = np.append(links, -1)[place] == links_asked
    return place[existing], right[existing].astype(np.bool_), answer[existing]


def _fit(evidence: FloatArray, usual: FloatArray, right: BoolArray) -> FloatArray:
    """Weights of the evidence by which answers are most likely, near 0."""

    def loss(weights: FloatArray) -> float:
        logit = usual + evidence @ weights
        return float(np.logaddexp(0, np.where(right, -logit, logit)).sum() + PRIOR * (weights**2).sum() / 2)

    return np.asarray(scipy.optimize.minimize(loss, np.zeros(evidence.shape[1])).x)
