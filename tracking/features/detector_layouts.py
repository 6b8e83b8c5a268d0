"""What detectors of others give, layout by layout: from the outputs for one picture to boxes and scores of a class.

Outputs are without their batch axis. Boxes are ``(N, 4)`` x1, y1, x2, y2 in pixels of the input, scores ``(N,)`` in
[0, 1]. Turned boxes are ``(N, 5)``: centre, width, height, pixels, and radians clockwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.anchored_layouts import blazepose_boxes, ssd_boxes
from tsuiseki.tracking.features.foreign_options import (
    BYTES_MEAN,
    BYTES_STD,
    IMAGENET,
    ImageInput,
    LayoutName,
    ScoreKind,
)
from tsuiseki.tracking.types import FloatArray

# Strides of most families, pixels of the input.
STRIDES = (8, 16, 32)
# Strides of NanoDet-Plus and of P6 networks, pixels of the input.
MORE_STRIDES = (8, 16, 32, 64)
# Strides of all families with maps of several, those of P2 networks with a finer one, pixels of the input.
STRIDE_SETS = (
    STRIDES,
    MORE_STRIDES,
    (8, 16, 32, 64, 128),
    (4, 8, 16, 32),
    (4, 8, 16, 32, 64),
    (4, 8, 16),
    (8, 16),
    (16, 32),
)
# The stride of FastestDet, pixels of the input.
ONE_STRIDE = (16,)
# Steps from which NanoDet takes the mean distance to a side.
NANODET_BINS = 8
# The same of NanoDet-g.
NANODET_G_BINS = 11
Size: TypeAlias = tuple[int, int]
Outputs: TypeAlias = Sequence[NDArray[Any]]
Rows: TypeAlias = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]


@dataclass(frozen=True)
class DetectorLayout:
    """One way in which detectors are exported: with a value for every class of a box, or with the class of each box.

    Attributes:
        description: the outputs in words, for messages.
        input: what the family wants its pictures to be, unless the user says otherwise.
        boxes: by the outputs and the height and width of the input; not suppressed.
        values: the class values in the outputs ``(N, C)``, a view; None where there is one class a box.
        rows: boxes, scores and classes, where there is one class a box; the network itself drops doubles then.
        outputs: how many there are.
        paired: boxes are one output and class values the other.
        objectness: columns of ``values`` before the first class, the chance of any object.
        first_class: number of the first class that has a name.
    """

    description: str
    input: ImageInput
    boxes: Callable[[Outputs, Size], FloatArray] | None = None
    values: Callable[[Outputs], NDArray[Any]] | None = None
    rows: Callable[[Outputs, Size], Rows] | None = None
    outputs: int = 1
    paired: bool = False
    objectness: int = 0
    first_class: int = 0

    @property
    def suppressed(self) -> bool:
        """Whether the network itself drops doubles."""
        return self.rows is not None

    def classes(self, outputs: Outputs) -> int | None:
        """How many the outputs tell, or None where they do not."""
        return None if self.values is None else self.values(outputs).shape[1] - self.objectness

    def read(self, outputs: Outputs, size: Size, number: int) -> tuple[FloatArray, FloatArray]:
        """Boxes and scores of a class, by its number."""
        if self.rows is not None:
            boxes, scores, classes = self.rows(outputs, size)
            chosen = np.round(classes.reshape(-1)) == number
            return boxes.astype(np.float64)[chosen], scores.reshape(-1).astype(np.float64)[chosen]
        assert self.boxes is not None
        assert self.values is not None
        outputs = [x.astype(np.float64) for x in outputs]
        values = self.values(outputs)
        scores = values[:, self.objectness + number]
        return self.boxes(outputs, size), scores * values[:, 0] if self.objectness else scores


def _middles(outputs: Outputs, _: Size) -> FloatArray:
    """``(N, 4 + …)`` centres and sides in pixels."""
    return _corners(outputs[0][:, :4])


def _middle_shares(outputs: Outputs, size: Size) -> FloatArray:
    """The same as shares of the input, in rows with the scores or as an output of their own."""
    return _corners((outputs[0] if len(outputs) == 1 else paired(outputs)[0])[:, :4] * _sides(size))


def _yolox(outputs: Outputs, size: Size) -> FloatArray:
    """Centres counted from their cells in strides, and sides as logarithms of strides."""
    cells, strides = grid(size, len(outputs[0]))
    sides = np.exp(np.minimum(outputs[0][:, 2:4], 12))
    return _corners(np.concatenate([(outputs[0][:, :2] + cells) * strides, sides * strides], axis=1))


def _nanodet(outputs: Outputs, size: Size, bins: int) -> FloatArray:
    """Logits of the distance, in strides, from the cell to each side.

    Distances count from the middle of a cell with three strides, and with four, as in NanoDet-Plus, from its corner.
    """
    rows = nanodet_rows(outputs, bins)
    cells, strides = grid(size, len(rows))
    middles = (cells + (0.5 if strides.max() == STRIDES[-1] else 0)) * strides
    steps = as_probabilities(rows[:, -4 * bins :].reshape(-1, bins), "softmax") @ np.arange(bins)
    sides = steps.reshape(-1, 4) * strides
    return np.concatenate([middles - sides[:, :2], middles + sides[:, 2:]], axis=1)


def nanodet_rows(outputs: Outputs, bins: int) -> NDArray[Any]:
    """One output; or of several, which are scores ``(N, C)`` or logits ``(N, 4 bins)`` of a stride, all as one."""
    if len(outputs) == 1:
        return outputs[0]
    finest_first = sorted(outputs, key=lambda x: (-len(x), x.shape[1] == 4 * bins))
    return np.concatenate([np.concatenate(finest_first[k::2]) for k in (0, 1)], axis=1)


def _fastestdet(outputs: Outputs, size: Size) -> FloatArray:
    """Chance of any object, place in the cell, sides, then the chance of each class."""
    rows = fastestdet_rows(outputs[0])
    cells, strides = grid(size, len(rows))
    sides = as_probabilities(rows[:, 3:5], "sigmoid") * _sides(size)[:2]
    return _corners(np.concatenate([(cells + np.tanh(rows[:, 1:3])) * strides, sides], axis=1))


def fastestdet_rows(output: NDArray[Any]) -> NDArray[Any]:
    """A row a cell, of a map, too."""
    return output.reshape(len(output), -1).T if output.ndim == 3 else output


def _in_columns(outputs: Outputs, _: Size, box: Sequence[int] | slice, score: int, label: int) -> Rows:
    """Rows that hold their box, score and class in these columns; rows of zeros fill up."""
    return outputs[0][:, box], outputs[0][:, score], outputs[0][:, label]


def _torchvision(outputs: Outputs, _: Size) -> Rows:
    """Three outputs in any order: the one of four columns, the one of integers, the other."""
    boxes = next(x for x in outputs if x.ndim == 2 and x.shape[-1] == 4)
    labels = next(x for x in outputs if np.issubdtype(x.dtype, np.integer))
    return boxes, next(x for x in outputs if x is not boxes and x is not labels), labels


def _counted(outputs: Outputs, _: Size) -> Rows:
    """Boxes, classes, scores, and how many of the rows are filled."""
    boxes, labels, scores, count = outputs
    filled = int(count.reshape(-1)[0])
    return boxes[:filled], scores.reshape(-1)[:filled], labels.reshape(-1)[:filled]


def _tensorflow(outputs: Outputs, size: Size) -> Rows:
    """As `_counted`, with corners y1, x1, y2, x2 as shares."""
    boxes, scores, labels = _counted(outputs, size)
    return boxes.astype(np.float64)[:, [1, 0, 3, 2]] * _sides(size), scores, labels


def _openvino(outputs: Outputs, size: Size) -> Rows:
    """Picture, class, score, corners as shares; a picture below 0 ends the rows."""
    rows = outputs[0].reshape(-1, 7).astype(np.float64)
    rows = rows[: int(np.argmax(rows[:, 0] < 0)) if (rows[:, 0] < 0).any() else None]
    return rows[:, 3:] * _sides(size), rows[:, 2], rows[:, 1]


def grid(size: Size, count: int) -> tuple[FloatArray, FloatArray]:
    """Columns and rows ``(N, 2)`` of the cells of all strides, and the strides ``(N, 1)``, finest first."""
    strides = next((s for s in (*STRIDE_SETS, ONE_STRIDE) if cell_count(size, s) == count), None)
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


def _corners(rows: FloatArray) -> FloatArray:
    return np.concatenate([rows[:, :2] - rows[:, 2:] / 2, rows[:, :2] + rows[:, 2:] / 2], axis=1)


def _sides(size: Size) -> FloatArray:
    return np.array([size[1], size[0]] * 2, dtype=np.float64)


_YOLO = ImageInput()
_YOLOX = ImageInput(colour="BGR", pixels="bytes")
_PLAIN = ImageInput("stretch")
_NANODET = ImageInput("stretch", "BGR", "bytes", BYTES_MEAN, BYTES_STD)
# Pictures in [-1, 1], as networks of TensorFlow take them.
_SYMMETRIC = ImageInput("stretch", mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5))
_Row = partial(DetectorLayout, values=lambda outputs: outputs[0][:, 4:])
_Pair = partial(DetectorLayout, values=lambda outputs: paired(outputs)[1], outputs=2, paired=True)
_OBJECT = "(1, N, 5+C), "
_SEVEN = "(N, 7) picture, corners in pixels, class, score"
# All that are recognised; numbers are columns of the outputs.
LAYOUTS: Mapping[LayoutName, DetectorLayout] = {
    "yolov8": DetectorLayout("(1, 4+C, N)", _YOLO, lambda o, size: _middles([o[0].T], size), lambda o: o[0][4:].T),
    "yolov8-rows": _Row("(1, N, 4+C), a box a cell, in pixels", _YOLO, _middles),
    "yolov5": _Row(_OBJECT + "three boxes a cell", _YOLO, _middles, objectness=1),
    "yolov6": _Row(_OBJECT + "a box a cell, in pixels, column 5 all ones", _YOLO, _middles, objectness=1),
    "yolox": _Row(_OBJECT + "a box a cell, in strides", _YOLOX, _yolox, objectness=1),
    "yolox-decoded": _Row(_OBJECT + "a box a cell, in pixels", _YOLOX, _middles, objectness=1),
    "yolo-suppressed": DetectorLayout(
        "(1, N, 6) corners in pixels, score, class", _YOLO, rows=partial(_in_columns, box=slice(4), score=4, label=5)
    ),
    "rtdetr-joined": _Row("(1, N, 4+C) centres as shares, scores", _PLAIN, _middle_shares),
    "detr": _Pair("(1, N, 4) centres as shares, (1, N, C) classes", IMAGENET, _middle_shares),
    "corners": _Pair(
        "(1, N, 4) corners as shares, (1, N, C) classes", IMAGENET, lambda o, size: paired(o)[0] * _sides(size)
    ),
    "torchvision": DetectorLayout(
        "boxes (N, 4) in pixels, labels (N,), scores (N,)", _PLAIN, rows=_torchvision, outputs=3
    ),
    "tensorflow": DetectorLayout(
        "detection_boxes (1, N, 4) y before x as shares, detection_classes, detection_scores, num_detections",
        ImageInput("stretch", pixels="bytes", raw_nhwc=True),
        rows=_tensorflow,
        outputs=4,
        first_class=1,
    ),
    "mmdeploy": DetectorLayout(
        "dets (1, N, 5) corners in pixels and score, labels (1, N)",
        replace(_NANODET, resize="letterbox"),
        rows=lambda o, _: (o[0][:, :4], o[0][:, 4], o[1]),
        outputs=2,
    ),
    "tensorrt": DetectorLayout(
        "num_dets (1, 1), boxes (1, N, 4) corners in pixels, scores (1, N), classes (1, N)",
        _YOLO,
        rows=_counted,
        outputs=4,
    ),
    "yolov7": DetectorLayout(_SEVEN, _YOLO, rows=partial(_in_columns, box=slice(1, 5), score=6, label=5)),
    "yolo-nas": _Pair("(1, N, 4) corners in pixels, (1, N, C) classes", _YOLO, lambda o, _: paired(o)[0]),
    "yolo-nas-rows": DetectorLayout(_SEVEN, _YOLO, rows=partial(_in_columns, box=slice(1, 5), score=5, label=6)),
    "paddle": DetectorLayout(
        "(N, 6) class, score, corners in pixels", _PLAIN, rows=partial(_in_columns, box=slice(2, 6), score=1, label=0)
    ),
    "nanodet": DetectorLayout(
        "(1, N, C+32) scores, then logits of distances",
        _NANODET,
        partial(_nanodet, bins=NANODET_BINS),
        lambda o: nanodet_rows(o, NANODET_BINS)[:, : -4 * NANODET_BINS],
    ),
    "nanodet-g": DetectorLayout(
        "(1, N, C+44) scores, then logits of distances",
        replace(_NANODET, resize="letterbox", fill=0),
        partial(_nanodet, bins=NANODET_G_BINS),
        lambda o: nanodet_rows(o, NANODET_G_BINS)[:, : -4 * NANODET_G_BINS],
    ),
    "fastestdet": DetectorLayout(
        "(1, 5+C, H, W) or (N, 5+C), a box a cell of 16 pixels",
        replace(_PLAIN, colour="BGR"),
        _fastestdet,
        lambda o: np.delete(fastestdet_rows(o[0]), slice(1, 5), axis=1),
        objectness=1,
    ),
    "ssd": _Pair(
        "(1, N, 4) codes y before x beside N anchors, (1, N, C) classes", _SYMMETRIC, lambda o, s: ssd_boxes(o[0], *s)
    ),
    "blazepose": DetectorLayout(
        "(1, N, 12) codes of a face and four points, (1, N, 1) scores",
        replace(_SYMMETRIC, resize="letterbox", fill=0),
        lambda o, size: blazepose_boxes(o[0], *size),
        lambda o: o[1],
        outputs=2,
        paired=True,
    ),
    "openvino": DetectorLayout(
        "(1, 1, N, 7) picture, class, score, corners as shares",
        ImageInput("stretch", "BGR", "bytes"),
        rows=_openvino,
    ),
    "obb": DetectorLayout(
        "(1, 5+C, N), angles last", _YOLO, lambda o, _: o[0].T[:, [0, 1, 2, 3, -1]], lambda o: o[0][4:-1].T
    ),
    "obb-suppressed": DetectorLayout(
        "(1, N, 7) centres and sides in pixels, score, class, angle",
        _YOLO,
        rows=partial(_in_columns, box=[0, 1, 2, 3, 6], score=4, label=5),
    ),
}
TURNED: tuple[LayoutName, ...] = ("obb", "obb-suppressed")
# What the Object Detection API of TensorFlow calls its outputs, in the order in which `_tensorflow` takes them.
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
