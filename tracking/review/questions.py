"""Decisions that a flow was least certain of, as questions that are answered with yes or no.

What the other way costs more (`marginals`) says how likely a decision is wrong, and the tracks say how many detections
it would spoil. Questions come by the product, in which a long track counts no more than `ENOUGH` detections: else sure
decisions about long tracks come before likely errors. Neighbouring links of a track that are about as doubtful are one
question about the boxes before and after them; two people who may have been exchanged are one, too.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from tsuiseki.tracking.association.marginals import Marginals
from tsuiseki.tracking.association.network_flow import FlowSolution, track_labels
from tsuiseki.tracking.association.residual_flow import FREE, ResidualFlow
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.formats.correction_log import Box, Correction, Kind, boxes_of
from tsuiseki.tracking.types import FloatArray, IntArray

QuestionKind = Literal["link", "start", "end", "detection", "exchange"]
# Decisions whose other way costs this much more are certain.
LIMIT = 6.0
# And so much where two people may be exchanged, for which all ways between them have to be weighed.
CLOSE = 2.5
# Detections on both sides of a link that one question is about at most.
LONGEST = 10
# A neighbouring link belongs to a question if it is at least this share as likely to be wrong.
AS_DOUBTFUL = 0.3
# Detections further on that are another person's, too, where a link is wrong.
FAR = 5
# Exchanges that are weighed at most.
WEIGHED = 100
# Spoilt detections beyond which an error weighs no more, chosen on generated streets.
ENOUGH = 5
# Frames that are shown before and after those that a question is about.
AROUND = 12


@dataclass(frozen=True)
class WrongLogits:
    """Logits of the probability that a decision is wrong whose other way costs nothing, fitted on MOT17 val-half.

    Attributes:
        link: of a link from one frame to the next.
        gap: what each doubling of a link's gap adds.
        exchanged: of two people who may be exchanged.
        apart: of two tracks that may be one.
        parted: likewise, where a person parted tracks.
        false_positive: of a track that may be a false positive.
        left_out: of a track that was left out as one.
        slope: by how much each unit of cost lowers a logit.
    """

    link: float = -1.6
    gap: float = 0.45
    exchanged: float = -1.5
    apart: float = -2.0
    parted: float = -1.5
    false_positive: float = -2.0
    left_out: float = -1.0
    slope: float = 0.45


LOGITS = WrongLogits()


@dataclass(frozen=True)
class Question:
    """A decision that can be answered with yes (as it was solved) or no (the other way).

    Attributes:
        key: the same as long as the question is.
        kind: what is asked.
        frame: to show, from 0.
        boxes_a: the people as solved, by id.
        boxes_b: the same the other way.
        margin: how much more the other way costs.
        wrong: how likely the answer is no.
        sentence: the question.
        yes: what yes means.
        no: with no.
    """

    key: str
    kind: QuestionKind
    frame: int
    boxes_a: Mapping[int, tuple[Box, ...]]
    boxes_b: Mapping[int, tuple[Box, ...]]
    margin: float
    wrong: float
    sentence: str
    yes: Correction
    no: Correction


_Links = Sequence[tuple[int, int]]
# How likely decisions are wrong, how many detections that spoils, their arcs, and what words one of them.
_Kind = tuple[FloatArray, FloatArray | IntArray, IntArray, Callable[[int, float, set[int]], Question]]


class Questioner:
    """Ranks the decisions of a flow and words them.

    Args:
        network: of the flow.
        flow: settled as far as a person did.
        ids: ``(N,)`` ids of detections, 0 for none.
        parted: detections at which a person parted tracks.
        noun: what is tracked.
    """

    def __init__(
        self, network: SolvedNetwork, flow: ResidualFlow, ids: IntArray, parted: Set[int] = frozenset(),
        noun: str = "person",
    ) -> None:  # fmt: skip
        self.network, self.flow, self.ids, self.noun = network, flow, ids, noun
        self._parted = np.isin(np.arange(flow.count), list(parted))
        first, graph = 3 * flow.count, flow.graph
        here = (ids[graph.tail] > 0) & (ids[graph.head] > 0) & ~flow.used[first:]
        self.marginals = Marginals(flow, CLOSE, np.append(np.zeros(first, np.bool_), here))
        solution = flow.solution()
        self._follower, self._labels = solution.follower, track_labels(solution)
        order = np.lexsort((network.frames, self._labels))
        self._rank, self._predecessor = np.empty(flow.count, np.int64), np.full(flow.count, -1)
        self._rank[order] = np.arange(flow.count) - np.searchsorted(self._labels[order], self._labels[order])
        self._length = np.bincount(self._labels + 1, minlength=1)[self._labels + 1]
        linked = np.flatnonzero(self._follower >= 0)
        self._predecessor[self._follower[linked]] = linked

    def ranked(self, limit: int, without: Set[str] = frozenset()) -> list[Question]:
        """As many questions, first those whose wrong answer probably costs most, without those of some keys."""
        questions: dict[str, tuple[float, Question]] = {}
        for wrong, spoilt, arcs, ask in (self._links(), self._joins(), self._exchanges(), self._tracks()):
            weight, covered, count = wrong * np.minimum(spoilt, ENOUGH), set[int](), 0
            for n in np.argsort(-weight, kind="stable").tolist():
                if count == limit or weight[n] <= 0:
                    break
                if int(arcs[n]) not in covered:
                    question = ask(int(arcs[n]), float(wrong[n]), covered)
                    if question.key not in without:
                        questions[question.key] = float(weight[n]), question
                        count += 1
        return [question for _, question in sorted(questions.values(), key=lambda entry: -entry[0])[:limit]]

    def _links(self) -> _Kind:
        """Links of tracks, as one person or two: what it costs to end one track and start another there."""
        first, flow = 3 * self.flow.count, self.flow
        arcs = first + np.flatnonzero(flow.used[first:] & (self.ids[flow.graph.tail] > 0))
        i, j = self._ends(arcs)
        gap = np.maximum(self.network.frames[j] - self.network.frames[i], 1)
        wrong = probability(self.marginals.through[arcs], LOGITS.link + LOGITS.gap * np.log2(gap))
        self._doubt = np.zeros(flow.count)
        self._doubt[j] = wrong
        return wrong, np.minimum(self._rank[i] + 1, self._length[j] - self._rank[j]), arcs, self._ask_of_link

    def _ask_of_link(self, arc: int, wrong: float, covered: set[int]) -> Question:
        i, j = (int(end[0]) for end in self._ends(np.array([arc])))
        links, segment = [(i, j)], [i, j]
        for _ in range(LONGEST):
            predecessor, successor = int(self._predecessor[segment[0]]), int(self._follower[segment[-1]])
            if predecessor >= 0 and self._doubt[segment[0]] >= AS_DOUBTFUL * wrong:
                segment.insert(0, predecessor)
            if successor >= 0 and self._doubt[successor] >= AS_DOUBTFUL * wrong:
                segment.append(successor)
        covered |= {self.flow.link(*pair) for pair in itertools.pairwise(segment)}
        i, j = segment[0], segment[-1]
        sentence = f"Is {self._name(i)} in frame {self._frame(i) + 1} the same as in frame {self._frame(j) + 1}?"
        # Who is another person before and after is so for some time: no single box is to blame.
        far = i, j
        for _ in range(FAR):
            predecessor, successor = int(self._predecessor[far[0]]), int(self._follower[far[1]])
            far = predecessor if predecessor >= 0 else far[0], successor if successor >= 0 else far[1]
        parts = tuple(self._answer("not_same", *pair) for pair in dict.fromkeys([(i, j), far]))
        answers = self._answer("right", *segment), Correction("several", parts=parts)
        return self._question("link", (links, ()), [i, j], arc, wrong, sentence, answers)

    def _joins(self) -> _Kind:
        """Tracks that may go on as another."""
        first, graph = 3 * self.flow.count, self.flow.graph
        i, j = graph.tail, graph.head
        apart = (self._follower[i] < 0) & (self._predecessor[j] < 0) & (self.ids[i] > 0) & (self.ids[j] > 0)
        arcs = first + np.flatnonzero(apart & (self.marginals.through[first:] < LIMIT))
        i, j = self._ends(arcs)
        logit = np.where(self._parted[i] | self._parted[j], LOGITS.parted, LOGITS.apart)
        wrong = scipy.special.expit(logit - self.marginals.through[arcs])
        # An end goes on as one other at most.
        several = np.maximum(np.bincount(i, wrong, self.flow.count)[i], np.bincount(j, wrong, self.flow.count)[j])
        wrong = wrong / np.maximum(several, 1)
        return wrong, np.minimum(self._length[i], self._length[j]), arcs, self._ask_of_join

    def _ask_of_join(self, arc: int, wrong: float, _: set[int]) -> Question:
        i, j = (int(end[0]) for end in self._ends(np.array([arc])))
        sentence = (
            f"Are {self._name(i)}, last detected in frame {self._frame(i) + 1}, and {self._name(j)}, first detected in "
            f"frame {self._frame(j) + 1}, different?"
        )
        answers = self._answer("not_same", i, j), self._answer("next", i, j)
        return self._question("end", ((), [(i, j)]), [i, j], arc, wrong, sentence, answers)

    def _exchanges(self) -> _Kind:
        """Two tracks that may go on as each other."""
        first = 3 * self.flow.count
        cost = self.marginals.cost[first:]
        here = np.flatnonzero(~self.flow.used[first:] & (cost < np.minimum(self.marginals.through[first:], CLOSE)))
        # What changes together costs the same.
        _, first_rows = np.unique(np.rint(cost[here] * 1e6), return_index=True)
        self._changes, spoilt = dict[int, tuple[_Links, _Links]](), list[int]()
        for arc in (first + here[first_rows[:WEIGHED]]).tolist():
            cycle = self.marginals.cycle(arc)
            links, used = cycle[cycle >= first], self.flow.used[cycle[cycle >= first]]
            removed, added = (np.column_stack(self._ends(part)).tolist() for part in (links[used], links[~used]))
            if len(links) == len(cycle) == 4 and len(removed) == len(added) == 2:
                self._changes[arc] = removed, added
                spoilt.append(self._exchanged(removed))
        arcs = np.array([*self._changes], dtype=np.int64)
        wrong = probability(self.marginals.cost[arcs], LOGITS.exchanged)
        return wrong, np.array(spoilt, dtype=np.float64), arcs, self._ask_of_exchange

    def _exchanged(self, removed: _Links) -> int:
        """How many detections get into another track, the shorter sides of both."""
        (i, j), (k, m) = removed
        if min(self.ids[i], self.ids[k]) == 0 or self._labels[i] == self._labels[k]:
            return 0
        heads = int(self._rank[i] + self._rank[k]) + 2
        return min(heads, int(self._length[j] - self._rank[j] + self._length[m] - self._rank[m]))

    def _ask_of_exchange(self, arc: int, wrong: float, _: set[int]) -> Question:
        change = self._changes[arc]
        (i, j), (k, m) = change[0]
        sentence = (
            f"Do {self._name(i)} and {self._name(k)} stay themselves from frame {self._frame(i) + 1} to "
            f"{self._frame(j) + 1}, and are not exchanged?"
        )
        yes, no = (Correction("several", parts=tuple(self._answer("next", *link) for link in part)) for part in change)
        return self._question("exchange", change, [i, j, k, m], arc, wrong, sentence, (yes, no))

    def _tracks(self) -> _Kind:
        """Tracks that may be false positives, and those that were left out as such and may be right."""
        labels, flow = self._labels, self.flow
        used = np.flatnonzero(labels >= 0)
        owner = np.concatenate([np.tile(labels, 3), labels[flow.graph.tail]])
        arcs = np.flatnonzero(flow.used & (owner >= 0))
        total = np.bincount(owner[arcs], flow.cost[arcs] / 1e6, int(labels.max(initial=-1)) + 1)
        settled = np.zeros(len(total), dtype=np.bool_)
        settled[labels[used[flow.status[used] != FREE]]] = True
        middle = used[(self._rank[used] == self._length[used] // 2) & ~settled[labels[used]]]
        margin = np.maximum(-total[labels[middle]], 0)
        out = self.ids[middle] == 0
        wrong = probability(np.where(out, 0, margin), np.where(out, LOGITS.left_out, LOGITS.false_positive))
        return wrong, self._length[middle], middle, self._ask_of_track

    def _ask_of_track(self, n: int, wrong: float, _: set[int]) -> Question:
        answers = self._answer("real", n), self._answer("delete", *np.flatnonzero(self._labels == self._labels[n]))
        sentence = f"Is {self._name(n)} a real {self.noun}?"
        if not self.ids[n]:
            sentence = f"Is the dropped track around frame {self._frame(n) + 1} a false positive?"
            answers = answers[::-1]
        return self._question("detection", ((), ()), [n], n, wrong, sentence, answers)

    def _question(
        self,
        kind: QuestionKind,
        change: tuple[_Links, _Links],
        about: list[int],
        arc: int,
        wrong: float,
        sentence: str,
        answers: tuple[Correction, Correction],
    ) -> Question:
        """A question whose other way gives up links and takes others; what yes and no mean."""
        follower, frames = self._follower.copy(), self.network.frames
        follower[[i for i, _ in change[0]]] = -1
        for i, j in change[1]:
            follower[i] = j
        rows = np.flatnonzero((frames >= frames[about].min() - AROUND) & (frames <= frames[about].max() + AROUND))
        # The other way of a person is a false positive.
        boxes = self._cut(self._follower, rows, about), self._cut(follower, rows, about) if len(about) > 1 else {}
        text = json.dumps([answer.written() for answer in answers])
        key = f"{kind}-{hashlib.sha1(text.encode(), usedforsecurity=False).hexdigest()[:12]}"
        cost = self.marginals.through if kind in ("link", "end") else self.marginals.cost
        return Question(key, kind, self._frame(about[0]), *boxes, float(cost[arc]), wrong, sentence, *answers)

    def _ends(self, arcs: IntArray) -> tuple[IntArray, IntArray]:
        return self.flow.tail[arcs] // 2, self.flow.head[arcs] // 2

    def _answer(self, kind: Kind, *detections: int) -> Correction:
        return Correction(kind, self._boxes(np.array(detections)))

    def _boxes(self, rows: IntArray) -> tuple[Box, ...]:
        return boxes_of(self.network.frames[rows].tolist(), self.network.boxes[rows].tolist())

    def _frame(self, n: int) -> int:
        return int(self.network.frames[n])

    def _name(self, n: int) -> str:
        return f"{self.noun} {self.ids[n]}"

    def _cut(self, follower: IntArray, rows: IntArray, about: list[int]) -> dict[int, tuple[Box, ...]]:
        """Boxes of the tracks that go through some detections, by id, as far as they lie in some rows."""
        place, rows = np.full(len(follower) + 1, -1), rows[np.argsort(self.network.frames[rows], kind="stable")]
        place[rows] = np.arange(len(rows))
        labels = track_labels(FlowSolution(self.flow.used[rows], place[follower[rows]]))
        boxes, fresh = dict[int, tuple[Box, ...]](), int(self.ids.max(initial=0))
        for label in sorted({int(labels[place[n]]) for n in about} - {-1}):
            members = rows[labels == label]
            number = int(self.ids[members[0]])
            if number == 0 or number in boxes:
                number = fresh = fresh + 1
            boxes[number] = self._boxes(members)
        return boxes


def probability(margin: FloatArray, logit: FloatArray | float) -> FloatArray:
    """``(Q,)`` how likely decisions are wrong whose other way costs ``(Q,)`` more."""
    return np.asarray(scipy.special.expit(logit - LOGITS.slope * np.asarray(margin)))
