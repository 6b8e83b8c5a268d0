"""What detectors of others give, layout by layout: from the outputs for one picture to boxes and scores of people.

Each reader takes the outputs without their batch axis, the size of the network's input and the class of people. It
gives boxes ``(N, 4)`` x1, y1, x2, y2 in pixels of the input and scores ``(N,)`` in [0, 1], not suppressed unless the
network did so itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.foreign_options import IMAGENET, ImageInput, LayoutName, ScoreKind
from tsuiseki.tracking.types import FloatArray

STRIDES, MORE_STRIDES = (8, 16, 32), (8, 16, 32, 64)
Size: TypeAlias = tuple[int, int]
Outputs: TypeAlias = Sequence[NDArray[Any]]
Boxes: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class DetectorLayout:
    """One way in which detectors are exported.

    Attributes:
        description: the outputs in words, for messages.
        read: see the module.
        classes: number of classes that the outputs tell, or None where they do not.
        input: what the family wants its pictures to be, unless the user says otherwise.
        suppressed: the network itself drops doubles.
        outputs: how many there are.
        paired: boxes are one output and class values the other, which `with_probabilities` must have been through.
        first_class: number of the first class that has a name.
    """

    description: str
    read: Callable[[Outputs, Size, int], Boxes]
    classes: Callable[[Outputs], int | None]
    input: ImageInput
    suppressed: bool = False
    outputs: int = 1
    paired: bool = False
    first_class: int = 0


def read_yolov8(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(4 + C, N)``: centres and sides in pixels, then a score a class."""
    del size
    rows = outputs[0].astype(np.float64).T
    return _corners(rows[:, :4]), rows[:, 4 + person]


def read_yolov8_rows(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 4 + C)``: as `read_yolov8`, a row a box."""
    return read_yolov8([outputs[0].T], size, person)


def read_yolov5(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 5 + C)``: centres and sides in pixels, the chance of any object, then that of each class given one."""
    del size
    rows = outputs[0].astype(np.float64)
    return _corners(rows[:, :4]), rows[:, 4] * rows[:, 5 + person]


def read_yolox(outputs: Outputs, size: Size, person: int) -> Boxes:
    """As `read_yolov5`, with centres counted from their cells in strides, and sides as logarithms of strides."""
    rows = outputs[0].astype(np.float64)
    cells, strides = grid(size, len(rows))
    decoded = np.concatenate([(rows[:, :2] + cells) * strides, np.exp(np.minimum(rows[:, 2:4], 12)) * strides], axis=1)
    return _corners(decoded), rows[:, 4] * rows[:, 5 + person]


def read_yolo_suppressed(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 6)``: corners in pixels, score, class; rows of zeros fill up."""
    del size
    rows = outputs[0].astype(np.float64)
    rows = rows[(np.round(rows[:, 5]) == person) & (rows[:, 4] > 0)]
    return rows[:, :4], rows[:, 4]


def read_rtdetr_joined(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 4 + C)``: centres and sides as shares of the input, then a score a class."""
    rows = outputs[0].astype(np.float64)
    return _corners(rows[:, :4] * _sides(size)), rows[:, 4 + person]


def read_detr(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 4)`` centres and sides as shares of the input, and ``(N, C)`` probabilities of the classes."""
    boxes, classes = paired(outputs)
    return _corners(boxes.astype(np.float64) * _sides(size)), classes[:, person].astype(np.float64)


def read_corners(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 4)`` corners as shares of the input, and ``(N, C)`` probabilities of the classes."""
    boxes, classes = paired(outputs)
    return boxes.astype(np.float64) * _sides(size), classes[:, person].astype(np.float64)


def read_torchvision(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 4)`` corners in pixels, ``(N,)`` classes and ``(N,)`` scores, in any order."""
    del size
    boxes, labels, scores = labelled(outputs)
    chosen = labels.reshape(-1) == person
    return boxes.astype(np.float64)[chosen], scores.astype(np.float64).reshape(-1)[chosen]


def read_tensorflow(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 4)`` y1, x1, y2, x2 as shares, ``(N,)`` classes, ``(N,)`` scores, and how many of the rows are filled."""
    boxes, labels, scores, count = outputs
    chosen = np.flatnonzero(np.round(labels.reshape(-1)[: int(count.reshape(-1)[0])]) == person)
    shares = boxes.astype(np.float64)[chosen][:, [1, 0, 3, 2]]
    return shares * _sides(size), scores.astype(np.float64).reshape(-1)[chosen]


