"""What detectors of others give, layout by layout: from the outputs for one picture to boxes and scores of people.

Each reader takes the outputs without their batch axis, the size of the network's input and the class of people. It
gives boxes ``(N, 4)`` x1, y1, x2, y2 in pixels of the input and scores ``(N,)`` in [0, 1], not suppressed unless the
network did so itself. Turned boxes are ``(N, 5)``: centre, width, height, pixels, and radians clockwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.foreign_options import (
    BYTES_MEAN,
    BYTES_STD,
    IMAGENET,
    ImageInput,
    LayoutName,
    ScoreKind,
)
from tsuiseki.tracking.types import FloatArray

STRIDES, MORE_STRIDES = (8, 16, 32), (8, 16, 32, 64)
# Steps from which NanoDet and NanoDet-g take the mean distance to a side, and the strides of FastestDet.
NANODET_BINS, NANODET_G_BINS, ONE_STRIDE = 8, 11, (16,)
Size: TypeAlias = tuple[int, int]
Outputs: TypeAlias = Sequence[NDArray[Any]]
Boxes: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class DetectorLayout:
    """One way in which detectors are exported.

    Attributes:
        description: the outputs in words, for messages.
        read: see the module.
        values: the class values in the outputs ``(N, C)``, a view; None where there is one class a box.
        input: what the family wants its pictures to be, unless the user says otherwise.
        suppressed: the network itself drops doubles.
        outputs: how many there are.
        paired: boxes are one output and class values the other.
        objectness: columns of ``values`` before the first class.
        first_class: number of the first class that has a name.
    """

    description: str
    read: Callable[[Outputs, Size, int], Boxes]
    values: Callable[[Outputs], NDArray[Any]] | None
    input: ImageInput
    suppressed: bool = False
    outputs: int = 1
    paired: bool = False
    objectness: int = 0
    first_class: int = 0

    def classes(self, outputs: Outputs) -> int | None:
        """How many the outputs tell, or None where they do not."""
        return None if self.values is None else self.values(outputs).shape[1] - self.objectness


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


def read_suppressed(outputs: Outputs, size: Size, person: int, columns: tuple[int, int, int]) -> Boxes:
    """``(N, K)``: corners in pixels from the first of ``columns`` on, score and class in the others."""
    del size
    rows, (box, score, label) = outputs[0].astype(np.float64), columns
    rows = rows[(np.round(rows[:, label]) == person) & (rows[:, score] > 0)]
    return rows[:, box : box + 4], rows[:, score]


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


def read_mmdeploy(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 5)`` corners in pixels and score, and ``(N,)`` classes."""
    return read_torchvision([outputs[0][:, :4], outputs[1], outputs[0][:, 4]], size, person)


def read_counted(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 4)`` corners in pixels, ``(N,)`` classes, ``(N,)`` scores, and how many of the rows are filled."""
    del size
    boxes, labels, scores, count = outputs
    chosen = np.flatnonzero(np.round(labels.reshape(-1)[: int(count.reshape(-1)[0])]) == person)
    return boxes.astype(np.float64)[chosen], scores.astype(np.float64).reshape(-1)[chosen]


def read_tensorflow(outputs: Outputs, size: Size, person: int) -> Boxes:
    """As `read_counted`, with corners y1, x1, y2, x2 as shares."""
    boxes, scores = read_counted(outputs, size, person)
    return boxes[:, [1, 0, 3, 2]] * _sides(size), scores


def read_pixel_corners(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 4)`` corners in pixels, and ``(N, C)`` probabilities of the classes."""
    del size
    boxes, classes = paired(outputs)
    return boxes.astype(np.float64), classes[:, person].astype(np.float64)


def read_nanodet(outputs: Outputs, size: Size, person: int, bins: int = NANODET_BINS) -> Boxes:
    """``(N, C + 4 bins)``: a score a class, then logits of the distance, in strides, from the cell to each side.

    Scores and logits may be outputs of their own, and those of each stride, too: see `nanodet_rows`.

    Distances count from the middle of a cell with three strides, and with four, as in NanoDet-Plus, from its corner.
    """
    rows = nanodet_rows(outputs, bins).astype(np.float64)
    cells, strides = grid(size, len(rows))
    middles = (cells + (0.5 if strides.max() == STRIDES[-1] else 0)) * strides
    steps = as_probabilities(rows[:, -4 * bins :].reshape(-1, bins), "softmax") @ np.arange(bins)
    sides = steps.reshape(-1, 4) * strides
    return np.concatenate([middles - sides[:, :2], middles + sides[:, 2:]], axis=1), rows[:, person]


