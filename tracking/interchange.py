"""What people have their detections in, turned into `Detections`.

Understood are arrays ``(N, 4)`` of boxes, ``(N, 5)`` with a score and ``(N, 6)`` with a score and a class, nested
sequences of the same, objects with ``xyxy`` and ``confidence`` (supervision) or ``conf`` (ultralytics, whose results
hold them under ``boxes`` or ``obb``), and dictionaries with ``boxes`` and ``scores`` (torchvision). Tensors of any
library that NumPy can read are arrays here, and an empty array of any shape is no detection. Boxes are ``x1, y1, x2,
y2`` in pixels. What has no score gets 1. Classes, and names of them where objects have some, stay with their boxes.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from numbers import Number
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.types import Detections, FloatArray, IntArray


class BoxesWithConfidence(Protocol):
    """Boxes as supervision and others hold them."""

    @property
    def xyxy(self) -> Any:
        """``(N, 4)`` pixels."""

    @property
    def confidence(self) -> Any:
        """``(N,)`` scores, or None."""


DetectionsLike: TypeAlias = Detections | BoxesWithConfidence | Mapping[str, Any] | ArrayLike

# Bad boxes of a video that may be all it has so far.
FEWEST_BAD = 5

EXPECTED = (
    "expected detections as an array (N, 4), (N, 5) or (N, 6) of x1, y1, x2, y2, score, class, as an object with xyxy "
    "and confidence, or as a dictionary with boxes and scores"
)


def as_detections(
    detections: DetectionsLike | Any, classes: Collection[int] | None = None, counted: BadBoxes | None = None
) -> Detections:
    """``detections`` as `Detections`.

    Args:
        detections: see the module.
        classes: keep detections of these classes only; by default all.
        counted: over the frames of a video, the boxes that are none: those are left out, which is reported once, as
            long as most of all are good. Without it those of this frame count.

    Raises:
        RequestError: it is nothing that the module names, most boxes have no area or are not finite, scores and boxes
            differ in number, or ``classes`` are asked for and there are none.

    >>> as_detections([[10, 20, 30, 80, 0.9]]).scores
    array([0.9])
    >>> len(as_detections([]))
    0
    """
    if not isinstance(detections, Detections):
        boxes, scores, labels = _parts(detections)
        numbers = None if labels is None else np.nan_to_num(labels, nan=-1).astype(np.int64)
        detections = _checked(boxes, scores, numbers, _names(detections), counted)
    if classes is None or not len(detections):
        return detections
    if detections.classes is None:
        raise RequestError("expected detections that have classes, got none; leave the argument classes out")
    return detections.select(np.isin(detections.classes, list(classes)))


def _names(detections: Any) -> dict[int, str]:
    """Names of classes by number, where results of Ultralytics (all) or supervision (of the boxes there) tell them."""
    detections = detections[0] if isinstance(detections, list | tuple) and len(detections) == 1 else detections
    names = getattr(detections, "names", None)
    if isinstance(names, Mapping):
        return {int(number): str(name) for number, name in names.items()}
    data, numbers = getattr(detections, "data", None), getattr(detections, "class_id", None)
    if isinstance(data, Mapping) and "class_name" in data and numbers is not None:
        return {int(number): str(name) for number, name in zip(numbers, data["class_name"], strict=True)}
    return {}


def _parts(detections: Any) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Boxes ``(N, 4)``, scores ``(N,)`` and, where they are known, classes ``(N,)``."""
    detections = _unwrapped(detections)
    if isinstance(detections, Mapping):
        if "boxes" not in detections:
            raise RequestError(f"{EXPECTED}; got a dictionary with {', '.join(map(str, detections)) or 'nothing'}")
        return _of_columns(detections["boxes"], detections.get("scores"), detections.get("labels"))
    if hasattr(detections, "xyxy"):
        scores = getattr(detections, "confidence", getattr(detections, "conf", None))
        return _of_columns(detections.xyxy, scores, getattr(detections, "class_id", getattr(detections, "cls", None)))
    table = _array(detections)
    if table.size == 0:
        return np.empty((0, 4)), np.empty(0), np.empty(0)
    if table.ndim != 2 or table.shape[1] not in (4, 5, 6):
        raise RequestError(f"{EXPECTED}; got an array of shape {table.shape}")
    scores = table[:, 4] if table.shape[1] > 4 else np.ones(len(table))
    return table[:, :4], scores, table[:, 5] if table.shape[1] == 6 else None


