"""What corrections ask of the detections of a network, and which of them contradict each other."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.association.nearby import ranges
from tsuiseki.tracking.association.pair_constraints import Pair
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.correction_log import Box, Correction
from tsuiseki.tracking.geometry import corners_from_xywh, iou_pairs
from tsuiseki.tracking.types import FloatArray, IntArray

# Of a box that was spoken of, the detection of its frame is meant that overlaps it most, and by as much.
SAME_BOX = 0.5
# Stands for no detection: nothing follows, nothing precedes, or none was found.
NOTHING = -1
# Stands for a detection that was deleted later.
GONE = -2


class ContradictionError(RequestError):
    """Two corrections cannot both hold."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"these two cannot both be right: {first}; {second}; take one back")


@dataclass
class _Group:
    """Detections of one person by frame, each with the sentence that put it there, and the last sentence."""

    members: dict[int, tuple[int, str]]
    sentence: str


@dataclass
class Demands:
    """What must hold of detections, by their numbers.

    Attributes:
        frames: ``(N,)`` of the detections.
        used: whether detections are in tracks.
        followers: what follows a detection; -1 for nothing.
        predecessors: what precedes it; -1 for nothing.
        pairs: whether two, the earlier one first, are of one track.
        drawn_boxes: that take the place of the detections', ``(4,)`` pixels.
        names: of the tracks that detections are in.
        left_out: sentences that do not apply.
    """

    frames: IntArray
    used: dict[int, bool] = field(default_factory=dict)
    followers: dict[int, int] = field(default_factory=dict)
    predecessors: dict[int, int] = field(default_factory=dict)
    pairs: dict[tuple[int, int], bool] = field(default_factory=dict)
    drawn_boxes: dict[int, FloatArray] = field(default_factory=dict)
    names: dict[int, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    _sentences: dict[tuple[int, Any], str] = field(default_factory=dict)
    _groups: dict[int, _Group] = field(default_factory=dict)

    def use(self, i: int, is_person: bool, sentence: str) -> None:
        """A detection is a person, or none."""
        self._note(self.used, i, is_person, sentence)

    def link(self, i: int, j: int, sentence: str) -> None:
        """One detection follows another; -1 stands for none, at the start or the end of a track."""
        if GONE in (i, j):
            return
        for table, key, value in ((self.followers, i, j), (self.predecessors, j, i)):
            if key != NOTHING:
                self.use(key, True, sentence)
                self._note(table, key, value, sentence)
        if NOTHING not in (i, j):
            self.pair(i, j, True, sentence)

    def pair(self, i: int, j: int, same: bool, sentence: str) -> None:
        """Two detections are of one track, or not."""
        first, last = sorted((i, j), key=lambda n: int(self.frames[n]))
        self._note(self.pairs, (first, last), same, sentence)
        if same:
            self._join(i, j, sentence)

    def leave_alone(self, i: int, sentence: str) -> None:
        """A box that was drawn of nobody is a track of its own, unless something else was said of it."""
        if i != NOTHING and i not in self._groups and i not in self.followers and i not in self.predecessors:
            self.link(NOTHING, i, sentence)
            self.link(i, NOTHING, sentence)

    def wanted_pairs(self) -> list[Pair]:
        """What `pairs` come to that links do not make sure of: of one person, neighbours in time."""
        groups = {id(group): group for group in self._groups.values()}.values()
        members = [sorted(group.members.items()) for group in groups]
        same = [pair for group in members for pair in itertools.pairwise(n for _, (n, _) in group)]
        together = [Pair(i, j, same=True) for i, j in same if self.followers.get(i) != j]
        return together + [Pair(i, j, same=False) for (i, j), same in self.pairs.items() if not same]

    def check(self) -> None:
        """Refuse two that are apart although others put them together.

        Raises:
            ContradictionError: there are some.
        """
        for (i, j), same in self.pairs.items():
            group = self._groups.get(i)
            if not same and group is not None and group is self._groups.get(j):
                raise ContradictionError(self._sentences[id(self.pairs), (i, j)], group.sentence)

    def _note(self, table: dict[Any, Any], key: Any, value: Any, sentence: str) -> None:
        earlier = self._sentences.setdefault((id(table), key), sentence)
        if table.setdefault(key, value) != value:
            raise ContradictionError(earlier, sentence)

    def _join(self, i: int, j: int, sentence: str) -> None:
        """Put two detections into one group, in which each frame stands once."""
        group, joining = (
            self._groups.setdefault(n, _Group({int(self.frames[n]): (n, sentence)}, sentence)) for n in (i, j)
        )
        if group is not joining:
            for frame, (n, _) in joining.members.items():
                member, reason = group.members.setdefault(frame, (n, sentence))
                if member != n:
                    raise ContradictionError(reason, sentence)
                self._groups[n] = group
        group.sentence = sentence


def demands_of(corrections: Sequence[Correction], frames: IntArray, boxes: FloatArray) -> Demands:
    """What corrections, in their order, ask of detections of ``(N,)`` frames and ``(N, 4)`` boxes in pixels.

    Raises:
        ContradictionError: two of them contradict each other; the message has both.
    """
    demands, single = Demands(frames), [*_single(corrections)]
    places = iter(Finder(frames, boxes).all([box for correction, _ in single for box in correction.there]))
    sentences = [
        (correction, sentence, [NOTHING if box is None else next(places) for box in correction.boxes])
        for correction, sentence in single
    ]
    deleted = {
        n: place
        for place, (correction, _, numbers) in enumerate(sentences)
        if correction.kind == "delete"
        for n in numbers
    }
    for place, (correction, sentence, numbers) in enumerate(sentences):
        lost = [n == NOTHING and box is not None for n, box in zip(numbers, correction.boxes, strict=True)]
        if all(lost) if correction.kind in ("delete", "right", "box") else any(lost):
            demands.left_out.append(f"{sentence} (no detection is there)")
            continue
        # Who deletes a track takes back what was decided of it before.
        numbers = [GONE if deleted.get(n, -1) > place else n for n in numbers]
        if GONE not in numbers or correction.kind in ("switch", "right"):
            _ask(demands, correction, numbers, sentence)
    for correction, sentence, numbers in sentences:
        if correction.kind == "box" and len(numbers) == 1 and numbers[0] not in deleted:
            demands.leave_alone(numbers[0], sentence)
    demands.check()
    return demands


def _single(corrections: Sequence[Correction]) -> Iterator[tuple[Correction, str]]:
    """Corrections that say one thing, with the sentences that they came in."""
    return ((part, str(correction)) for correction in corrections for part in correction.parts or (correction,))


def _ask(demands: Demands, correction: Correction, numbers: list[int], sentence: str) -> None:
    present = [n for n in numbers if n != NOTHING]
    if correction.kind == "switch":
        a, b, a_after, b_after = numbers
        demands.link(a, b_after, sentence)
        demands.link(b, a_after, sentence)
    elif correction.kind in ("next", "right"):
        for i, j in itertools.pairwise(present):
            demands.link(i, j, sentence)
    elif correction.kind == "name":
        demands.names[present[0]] = correction.name
    else:
        if correction.kind in ("same", "not_same"):
            demands.pair(numbers[0], numbers[1], correction.kind == "same", sentence)
        elif correction.kind == "box":
            demands.drawn_boxes[present[0]] = corners(correction.there[-1])
        for n in present[:1] if correction.kind == "box" else present:
            demands.use(n, correction.kind not in ("delete", "not_person"), sentence)


def corners(box: Box) -> FloatArray:
    """``(4,)`` x1, y1, x2, y2."""
    return np.asarray(corners_from_xywh(np.array([box[1:]]))[0])


class Finder:
    """Finds detections, of ``(N,)`` frames and ``(N, 4)`` boxes in pixels, by boxes that were spoken of."""

    def __init__(self, frames: IntArray, boxes: FloatArray) -> None:
        self._boxes = boxes
        self._order = np.argsort(frames, kind="stable")
        self._sorted = frames[self._order]

    def __call__(self, box: Box) -> int:
        """Number of the detection that a box of its frame means, -1 for none."""
        return self.all([box])[0]

    def all(self, boxes: Sequence[Box]) -> list[int]:
        """The same of each of the boxes."""
        if not boxes:
            return []
        table = np.array(boxes)
        start, end = (np.searchsorted(self._sorted, table[:, 0], side=side) for side in ("left", "right"))
        which, places = ranges(start, end - start)
        rows = self._order[places]
        overlap = iou_pairs(corners_from_xywh(table[which, 1:]), self._boxes[rows])
        # By box, then the best first; of equal ones the earlier row.
        best, here = np.lexsort((-overlap, which)), np.flatnonzero(end > start)
        winners = best[np.searchsorted(which, here)]
        numbers = np.full(len(boxes), NOTHING)
        numbers[here] = np.where(overlap[winners] >= SAME_BOX, rows[winners], NOTHING)
        return [int(n) for n in numbers]


def unmet_boxes(corrections: Sequence[Correction], frames: IntArray, boxes: FloatArray) -> list[Box]:
    """Boxes of people where no detection is: they become detections."""
    people = [correction.there for correction, _ in _single(corrections) if correction.kind in ("real", "box")]
    places = iter(Finder(frames, boxes).all([*itertools.chain(*people)]))
    met = [max(next(places) for _ in there) != NOTHING for there in people]
    return [*dict.fromkeys(there[-1] for there, is_met in zip(people, met, strict=True) if not is_met)]