def nanodet_rows(outputs: Outputs, bins: int = NANODET_BINS) -> NDArray[Any]:
    """One output; or of several, which are scores ``(N, C)`` or logits ``(N, 4 bins)`` of a stride, all as one."""
    if len(outputs) == 1:
        return outputs[0]
    finest_first = sorted(outputs, key=lambda x: (-len(x), x.shape[1] == 4 * bins))
    return np.concatenate([np.concatenate(finest_first[k::2]) for k in (0, 1)], axis=1)


def read_fastestdet(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 5 + C)`` or a map ``(5 + C, H, W)``: chance of any object, place in the cell, sides, that of each class."""
    rows = fastestdet_rows(outputs[0]).astype(np.float64)
    cells, strides = grid(size, len(rows))
    centres = (cells + np.tanh(rows[:, 1:3])) * strides
    sides = as_probabilities(rows[:, 3:5], "sigmoid") * _sides(size)[:2]
    return _corners(np.concatenate([centres, sides], axis=1)), rows[:, 0] * rows[:, 5 + person]


def fastestdet_rows(output: NDArray[Any]) -> NDArray[Any]:
    """A row a cell, of a map, too."""
    return output.reshape(len(output), -1).T if output.ndim == 3 else output


def read_obb(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(5 + C, N)``: centres and sides in pixels, a score a class, radians clockwise."""
    del size
    rows = outputs[0].astype(np.float64).T
    return rows[:, [0, 1, 2, 3, -1]], rows[:, 4 + person]


def read_obb_suppressed(outputs: Outputs, size: Size, person: int) -> Boxes:
    """``(N, 7)``: centres and sides in pixels, score, class, radians clockwise; rows of zeros fill up."""
    del size
    rows = outputs[0].astype(np.float64)
    rows = rows[(np.round(rows[:, 5]) == person) & (rows[:, 4] > 0)]
    return rows[:, [0, 1, 2, 3, 6]], rows[:, 4]


