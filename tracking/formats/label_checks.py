"""What all labels are asked: which can be used, which class counts, and whether boxes can be pixels of the picture.

Labels that cannot be used are left out, counted and named; where most of a file are so, it is refused.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.types.class_choice import PERSON_NAMES, ClassChoice
from tsuiseki.tracking.types.labels import GroundTruth

# What asks for people as every layout counts them.
PEOPLE = "person"
Entry = TypeVar("Entry")
Label = TypeVar("Label")
# Share of the labels of a file above which it is refused, if they cannot be used.
MOST_UNUSABLE = 0.5
# Reasons that a message lists.
LISTED = 4
# Why a box cannot be used that stands among tracks.
WITHOUT_ID = "without an id"


class UnusableError(ValueError):
    """A label cannot be used; the text says why as it stands after a number, such as "without an area"."""


@dataclass
class Sieve:
    """Keeps the labels of a file that can be used; those that cannot be are left out, counted and named.

    Attributes:
        where: they are read, for messages.
        what: they are, in words.
        total: how many there were so far.
        left_out: by reason how many were left out, and the name of the first.
        mended: likewise, of those that are used as something else than what the file says.
    """

    where: object
    what: str = "labelled boxes"
    total: int = 0
    left_out: dict[str, tuple[int, str]] = field(default_factory=dict)
    mended: dict[str, tuple[int, str]] = field(default_factory=dict)

    def read(self, entries: Iterable[tuple[str, Entry]], label_of: Callable[[str, Entry], Label]) -> Iterator[Label]:
        """The labels of named entries, but for those for which ``label_of`` raises `UnusableError`."""
        for name, entry in entries:
            self.total += 1
            try:
                yield label_of(name, entry)
            except UnusableError as error:
                _count(self.left_out, str(error), name)

    def usable(self, names: Sequence[str], *cases: tuple[BoolArray, str]) -> BoolArray:
        """``(N,)`` the rows of which no case is true; a case says which rows cannot be used, and why."""
        self.total += len(names)
        bad = np.zeros(len(names), dtype=np.bool_)
        for case, reason in cases:
            for row in np.flatnonzero(case & ~bad).tolist():
                _count(self.left_out, reason, names[row])
            bad |= case
        return ~bad

    def mend(self, name: str, reason: str) -> None:
        """Count a label that is used as something else, which the reason says after a number."""
        _count(self.mended, reason, name)

    def tell(self) -> None:
        """Warn of labels that were left out or mended; raises RequestError where most of them cannot be used."""
        omitted = sum(count for count, _ in self.left_out.values())
        if omitted > MOST_UNUSABLE * self.total:
            raise RequestError(
                f"{self.where}: expected {self.what} that can be used, but {omitted} of {self.total} cannot: "
                f"{_listed(self.left_out)}; mend the file"
            )
        for reasons, result in ((self.left_out, "are left out"), (self.mended, "are not used as they stand")):
            if reasons:
                count = sum(count for count, _ in reasons.values())
                line = f"{count} of {self.total} {self.what} {result}: {_listed(reasons)}"
                warnings.warn(f"{self.where}: {line}", InputWarning, stacklevel=3)


def _count(reasons: dict[str, tuple[int, str]], reason: str, name: str) -> None:
    count, first = reasons.get(reason, (0, name))
    reasons[reason] = count + 1, first


def _listed(reasons: Mapping[str, tuple[int, str]]) -> str:
    parts = [f"{n} {reason} ({'the first ' if n > 1 else ''}{name})" for reason, (n, name) in reasons.items()]
    return ", ".join([*parts[:LISTED], *(["…"] if len(parts) > LISTED else [])])


class NothingLabelledError(RequestError):
    """A sequence has no box that counts."""


@dataclass(frozen=True)
class LabelFile:
    """A video's name, its images by frame, none where there are labels alone, and its label file."""

    name: str
    images: tuple[Path, ...]
    labels: Path


def wanted_numbers(
    kind: int | str | None, names: Mapping[int, str], people: Collection[int], what: object
) -> tuple[int, ...]:
    """Numbers of the classes of a layout that count.

    Args:
        kind: a number, a name, or ``person`` or None for people.
        names: of all classes, by number.
        people: numbers of those that are people.
        what: has them, for messages.

    Raises:
        RequestError: there is no such class.
    """
    if kind is None or ClassChoice((kind,)).plain == (PEOPLE,):
        return tuple(people)
    return ClassChoice((kind,)).numbers(names, names.keys(), what)


def identified(where: object, truth: GroundTruth) -> GroundTruth:
    """The labels without boxes that count but have no id, -1; a warning counts them.

    Raises:
        RequestError: most of the boxes that count have none.
    """
    without = truth.evaluated & (truth.ids < 0)
    count, total = int(without.sum()), int(truth.evaluated.sum())
    if count > MOST_UNUSABLE * total:
        got = "found none" if count == total else f"found none of {count} among {total}"
        raise RequestError(
            f"{where}: expected an id of each box (COCO: track_id, CEPDOF: person_id), {got}; labels of single "
            "pictures teach and score detections"
        )
    names = [f"in frame {frame + 1}" for frame in truth.frames[truth.evaluated].tolist()]
    sieve = Sieve(where)
    sieve.usable(names, (without[truth.evaluated], WITHOUT_ID))
    sieve.tell()
    return truth.select(~without)