def grid(size: Size, count: int) -> tuple[FloatArray, FloatArray]:
    """Columns and rows ``(N, 2)`` of the cells of all strides, and the strides ``(N, 1)``, finest first."""
    strides = next((s for s in (STRIDES, MORE_STRIDES) if cell_count(size, s) == count), None)
    if strides is None:
        raise ValueError(f"expected {cell_count(size)} cells for an input of {size[1]}x{size[0]}, got {count}")
    cells, scale = [], []
    for stride in strides:
        rows, columns = np.mgrid[0 : size[0] // stride, 0 : size[1] // stride]
        cells.append(np.stack([columns.ravel(), rows.ravel()], axis=1))
        scale.append(np.full((rows.size, 1), stride))
    return np.concatenate(cells).astype(np.float64), np.concatenate(scale).astype(np.float64)


def cell_count(size: Size, strides: Sequence[int] = STRIDES) -> int:
    """Cells of the maps of all ``strides`` over an input of ``size``.

    >>> cell_count((640, 640))
    8400
    """
    return sum((size[0] // s) * (size[1] // s) for s in strides)


def paired(outputs: Outputs) -> tuple[NDArray[Any], NDArray[Any]]:
    """Boxes and classes of two outputs; boxes are the one with four columns, or the first where both have."""
    first, second = outputs
    return (second, first) if first.shape[-1] != 4 else (first, second)


def with_probabilities(outputs: Outputs, kind: ScoreKind) -> Outputs:
    """Two outputs, boxes first, with probabilities instead of class values."""
    boxes, classes = paired(outputs)
    return boxes, as_probabilities(classes, kind)


def labelled(outputs: Outputs) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Boxes, classes and scores of three outputs: the one of four columns, the one of integers, the other."""
    boxes = next(x for x in outputs if x.ndim == 2 and x.shape[-1] == 4)
    labels = next(x for x in outputs if np.issubdtype(x.dtype, np.integer))
    return boxes, labels, next(x for x in outputs if x is not boxes and x is not labels)


def _corners(rows: FloatArray) -> FloatArray:
    return np.concatenate([rows[:, :2] - rows[:, 2:] / 2, rows[:, :2] + rows[:, 2:] / 2], axis=1)


def _sides(size: Size) -> FloatArray:
    return np.array([size[1], size[0]] * 2, dtype=np.float64)


def _untold(outputs: Outputs) -> None:
    """These outputs do not tell how many classes there are."""
    del outputs


_YOLO = ImageInput()
_PLAIN = ImageInput("stretch")
LAYOUTS: Mapping[LayoutName, DetectorLayout] = {
    "yolov8": DetectorLayout("(1, 4+C, N)", read_yolov8, lambda o: o[0].shape[0] - 4, _YOLO),
    "yolov8-rows": DetectorLayout(
        "(1, N, 4+C), a box a cell, in pixels", read_yolov8_rows, lambda o: o[0].shape[1] - 4, _YOLO
    ),
    "yolov5": DetectorLayout("(1, N, 5+C), three boxes a cell", read_yolov5, lambda o: o[0].shape[1] - 5, _YOLO),
    "yolov6": DetectorLayout(
        "(1, N, 5+C), a box a cell, in pixels, column 5 all ones", read_yolov5, lambda o: o[0].shape[1] - 5, _YOLO
    ),
    "yolox": DetectorLayout(
        "(1, N, 5+C), a box a cell, in strides",
        read_yolox,
        lambda o: o[0].shape[1] - 5,
        replace(_YOLO, colour="BGR", pixels="bytes"),
    ),
    "yolox-decoded": DetectorLayout(
        "(1, N, 5+C), a box a cell, in pixels",
        read_yolov5,
        lambda o: o[0].shape[1] - 5,
        replace(_YOLO, colour="BGR", pixels="bytes"),
    ),
    "yolo-suppressed": DetectorLayout(
        "(1, N, 6) corners in pixels, score, class", read_yolo_suppressed, _untold, _YOLO, suppressed=True
    ),
    "rtdetr-joined": DetectorLayout(
        "(1, N, 4+C) centres as shares, scores", read_rtdetr_joined, lambda o: o[0].shape[1] - 4, _PLAIN
    ),
    "detr": DetectorLayout(
        "(1, N, 4) centres as shares, (1, N, C) classes",
        read_detr,
        lambda o: paired(o)[1].shape[-1],
        IMAGENET,
        outputs=2,
        paired=True,
    ),
    "corners": DetectorLayout(
        "(1, N, 4) corners as shares, (1, N, C) classes",
        read_corners,
        lambda o: paired(o)[1].shape[-1],
        IMAGENET,
        outputs=2,
        paired=True,
    ),
    "torchvision": DetectorLayout(
        "boxes (N, 4) in pixels, labels (N,), scores (N,)",
        read_torchvision,
        _untold,
        _PLAIN,
        suppressed=True,
        outputs=3,
    ),
    "tensorflow": DetectorLayout(
        "detection_boxes (1, N, 4) y before x as shares, detection_classes, detection_scores, num_detections",
        read_tensorflow,
        _untold,
        ImageInput("stretch", pixels="bytes", raw_nhwc=True),
        suppressed=True,
        outputs=4,
        first_class=1,
    ),
}
# What the Object Detection API of TensorFlow calls its outputs, in the order in which `read_tensorflow` takes them.
TENSORFLOW = ("detection_boxes", "detection_classes", "detection_scores", "num_detections")


def as_probabilities(values: NDArray[Any], kind: ScoreKind) -> FloatArray:
    """``(N, C)`` in [0, 1] of ``(N, C)`` class values."""
    real = values.astype(np.float64)
    if kind == "probabilities":
        return real
    if kind == "sigmoid":
        return np.asarray(1 / (1 + np.exp(-np.clip(real, -60, 60))))
    powers = np.exp(real - real.max(axis=1, keepdims=True))
    return np.asarray(powers / powers.sum(axis=1, keepdims=True))
