"""What all labelled boxes are asked: which class counts, and whether they can be pixels of the picture."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.class_choice import PERSON_NAMES, ClassChoice

# What asks for people as every layout counts them.
PEOPLE = "person"


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