def grid(size: Size, count: int) -> tuple[FloatArray, FloatArray]:
    """Columns and rows ``(N, 2)`` of the cells of all strides, and the strides ``(N, 1)``, finest first."""
    strides = next((s for s in (STRIDES, MORE_STRIDES, ONE_STRIDE) if cell_count(size, s) == count), None)
    if strides is None:
        raise ValueError(f"expected {cell_count(size)} cells for an input of {size[1]}x{size[0]}, got {count}")
    cells, scale = [], []
    for stride in strides:
        rows, columns = np.mgrid[0 : -(-size[0] // stride), 0 : -(-size[1] // stride)]
        cells.append(np.stack([columns.ravel(), rows.ravel()], axis=1))
        scale.append(np.full((rows.size, 1), stride))
    return np.concatenate(cells).astype(np.float64), np.concatenate(scale).astype(np.float64)


def cell_count(size: Size, strides: Sequence[int] = STRIDES) -> int:
    """Cells of the maps of all ``strides`` over an input of ``size``.

    >>> cell_count((640, 640))
    8400
    """
    return sum(-(-size[0] // s) * -(-size[1] // s) for s in strides)


def paired(outputs: Outputs) -> tuple[NDArray[Any], NDArray[Any]]:
    """Boxes and classes of two outputs, a row a box; boxes have four columns, or stand first where both have."""
    first, second = outputs
    boxes, classes = (second, first) if first.shape[-1] != 4 else (first, second)
    return boxes, classes if len(classes) == len(boxes) else classes.T


def with_probabilities(layout: DetectorLayout, outputs: Outputs, kind: ScoreKind | None) -> Outputs:
    """The outputs with probabilities instead of class values; as they are where that is what they hold."""
    if kind in (None, "probabilities") or layout.values is None:
        return outputs
    copies = [x.astype(np.float64) for x in outputs]
    values = layout.values(copies)
    values[...] = as_probabilities(values, kind)
    return copies


def labelled(outputs: Outputs) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Boxes, classes and scores of three outputs: the one of four columns, the one of integers, the other."""
    boxes = next(x for x in outputs if x.ndim == 2 and x.shape[-1] == 4)
    labels = next(x for x in outputs if np.issubdtype(x.dtype, np.integer))
    return boxes, labels, next(x for x in outputs if x is not boxes and x is not labels)


def _corners(rows: FloatArray) -> FloatArray:
    return np.concatenate([rows[:, :2] - rows[:, 2:] / 2, rows[:, :2] + rows[:, 2:] / 2], axis=1)


def _sides(size: Size) -> FloatArray:
    return np.array([size[1], size[0]] * 2, dtype=np.float64)


def _columns(outputs: Outputs) -> NDArray[Any]:
    return outputs[0][:, 4:]


def _classes(outputs: Outputs) -> NDArray[Any]:
    return paired(outputs)[1]


_YOLO = ImageInput()
_YOLOX = ImageInput(colour="BGR", pixels="bytes")
_PLAIN = ImageInput("stretch")
_NANODET = ImageInput("stretch", "BGR", "bytes", BYTES_MEAN, BYTES_STD)
_Row = partial(DetectorLayout, values=_columns)
_Suppressed = partial(DetectorLayout, values=None, suppressed=True)
_Pair = partial(DetectorLayout, values=_classes, outputs=2, paired=True)
LAYOUTS: Mapping[LayoutName, DetectorLayout] = {
    "yolov8": DetectorLayout("(1, 4+C, N)", read_yolov8, lambda o: o[0][4:].T, _YOLO),
    "yolov8-rows": _Row("(1, N, 4+C), a box a cell, in pixels", read_yolov8_rows, input=_YOLO),
    "yolov5": _Row("(1, N, 5+C), three boxes a cell", read_yolov5, input=_YOLO, objectness=1),
    "yolov6": _Row("(1, N, 5+C), a box a cell, in pixels, column 5 all ones", read_yolov5, input=_YOLO, objectness=1),
    "yolox": _Row("(1, N, 5+C), a box a cell, in strides", read_yolox, input=_YOLOX, objectness=1),
    "yolox-decoded": _Row("(1, N, 5+C), a box a cell, in pixels", read_yolov5, input=_YOLOX, objectness=1),
    "yolo-suppressed": _Suppressed(
        "(1, N, 6) corners in pixels, score, class", partial(read_suppressed, columns=(0, 4, 5)), input=_YOLO
    ),
    "rtdetr-joined": _Row("(1, N, 4+C) centres as shares, scores", read_rtdetr_joined, input=_PLAIN),
    "detr": _Pair("(1, N, 4) centres as shares, (1, N, C) classes", read_detr, input=IMAGENET),
    "corners": _Pair("(1, N, 4) corners as shares, (1, N, C) classes", read_corners, input=IMAGENET),
    "torchvision": _Suppressed(
        "boxes (N, 4) in pixels, labels (N,), scores (N,)", read_torchvision, input=_PLAIN, outputs=3
    ),
    "tensorflow": _Suppressed(
        "detection_boxes (1, N, 4) y before x as shares, detection_classes, detection_scores, num_detections",
        read_tensorflow,
        input=ImageInput("stretch", pixels="bytes", raw_nhwc=True),
        outputs=4,
        first_class=1,
    ),
    "mmdeploy": _Suppressed(
        "dets (1, N, 5) corners in pixels and score, labels (1, N)",
        read_mmdeploy,
        input=replace(_NANODET, resize="letterbox"),
        outputs=2,
    ),
    "tensorrt": _Suppressed(
        "num_dets (1, 1), boxes (1, N, 4) corners in pixels, scores (1, N), classes (1, N)",
        read_counted,
        input=_YOLO,
        outputs=4,
    ),
    "yolov7": _Suppressed(
        "(N, 7) picture, corners in pixels, class, score", partial(read_suppressed, columns=(1, 6, 5)), input=_YOLO
    ),
    "yolo-nas": _Pair("(1, N, 4) corners in pixels, (1, N, C) classes", read_pixel_corners, input=_YOLO),
    "yolo-nas-rows": _Suppressed(
        "(N, 7) picture, corners in pixels, score, class", partial(read_suppressed, columns=(1, 5, 6)), input=_YOLO
    ),
    "paddle": _Suppressed(
        "(N, 6) class, score, corners in pixels", partial(read_suppressed, columns=(2, 1, 0)), input=_PLAIN
    ),
    "nanodet": DetectorLayout(
        "(1, N, C+32) scores, then logits of distances",
        read_nanodet,
        lambda o: nanodet_rows(o)[:, : -4 * NANODET_BINS],
        _NANODET,
    ),
    "nanodet-g": DetectorLayout(
        "(1, N, C+44) scores, then logits of distances",
        partial(read_nanodet, bins=NANODET_G_BINS),
        lambda o: nanodet_rows(o, NANODET_G_BINS)[:, : -4 * NANODET_G_BINS],
        replace(_NANODET, resize="letterbox", fill=0),
    ),
    "fastestdet": DetectorLayout(
        "(1, 5+C, H, W) or (N, 5+C), a box a cell of 16 pixels",
        read_fastestdet,
        lambda o: fastestdet_rows(o[0])[:, 5:],
        replace(_PLAIN, colour="BGR"),
    ),
    "obb": DetectorLayout("(1, 5+C, N), angles last", read_obb, lambda o: o[0][4:-1].T, _YOLO),
    "obb-suppressed": _Suppressed(
        "(1, N, 7) centres and sides in pixels, score, class, angle", read_obb_suppressed, input=_YOLO
    ),
}
TURNED: tuple[LayoutName, ...] = ("obb", "obb-suppressed")
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