def _unwrapped(detections: Any) -> Any:
    """What holds the boxes, where it came in a list of one image or in a result that has more."""
    if isinstance(detections, Sequence) and len(detections) == 1 and not isinstance(detections, str | bytes):
        (inside,) = detections
        if isinstance(inside, Mapping | Detections) or hasattr(inside, "xyxy") or hasattr(inside, "boxes"):
            detections = inside
    boxes = None if isinstance(detections, Mapping) else getattr(detections, "boxes", None)
    # Results of turned boxes hold them, and the upright boxes about them, under another name.
    boxes = getattr(detections, "obb", None) if boxes is None else boxes
    if boxes is None or hasattr(detections, "xyxy"):
        return detections
    return boxes if hasattr(boxes, "xyxy") else {"boxes": boxes, "scores": getattr(detections, "scores", None)}


def _of_columns(boxes: Any, scores: Any, labels: Any) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    rows = _array(boxes)
    if rows.size == 0:
        return np.empty((0, 4)), np.empty(0), np.empty(0)
    if rows.ndim != 2 or rows.shape[1] != 4:
        raise RequestError(f"expected boxes of shape (N, 4), got {rows.shape}")
    columns = [np.ones(len(rows)) if scores is None else _array(scores).reshape(-1)]
    columns += [] if labels is None else [_array(labels).reshape(-1)]
    for name, column in zip(("scores", "classes"), columns, strict=False):
        if len(column) != len(rows):
            raise RequestError(f"expected {len(rows)} {name}, one a box, got {len(column)}")
    return rows, columns[0], None if labels is None else columns[1]


def _array(values: Any) -> FloatArray:
    """``values`` as numbers; tensors that need gradients or lie on an accelerator come to this memory."""
    for step in ("detach", "cpu", "numpy"):
        values = getattr(values, step)() if hasattr(values, step) else values
    if values is None:
        raise RequestError(f"{EXPECTED}; got None")
    if _holds_numbers(values):
        try:
            return np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError):
            pass
    name = type(values).__name__
    if isinstance(values, list | tuple) and values and hasattr(values[0], "boxes"):
        name = f"the results of {len(values)} images; give those of an image at a time"
    raise RequestError(f"{EXPECTED}; got {name}")


def _holds_numbers(values: Any) -> bool:
    """Whether NumPy can read it: results of Ultralytics hold results by index, without an end, until memory is full."""
    if isinstance(values, Sequence) and not isinstance(values, str | bytes):
        return all(map(_holds_numbers, values))
    return hasattr(values, "__array__") or isinstance(values, Number | str | bytes)


@dataclass
class BadBoxes:
    """Counts the boxes of a video, and the bad ones: without an area, not finite, or of an infinite score."""

    total: int = 0
    bad: int = 0


def _checked(
    boxes: FloatArray, scores: FloatArray, classes: IntArray | None, names: dict[int, str], counted: BadBoxes | None
) -> Detections:
    bad = ~np.isfinite(boxes).all(axis=1) | (boxes[:, 2:] <= boxes[:, :2]).any(axis=1) | np.isinf(scores)
    if not bad.any():
        if counted is not None:
            counted.total += len(bad)
        return Detections(boxes, scores, classes=classes, names=names)
    row, alone, counted = int(bad.argmax()), counted is None, counted or BadBoxes()
    doubtful, fewest = counted.bad > 0, 1 if alone else FEWEST_BAD
    counted.total, counted.bad = counted.total + len(bad), counted.bad + int(bad.sum())
    if counted.bad >= fewest and 2 * counted.bad > counted.total:
        numbers = ", ".join(f"{value:g}" for value in boxes[row])
        raise RequestError(
            f"expected finite boxes x1, y1, x2, y2 with x1 < x2 and y1 < y2, got {numbers} in row {row}; "
            "are they x, y, width, height?"
        )
    if not doubtful:
        numbers = ", ".join(f"{value:g}" for value in (*boxes[row], scores[row]))
        warnings.warn(
            f"a box without an area, or not finite, is left out: {numbers}; so are more of them. Expected x1, y1, x2, "
            "y2, not x, y, width, height",
            InputWarning,
            stacklevel=3,
        )
    rows = np.flatnonzero(~bad)
    labels = None if classes is None else classes[rows]
    return Detections(boxes[rows], scores[rows], classes=labels, sources=rows, names=names)
