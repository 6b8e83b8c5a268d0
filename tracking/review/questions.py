"""Decisions that a flow was least certain of, as questions that are answered with yes or no."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.tracking.association.marginals import Marginals, marginals
from tsuiseki.tracking.association.network_flow import FlowSolution, track_labels
from tsuiseki.tracking.association.residual_flow import ResidualFlow
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.review.corrections import Box, Correction, boxes_of
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

QuestionKind = Literal["link", "start", "end", "detection", "exchange"]
# Decisions whose other way costs this much more are certain.
LIMIT = 4.0
# Detections that are shown before and after those that a question is about.
AROUND = 12


@dataclass(frozen=True)
class ShownBox:
    """A box of an alternative: the frame from 0, its place in pixels, and whose it is."""

    frame: int
    x: float
    y: float
    width: float
    height: float
    id: int


@dataclass(frozen=True)
class Question:
    """A decision that can be answered with yes (as it was solved) or no (the other way).

    Attributes:
        key: the same as long as the question is.
        kind: what is asked.
        frame: to look at, from 0.
        boxes_a: the people as solved.
        boxes_b: the same the other way.
        margin: how much more the other way costs; the probability that it is right is about ``1 / (1 + exp(margin))``.
        sentence: the question.
        yes: what is said with yes.
        no: with no.
    """

    key: str
    kind: QuestionKind
    frame: int
    boxes_a: tuple[ShownBox, ...]
    boxes_b: tuple[ShownBox, ...]
    margin: float
    sentence: str
    yes: Correction
    no: Correction


@dataclass(frozen=True)
class Change:
    """What a cycle of the residual network changes.

    Attributes:
        removed: links that are given up.
        added: links that take their place.
        dropped: detections that are in no track any more.
        gained: detections that come into one.
    """

    removed: tuple[tuple[int, int], ...]
    added: tuple[tuple[int, int], ...]
    dropped: tuple[int, ...]
    gained: tuple[int, ...]

    @classmethod
    def of(cls, flow: ResidualFlow, arcs: IntArray) -> Change:
        """The change of some arcs."""
        count = flow.count
        used = flow.used[arcs]
        links, detections = arcs >= 3 * count, arcs < count

        def ends(which: BoolArray) -> tuple[tuple[int, int], ...]:
            chosen = arcs[which] - 3 * count
            return tuple(zip(flow.graph.tail[chosen].tolist(), flow.graph.head[chosen].tolist(), strict=True))

        return cls(
            ends(links & used),
            ends(links & ~used),
            tuple(arcs[detections & used].tolist()),
            tuple(arcs[detections & ~used].tolist()),
        )


class Questioner:
    """Ranks the decisions of a flow and words them.

    Args:
        network: of the flow.
        flow: settled as far as a person did.
        ids: ``(N,)`` ids of detections, 0 for none.
    """

    def __init__(self, network: SolvedNetwork, flow: ResidualFlow, ids: IntArray) -> None:
        self.network, self.flow, self.ids = network, flow, ids
        self.found: Marginals = marginals(flow, LIMIT)
        self._follower = flow.solution().follower

    def doubtful(self) -> tuple[IntArray, FloatArray]:
        """``(Q,)`` decisions whose other way costs less than the limit, one a way, and ``(Q,)`` what it costs."""
        cost = self.found.cost
        arcs = np.flatnonzero(cost < LIMIT)
        # What changes together costs the same; a link says it best, of all arcs those stand last.
        arcs = arcs[np.lexsort((-arcs, cost[arcs]))]
        key = np.rint(cost[arcs] * 1e6).astype(np.int64)
        first = np.append(True, np.diff(key) != 0)[: len(arcs)]
        return arcs[first], cost[arcs[first]]

    def change(self, arc: int) -> Change:
        """What changes where a decision goes the other way."""
        return Change.of(self.flow, self.found.cycle(arc))

    def matters(self, change: Change) -> bool:
        """Whether anything of it is in a reported track."""
        about = [n for link in change.removed for n in link] + [*change.dropped]
        gained = [n for link in change.added for n in link]
        return any(self.ids[n] for n in about) or any(self.ids[n] for n in gained)

    def question(self, arc: int) -> Question | None:
        """The decision in words; None where it is nothing that a person could see."""
        change = self.change(arc)
        if not self.matters(change):
            return None
        kind, yes, no, sentence, about = self._worded(change)
        if not about:
            return None
        boxes_a, boxes_b = self._shown(change, about)
        said = json.dumps([[c.written() for c in (one, *one.parts)] for one in (yes, no)])
        key = f"{kind}-{hashlib.sha1(said.encode(), usedforsecurity=False).hexdigest()[:12]}"
        frame = int(self.network.frames[about[0]])
        margin = float(self.found.cost[arc])
        return Question(key, kind, frame, boxes_a, boxes_b, margin, sentence, yes, no)

    def _worded(self, change: Change) -> tuple[QuestionKind, Correction, Correction, str, list[int]]:
        """Kind, what yes and no say, the question, and the detections that it is about."""
        removed, added = self._by_gap(change.removed), self._by_gap(change.added)
        if len(removed) == len(added) == 2 and not change.dropped and not change.gained:
            frame = max(self._frame(j) for _, j in removed)
            one, two = (self._name(link[0]) for link in removed)
            sentence = f"Do {one} and {two} stay themselves around frame {frame + 1}, and are not exchanged?"
            yes, no = self._several("same", removed), self._several("same", added)
            return "exchange", yes, no, sentence, [n for link in removed for n in link]
        if change.dropped or change.gained:
            return self._on_detection(change)
        if removed:
            i, j = removed[0]
            sentence = f"Is {self._name(i)} in frame {self._frame(i) + 1} the same as in frame {self._frame(j) + 1}?"
            return "link", self._one("same", i, j), self._one("not_same", i, j), sentence, [i, j]
        if added:
            i, j = added[0]
            sentence = (
                f"Are {self._name(i)}, last found in frame {self._frame(i) + 1}, and {self._name(j)}, first found in "
                f"frame {self._frame(j) + 1}, two people?"
            )
            return "end", self._one("not_same", i, j), self._one("same", i, j), sentence, [i, j]
        return "start", self._one("real", 0), self._one("real", 0), "", []

    def _on_detection(self, change: Change) -> tuple[QuestionKind, Correction, Correction, str, list[int]]:
        if change.dropped:
            n, sure, other = change.dropped[0], "real", "not_person"
            sentence = f"Is the box of {self._name(n)} in frame {self._frame(n) + 1} a person?"
        else:
            n, sure, other = change.gained[0], "not_person", "real"
            sentence = f"Is the box in frame {self._frame(n) + 1}, which is in no track, no person?"
        return "detection", self._one(sure, n), self._one(other, n), sentence, [n]

    def _one(self, kind: str, *detections: int) -> Correction:
        return Correction(kind, self._boxes(detections))  # type: ignore[arg-type]

    def _several(self, kind: str, links: list[tuple[int, int]]) -> Correction:
        return Correction("several", parts=tuple(self._one(kind, *link) for link in links))

    def _boxes(self, detections: tuple[int, ...]) -> tuple[Box, ...]:
        rows = list(detections)
        return boxes_of(self.network.frames[rows].tolist(), self.network.boxes[rows].tolist())

    def _by_gap(self, links: tuple[tuple[int, int], ...]) -> list[tuple[int, int]]:
        """Links, the longest first: there the doubt is."""
        return sorted(links, key=lambda link: self._frame(link[0]) - self._frame(link[1]))

    def _frame(self, n: int) -> int:
        return int(self.network.frames[n])

    def _name(self, n: int) -> str:
        return f"person {self.ids[n]}" if self.ids[n] else "a box that is in no track"

    def _shown(self, change: Change, about: list[int]) -> tuple[tuple[ShownBox, ...], tuple[ShownBox, ...]]:
        """The people around what changes, as solved and the other way."""
        other = self._follower.copy()
        for i, _ in change.removed:
            other[i] = -1
        for i, j in change.added:
            other[i] = j
        used = self.flow.used[: len(self.ids)].copy()
        low = min(self._frame(n) for n in about) - AROUND
        high = max(self._frame(n) for n in about) + AROUND
        ends = [n for link in (*change.removed, *change.added) for n in link] + [*change.dropped, *change.gained]
        every = np.flatnonzero((self.network.frames >= low) & (self.network.frames <= high))
        as_solved = self._cut(self._follower, used, every, ends)
        used[list(change.dropped)], used[list(change.gained)] = False, True
        return as_solved, self._cut(other, used, every, ends)

    def _cut(self, follower: IntArray, used: BoolArray, rows: IntArray, ends: list[int]) -> tuple[ShownBox, ...]:
        """Boxes of the tracks that go through some detections, as far as they lie in some rows."""
        place = np.full(len(follower) + 1, -1)
        place[rows] = np.arange(len(rows))
        part = FlowSolution(used[rows], place[follower[rows]], np.zeros(len(rows)), 0.0)
        labels = track_labels(part)
        wanted = {int(labels[place[n]]) for n in ends if place[n] >= 0} - {-1}
        shown, taken, fresh = [], set[int](), int(self.ids.max(initial=0))
        for label in sorted(wanted, key=lambda label: int(rows[np.flatnonzero(labels == label)[0]])):
            own = rows[labels == label]
            known = [int(n) for n in self.ids[own] if n]
            number = known[0] if known else 0
            if number == 0 or number in taken:
                fresh += 1
                number = fresh
            taken.add(number)
            shown += [ShownBox(*box, number) for box in self._boxes(tuple(own.tolist()))]
        return tuple(shown)
