"""What corrections ask of the detections of a network, and which of them contradict each other."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.association.pair_constraints import Pair
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import corners_from_xywh, iou_matrix
from tsuiseki.tracking.review.corrections import Box, Correction
from tsuiseki.tracking.types import FloatArray, IntArray

# Of a box that was spoken of, the detection of its frame is meant that overlaps it most, and by as much.
SAME_BOX = 0.5
NOTHING = -1
# A detection that was deleted later.
GONE = -2


class ContradictionError(RequestError):
    """Two corrections cannot both hold."""

    def __init__(self, one: str, other: str) -> None:
        super().__init__(f"these two cannot both be right: {one}; {other}; take one back")


@dataclass
class Demands:
    """What must hold of detections, by their numbers.

    Attributes:
        frames: ``(N,)`` of the detections.
        used: whether detections are in tracks.
        after: what follows a detection; -1 for nothing.
        before: what precedes it; -1 for nothing.
        pairs: whether two, the earlier one first, are of one track.
        shown: boxes that take the place of the detections', ``(4,)`` pixels.
        names: of the tracks that detections are in.
        left_out: sentences that do not apply.
    """

    frames: IntArray
    used: dict[int, bool] = field(default_factory=dict)
    after: dict[int, int] = field(default_factory=dict)
    before: dict[int, int] = field(default_factory=dict)
    pairs: dict[tuple[int, int], bool] = field(default_factory=dict)
    shown: dict[int, FloatArray] = field(default_factory=dict)
    names: dict[int, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    _said: dict[Any, tuple[Any, str]] = field(default_factory=dict)
    _group: dict[int, int] = field(default_factory=dict)

    def use(self, i: int, wanted: bool, sentence: str) -> None:
        """A detection is a person, or none."""
        self._note(("used", i), wanted, sentence)
        self.used[i] = wanted

    def link(self, i: int, j: int, sentence: str) -> None:
        """One detection follows another; -1 stands for none, at the start or the end of a track."""
        if GONE in (i, j):
            return
        if i != NOTHING:
            self.use(i, True, sentence)
            self._note(("after", i), j, sentence)
            self.after[i] = j
        if j != NOTHING:
            self.use(j, True, sentence)
            self._note(("before", j), i, sentence)
            self.before[j] = i
        if NOTHING not in (i, j):
            self.pair(i, j, True, sentence)

    def pair(self, i: int, j: int, same: bool, sentence: str) -> None:
        """Two detections are of one track, or not."""
        first, last = sorted((i, j), key=lambda n: int(self.frames[n]))
        self._note(("pair", first, last), same, sentence)
        self.pairs[first, last] = same
        if same:
            self._join(i, j, sentence)

    def wanted_pairs(self) -> list[Pair]:
        """`pairs` that links do not make sure of."""
        return [Pair(i, j, same) for (i, j), same in self.pairs.items() if not (same and self.after.get(i) == j)]

    def check(self) -> None:
        """Refuse two that are apart although others put them together.

        Raises:
            ContradictionError: there are some.
        """
        for (i, j), same in self.pairs.items():
            if not same and self._root(i) == self._root(j):
                raise ContradictionError(self._said["pair", i, j][1], self._said["group", self._root(i)][1])

    def _note(self, key: Any, value: Any, sentence: str) -> None:
        known = self._said.setdefault(key, (value, sentence))
        if known[0] != value:
            raise ContradictionError(known[1], sentence)

    def _root(self, i: int) -> int:
        while self._group.get(i, i) != i:
            i = self._group[i]
        return i

    def _join(self, i: int, j: int, sentence: str) -> None:
        """Put two detections into one group, in which each frame stands once."""
        for n in (i, j):
            self._said.setdefault(("frame", self._root(n), int(self.frames[n])), (n, sentence))
        one, other = self._root(i), self._root(j)
        if one != other:
            mine = [key for key in self._said if key[0] == "frame" and key[1] == other]
            for key in mine:
                self._note(("frame", one, key[2]), self._said[key][0], sentence)
            self._group[other] = one
        self._said["group", one] = (one, sentence)


def demands_of(corrections: Sequence[Correction], frames: IntArray, boxes: FloatArray) -> Demands:
    """What corrections ask.

    Args:
        corrections: in the order in which they were said.
        frames: ``(N,)`` of the detections.
        boxes: ``(N, 4)`` pixels.

    Raises:
        ContradictionError: two of them contradict each other; the message has both.
    """
    demands, find = Demands(frames), Finder(frames, boxes)
    said = [
        (one, sentence, [NOTHING if box is None else find(box) for box in one.boxes])
        for one, sentence in _single(corrections)
    ]
    deleted = {n: place for place, (one, _, found) in enumerate(said) if one.kind == "delete" for n in found}
    for place, (one, sentence, found) in enumerate(said):
        there = [n == NOTHING and box is not None for n, box in zip(found, one.boxes, strict=True)]
        if all(there) if one.kind in ("delete", "right", "box") else any(there):
            demands.left_out.append(f"{sentence} (no detection is there)")
            continue
        # Who deletes a track takes back what was said of it before.
        gone = [n for n in found if deleted.get(n, -1) > place]
        if not gone:
            _ask(demands, one, found, sentence)
        elif one.kind in ("switch", "right"):
            _ask(demands, one, [GONE if n in gone else n for n in found], sentence)
    demands.check()
    return demands


def _single(corrections: Sequence[Correction]) -> Iterator[tuple[Correction, str]]:
    """Corrections that say one thing, with the sentences that they came in."""
    for one in corrections:
        for part in one.parts if one.kind == "several" else (one,):
            yield part, str(one)


def _ask(demands: Demands, one: Correction, numbers: list[int], sentence: str) -> None:
    known = [n for n in numbers if n != NOTHING]
    if one.kind in ("same", "not_same"):
        demands.pair(numbers[0], numbers[1], one.kind == "same", sentence)
        for n in numbers:
            demands.use(n, True, sentence)
    elif one.kind == "switch":
        a, b, a_after, b_after = numbers
        demands.link(a, b_after, sentence)
        demands.link(b, a_after, sentence)
    elif one.kind == "delete":
        for n in known:
            demands.use(n, False, sentence)
    elif one.kind in ("next", "right"):
        for i, j in itertools.pairwise(known):
            demands.link(i, j, sentence)
    elif one.kind == "name":
        demands.names[known[0]] = one.name
    elif one.kind == "not_person":
        demands.use(known[0], False, sentence)
    else:
        demands.use(known[0], True, sentence)
        if one.kind == "box":
            demands.shown[known[0]] = corners(one.there[-1])


def corners(box: Box) -> FloatArray:
    """``(4,)`` x1, y1, x2, y2."""
    return np.asarray(corners_from_xywh(np.array([box[1:]]))[0])


class Finder:
    """Looks up detections by boxes.

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
    """

    def __init__(self, frames: IntArray, boxes: FloatArray) -> None:
        self._boxes = boxes
        self._order = np.argsort(frames, kind="stable")
        self._sorted = frames[self._order]

    def __call__(self, box: Box) -> int:
        """Number of the detection that a box of its frame means, -1 for none."""
        rows = self._order[slice(*np.searchsorted(self._sorted, [box.frame, box.frame + 1]))]
        if len(rows) == 0:
            return NOTHING
        overlap = iou_matrix(corners(box)[None], self._boxes[rows])[0]
        best = int(overlap.argmax())
        return int(rows[best]) if overlap[best] >= SAME_BOX else NOTHING


def unmet_boxes(corrections: Sequence[Correction], frames: IntArray, boxes: FloatArray) -> list[Box]:
    """Boxes of people where no detection is: they become detections."""
    find, new = Finder(frames, boxes), dict[Box, None]()
    for one, _ in _single(corrections):
        if one.kind in ("real", "box") and all(find(box) == NOTHING for box in one.there):
            new[one.there[-1]] = None
    return list(new)