def same_class(name: str, other_name: str) -> bool:
    """Whether two names are of one class; all names of people are.

    >>> same_class("Person", "pedestrian"), same_class("car", "Car"), same_class("car", "truck")
    (True, True, False)
    """
    first, second = name.strip().lower(), other_name.strip().lower()
    return first == second or {first, second} <= set(PERSON_NAMES)


# Pixels that no picture has.
FARTHEST = 1e7
# Counting from 1 moves shares of 0 to -1.
WITHIN_A_PIXEL = 1.01
# Share of the boxes from which on a warning says that they leave the picture.
FEW = 0.1
# Share of the boxes from which on they are refused.
MOST = 0.5
# Share of its area from which on a box leaves the picture.
CUT = 0.3


def compare_with_picture(where: str | Path, boxes: FloatArray, size: tuple[int, int] | None = None) -> None:
    """Refuse boxes that are no pixels of the picture, and warn of those that may not be.

    Args:
        where: they were read, for the message.
        boxes: ``(N, 4)`` corners, 0-based pixels; rows of NaN are passed over.
        size: width and height of the picture; where it is not known, only shares are recognised.

    Raises:
        RequestError: they look like shares from 0 to 1 or like corners taken for widths, or all are outside,
            or one is farther than any picture reaches.
    """
    boxes = boxes[np.isfinite(boxes).all(axis=1)]
    if not len(boxes):
        return
    if np.abs(boxes).max() > FARTHEST:
        raise RequestError(f"{where}: expected boxes in pixels, got one that reaches {np.abs(boxes).max():g}")
    if np.abs(boxes).max() <= WITHIN_A_PIXEL and (size is None or min(size) > 2):
        raise RequestError(
            f"{where}: expected boxes in pixels, got {len(boxes)} within one pixel, which look like shares of the "
            "picture from 0 to 1; multiply them by its width and height"
        )
    if size is None:
        return
    inside = areas(clip_boxes(boxes, *size))
    leaving = float(np.mean(inside < (1 - CUT) * areas(boxes)))
    picture = f"the picture of {size[0]}x{size[1]}"
    if leaving > FEW and _like_corners(boxes, size):
        text = (
            f"{where}: {leaving:.0%} of the boxes leave {picture}, but fit as corners x1, y1, x2, y2; expected x, y, "
            "width, height: subtract x1 and y1 from the last two"
        )
        if leaving > MOST:
            raise RequestError(text)
        warnings.warn(text, InputWarning, stacklevel=3)
        return
    outside = int(np.sum(inside <= 0))
    reach = f"they reach {boxes[:, 2].max():.0f},{boxes[:, 3].max():.0f}; are they those of a picture of another size?"
    if outside == len(boxes):
        raise RequestError(f"{where}: expected boxes in {picture}, got all {outside} outside of it; {reach}")
    if outside > FEW * len(boxes):
        warnings.warn(
            f"{where}: {outside} of {len(boxes)} boxes lie outside {picture}; {reach}", InputWarning, stacklevel=3
        )


def _like_corners(boxes: FloatArray, size: tuple[float, float]) -> bool:
    """Whether what was read as x, y, width, height is corners in the picture, whose borders may be passed a bit."""
    second = boxes[:, 2:] - boxes[:, :2]
    fits = (second > boxes[:, :2]).all(axis=1) & (second <= 1.05 * np.array(size)).all(axis=1)
    return bool(fits.mean() > 0.99)


# Right boxes, as a share of the fewer of boxes and labels, below which a result is distinguished from a poor one.
RARE = 0.02


def compare_with_labels(where: str | Path, right: int, boxes: FloatArray, labels: FloatArray) -> None:
    """Warn of boxes that lie elsewhere than the labels do, as where neither states the size of the picture.

    Args:
        where: they were read, for the message.
        right: number of those that are on a label.
        boxes: ``(N, 4)`` pixels, of those that count.
        labels: ``(M, 4)`` pixels, of the labelled boxes.
    """
    if right >= RARE * min(len(boxes), len(labels)):
        return
    size = labels[:, 2:].max(axis=0)
    hint = "are they those of another video, or of a picture of another size?"
    if _like_corners(boxes, (size[0], size[1])):
        hint = "they fit as corners x1, y1, x2, y2, where x, y, width, height are expected"
    there, here = (
        "{:.0f},{:.0f} to {:.0f},{:.0f}".format(*part[:, :2].min(axis=0), *part[:, 2:].max(axis=0))
        for part in (boxes, labels)
    )
    line = f"{right} of {len(boxes)} boxes are on labelled ones; they lie in {there}, the labels in {here}; {hint}"
    warnings.warn(f"{where}: {line}", InputWarning, stacklevel=3)


# Boxes that tell.
ENOUGH = 20


@dataclass
class BoxCheck:
    """Takes the boxes of ``what``, in pictures of a size, until there are enough, and says once what does not fit."""

    what: str
    size: tuple[int, int] | None = None
    _boxes: list[FloatArray] | None = field(default_factory=list)

    def add(self, boxes: FloatArray) -> None:
        """Take the ``(N, 4)`` boxes of the next frame; raises RequestError, see `tell`."""
        if self._boxes is None:
            return
        self._boxes.append(boxes)
        if sum(map(len, self._boxes)) >= ENOUGH:
            self.tell()

    def tell(self) -> None:
        """Compare them, where that was not done before; raises RequestError, see `compare_with_picture`."""
        boxes, self._boxes = np.concatenate([np.empty((0, 4)), *(self._boxes or [])]), None
        compare_with_picture(self.what, boxes, self.size)
