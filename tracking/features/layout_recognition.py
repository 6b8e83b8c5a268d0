"""Which layout, scores and class of people a detector of another project has, from its outputs for a trial picture.

A layout is named only where no other fits: a wrong guess gives boxes at wrong places that look almost right.

The class scores of a transformer are probabilities, or logits of one function or the other. Networks that judge each
class by itself (RT-DETR, RF-DETR, Deformable DETR) give logits of a sigmoid. Those that choose one class (DETR, YOLOS)
give logits of a softmax, in which "no object" is the last class. The shapes are the same. A picture of noise decides,
where nearly all queries should give no object. The class of people follows from the user's number, from the names, or
from the numbers of COCO.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.anchored_layouts import is_blazepose, is_ssd
from tsuiseki.tracking.features.detector_layouts import (
    LAYOUTS,
    MORE_STRIDES,
    NANODET_BINS,
    NANODET_G_BINS,
    ONE_STRIDE,
    STRIDE_SETS,
    STRIDES,
    TENSORFLOW,
    TURNED,
    Outputs,
    Size,
    cell_count,
    fastestdet_rows,
    grid,
    paired,
)
from tsuiseki.tracking.features.foreign_options import LayoutName, ScoreKind
from tsuiseki.tracking.types.class_choice import PERSON_NAMES

# Rows of a detector that drops doubles itself; more are never asked for.
_MOST_ROWS = 1000
# Queries of a transformer; fewer are never made.
_FEWEST_QUERIES = 50
# How far, in strides, the centre of a box may lie from its cell.
_REACH = 4.0
# Share of cells, or of queries in a picture of noise, that count as nearly all.
_NEARLY_ALL = 0.9
# Layouts that differ by one class and by nothing else.
_KNOWN_BY_COUNT = {"yolox", "yolox-decoded", "yolov8-rows", "nanodet", "nanodet-g"}
# Outputs whose names tell what they are, boxes first; others beside them, such as masks, are left aside.
_PAIRS = (("dets", "labels"), ("pred_boxes", "logits"), ("pred_boxes", "pred_logits"))
_DETR_NAMES = [set(pair) for pair in _PAIRS]
# Those of RF-DETR.
RF_DETR = _PAIRS[0]
# What four outputs are, in the order in which `_counted` takes them.
_COUNTED_BY_NAME: Sequence[Callable[[str, NDArray[Any]], bool]] = (
    lambda name, _: "box" in name.lower(),
    lambda name, _: "class" in name.lower() or "label" in name.lower(),
    lambda name, _: "score" in name.lower(),
    lambda name, _: "num" in name.lower(),
)
# The same where names do not tell: boxes, classes, scores, and how many there are.
_COUNTED_BY_SHAPE: Sequence[Callable[[str, NDArray[Any]], bool]] = (
    lambda _, x: x.ndim == 2 and x.shape[1] == 4,
    lambda _, x: x.size > 1 and x.ndim == 1 and np.issubdtype(x.dtype, np.integer),
    lambda _, x: x.size > 1 and x.ndim == 1 and np.issubdtype(x.dtype, np.floating),
    lambda _, x: x.size == 1,
)
_NAMES = """person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, stop sign,
parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, backpack, umbrella, handbag,
tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball bat, baseball glove, skateboard, surfboard,
tennis racket, bottle, wine glass, cup, fork, knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot,
hot dog, pizza, donut, cake, chair, couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote,
keyboard, cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear,
hair drier, toothbrush"""
# Numbers that COCO itself, which counts from 1, leaves out.
_GAPS = {12, 26, 29, 30, 45, 66, 68, 69, 71, 83}
# Where people stand, by how many classes a network tells: 80 without gaps, 90 or 91 with COCO's own numbers.
COCO = {80: 0, 90: 1, 91: 1}
# Numbers of classes of networks that count as COCO itself, with gaps.
COCO_OWN = {90, 91}
# By which a list of COCO's names is known.
COCO_FIRST = ("person", "bicycle", "car")


def coco_names(count: int | None) -> Mapping[int, str]:
    """Names by number for a network of so many classes; none where that is not a number of COCO's.

    >>> coco_names(80)[2], coco_names(91)[3], coco_names(91)[90]
    ('car', 'car', 'toothbrush')
    """
    if count not in COCO:
        return {}
    names = [name.strip() for name in _NAMES.split(",")]
    numbers = [number for number in range(1, 91) if number not in _GAPS]
    return dict(zip(range(80) if count == 80 else numbers, names, strict=True))


def useful_outputs(outputs: Mapping[str, NDArray[Any]]) -> list[str]:
    """The names of the outputs that hold detections, in the order of the readers.

    Left aside are the raw heads that older YOLOs give beside the decoded rows, and what stands beside a known pair.

    Args:
        outputs: by name, for one picture, without the batch axis.
    """
    names, first = list(outputs), next(iter(outputs.values()))
    if pair := next((pair for pair in _PAIRS if set(pair) <= set(names)), None):
        return list(pair)
    for fits in _COUNTED_BY_NAME, _COUNTED_BY_SHAPE:
        counted = [[name for name in names if test(name, outputs[name])] for test in fits]
        if len(names) == len(fits) and [len(matches) for matches in counted] == [1] * len(fits):
            return [name for (name,) in counted]
    heads = [x.ndim == 4 and x.shape[-1] == first.shape[-1] for x in list(outputs.values())[1:]]
    return names[:1] if first.ndim == 2 and heads and all(heads) else names


def possible_layouts(
    outputs: Mapping[str, NDArray[Any]],
    size: Size,
    inputs: Collection[str] = (),
    *,
    turned: bool = False,
    richer: bool = False,
    channels_first: bool = False,
) -> list[LayoutName]:
    """The layouts that ``outputs`` can be; none where they are of no known kind.

    Args:
        outputs: by name, for one picture, without the batch axis; see `useful_outputs`.
        size: height and width of the input.
        inputs: names of the inputs.
        turned: the file says that its boxes are turned.
        richer: it says that the network gives more than boxes.
        channels_first: the pictures are, as TensorRT has them and TensorFlow has not.
    """
    arrays = list(outputs.values())
    if any(not np.isfinite(x).all() for x in arrays if np.issubdtype(x.dtype, np.floating)):
        return []
    if tuple(map(plain_name, outputs)) == TENSORFLOW and not channels_first:
        return ["tensorflow"]
    layouts: list[LayoutName] = []
    if len(arrays) == 1:
        layouts = _single(next(iter(outputs)), arrays[0], size, richer=richer)
    elif len(arrays) == 2:
        layouts = _pair(outputs, size)
    elif len(arrays) == 3 and _is_torchvision(arrays):
        layouts = ["torchvision"]
    elif len(arrays) == 4 and _is_counted(arrays):
        layouts = ["tensorrt"]
    elif len(arrays) in (6, 8) and all(x.ndim == 2 for x in arrays):
        layouts = [name for name, bins in _NANODET.items() if _is_nanodet_apart(arrays, bins, size)]
    if "scale_factor" in inputs:
        layouts = [name for name in layouts if name in ("paddle", "yolo-nas")]  # the second without suppression
    return [name for name in layouts if (name in TURNED) == turned]


def plain_name(output: str) -> str:
    """Without the number that frozen graphs give an output.

    >>> plain_name("detection_boxes:0")
    'detection_boxes'
    """
    return output.partition(":")[0]


def _single(name: str, rows: NDArray[Any], size: Size, *, richer: bool) -> list[LayoutName]:
    layouts: list[LayoutName] = ["fastestdet"] if _is_fastestdet(rows, size) else []
    if rows.ndim == 3 and rows.shape[::2] == (1, 7):
        layouts.append("openvino")
    if rows.ndim != 2:
        return layouts
    count, columns = rows.shape
    cells = [cell_count(size, strides) for strides in STRIDE_SETS]
    if columns in cells and count >= 5 and count not in cells:
        layouts += ["yolov8", "obb"] if count >= 6 else ["yolov8"]
    if count in [3 * n for n in cells] and columns >= 6:
        layouts.append("yolov5")
    if count in cells and columns >= 5:
        layouts += _box_a_cell(rows, size)
    if columns > 7 and count <= _MOST_ROWS and not {count, columns} & {*cells}:
        # Key points or weights of masks stand behind; rows of zeros alone could be anything.
        filled = rows[rows[:, 4] > 0]
        likely = bool((filled[:, 2:4] > filled[:, :2]).all()) if len(filled) else richer
        layouts += ["yolo-suppressed"] if likely and _can_be_suppressed(rows, size, (0, 4, 5)) else []
    if columns == 6 and count <= _MOST_ROWS:
        layouts += ["yolo-suppressed"] if _can_be_suppressed(rows, size, (0, 4, 5)) else []
        layouts += ["paddle"] if _can_be_suppressed(rows, size, (2, 1, 0)) and rows.any() else []
    if columns == 7 and count <= _MOST_ROWS:
        layouts += _seven(name, rows, size)
    if columns >= 5 and _FEWEST_QUERIES <= count <= _MOST_ROWS and _can_be_shares(rows):
        layouts.append("rtdetr-joined")
    return layouts


def _seven(name: str, rows: NDArray[Any], size: Size) -> list[LayoutName]:
    """Class and score of YOLOv7 stand the other way round in YOLO-NAS; without a row only the name tells."""
    layouts: list[LayoutName] = ["obb-suppressed"]
    if rows[:, 0].any():
        return layouts
    flat = "flat" in name
    if not rows.any():
        return [*layouts, "yolo-nas-rows" if flat else "yolov7"]
    layouts += ["yolov7"] if _can_be_suppressed(rows, size, (1, 6, 5)) and not flat else []
    return [*layouts, "yolo-nas-rows"] if _can_be_suppressed(rows, size, (1, 5, 6)) else layouts


def _is_fastestdet(output: NDArray[Any], size: Size) -> bool:
    """Chances of any object and of each class, for every cell."""
    rows = fastestdet_rows(output)
    if rows.ndim != 2 or rows.shape[1] < 6 or len(rows) != cell_count(size, ONE_STRIDE):
        return False
    return _shares_of_one(rows[:, :1]) and _shares_of_one(rows[:, 5:])


def _shares_of_one(values: NDArray[Any]) -> bool:
    """Whether all values lie in [0, 1], but for half precision."""
    return not values.size or bool(values.min() >= -1e-3 and values.max() <= 1 + 1e-3)


def _box_a_cell(rows: NDArray[Any], size: Size) -> list[LayoutName]:
    """In strides from the cell, or already in pixels: a centre lies near its cell in one of the two readings.

    In pixels the shape is that of three families. YOLOv6 fills the column of the chance of any object with ones; with
    and without that column the others look the same.
    """
    cells, strides = grid(size, len(rows))
    centres = rows[:, :2].astype(np.float64)
    layouts, sure = _nanodet(rows)
    if rows.shape[1] >= 6 and not sure and (np.abs(centres) < _REACH).mean() > _NEARLY_ALL:
        layouts.append("yolox")
    if (np.abs(centres / strides - cells) < _REACH).mean() > _NEARLY_ALL and (rows[:, 2:4] >= 0).all():
        if rows.shape[1] >= 6 and (rows[:, 4] == 1).all():
            return [*layouts, "yolov6"]
        if rows.shape[1] >= 6:
            layouts.append("yolox-decoded")
        layouts.append("yolov8-rows")
    return layouts


# Steps of the distance to a side, by layout.
_NANODET: Mapping[LayoutName, int] = {"nanodet": NANODET_BINS, "nanodet-g": NANODET_G_BINS}


def _is_nanodet_apart(outputs: Outputs, bins: int, size: Size) -> bool:
    """Scores and logits of each stride as outputs of their own."""
    if sum(x.shape[1] == 4 * bins for x in outputs) * 2 != len(outputs):
        return False
    scores = [x for x in outputs if x.shape[1] != 4 * bins]
    cells = cell_count(size, STRIDES if len(scores) == len(STRIDES) else MORE_STRIDES)
    return all(map(_shares_of_one, scores)) and sum(map(len, scores)) == cells


def _nanodet(rows: NDArray[Any]) -> tuple[list[LayoutName], bool]:
    """NanoDet's rows: all classes are probabilities and what follows is not; for sure where no column of it is."""
    layouts: dict[LayoutName, bool] = {}
    for name, bins in _NANODET.items():
        scores, logits = np.split(rows, [max(rows.shape[1] - 4 * bins, 0)], axis=1)
        beyond = (logits < 0).any(axis=0) | (logits > 1).any(axis=0)
        if scores.shape[1] and _shares_of_one(scores) and beyond.any():
            layouts[name] = bool(beyond.all())
    sure = [name for name, all_beyond in layouts.items() if all_beyond]
    return sure or list(layouts), bool(sure)


def _can_be_suppressed(rows: NDArray[Any], size: Size, columns: tuple[int, int, int]) -> bool:
    """Rows of zeros, or corners in order, scores in [0, 1] and whole classes, in these columns."""
    box, score, label = columns
    real = rows[rows[:, score] > 0].astype(np.float64)
    if not len(real):
        return bool((rows == 0).all())
    boxes = real[:, box : box + 4]
    ordered = (boxes[:, 2:] >= boxes[:, :2]).all(axis=1)
    integral = (real[:, label] == np.round(real[:, label])) & (real[:, label] >= 0)
    inside = (np.abs(boxes) <= 4 * max(size)).all(axis=1)
    return bool((ordered & integral & inside & (real[:, score] <= 1)).all())


def _can_be_shares(rows: NDArray[Any]) -> bool:
    """Centres and sides as shares of the picture, scores in [0, 1]; a transformer's row is never empty."""
    boxes, scores = rows[:, :4], rows[:, 4:]
    inside = (boxes >= -0.5).all() and (boxes <= 1.5).all() and (scores >= 0).all() and (scores <= 1).all()
    return bool(inside and (boxes[:, 2:] > 0).mean() > 0.9)


def _pair(outputs: Mapping[str, NDArray[Any]], size: Size) -> list[LayoutName]:
    arrays = list(outputs.values())
    rows, second = arrays
    integral = np.issubdtype(second.dtype, np.integer)
    if integral and rows.ndim == 2 and second.shape == (len(rows),) and rows.shape[1] == 5:
        return ["mmdeploy"]
    if integral and rows.ndim == 2 and second.size == 1 and rows.shape[1] == 6:
        return ["paddle"]
    if any(x.ndim != 2 or not np.issubdtype(x.dtype, np.floating) for x in arrays):
        return []
    if is_blazepose(arrays, *size):
        return ["blazepose"]
    boxes, values = paired(arrays)
    if boxes.shape[1] != 4 or len(boxes) != len(values):
        return []
    in_order = bool((boxes[:, 2:] >= boxes[:, :2]).all())
    if is_ssd(arrays, *size) and not in_order:
        return ["ssd"]
    if (boxes < -0.5).any() or (boxes > 1.5).any():
        cells = len(boxes) in [cell_count(size, strides) for strides in STRIDE_SETS]
        return ["yolo-nas"] if cells and in_order and _shares_of_one(values) else []
    if set(outputs) in _DETR_NAMES or any("logits" in name.lower() for name in outputs):
        return ["detr"]
    layouts: list[LayoutName] = ["detr"] if (boxes[:, 2:] >= 0).all() else []
    # Corners are in order in every row; of centres and sides some row is not, once there are many.
    return [*layouts, "corners"] if in_order else layouts


def _is_counted(arrays: Outputs) -> bool:
    boxes, labels, scores, count = arrays
    of_boxes = all(x.shape == (len(boxes),) for x in (labels, scores)) if boxes.ndim == 2 else False
    return bool(of_boxes and boxes.shape[1] == 4 and count.size == 1)


def _is_torchvision(arrays: Outputs) -> bool:
    boxes = [x for x in arrays if x.ndim == 2 and x.shape[1] == 4]
    labels = [x for x in arrays if x.ndim == 1 and np.issubdtype(x.dtype, np.integer)]
    scores = [x for x in arrays if x.ndim == 1 and np.issubdtype(x.dtype, np.floating)]
    return len(boxes) == len(labels) == len(scores) == 1 and len(boxes[0]) == len(labels[0]) == len(scores[0])


def of_so_many_classes(layouts: list[LayoutName], arrays: Outputs, classes: int | None) -> list[LayoutName]:
    """The layouts that have so many classes; where nothing says how many, COCO's are likelier than one more or less.

    Args:
        layouts: that fit.
        arrays: the outputs.
        classes: number of classes of objects, where the file or the user tells it.
    """
    counts = {name: LAYOUTS[name].classes(arrays) for name in layouts}
    if classes is None:
        likely = [name for name in layouts if counts[name] in COCO]
        return likely if len(layouts) > 1 and len(likely) == 1 and counts.keys() <= _KNOWN_BY_COUNT else layouts
    # One class more is that of "no object".
    return [n for n in layouts if counts[n] in (None, classes) or (LAYOUTS[n].paired and counts[n] == classes + 1)]


def possible_kinds(
    values: NDArray[Any], names: int | None = None, *, paired: bool = True, rf_detr: bool = False
) -> list[ScoreKind]:
    """What ``(N, C)`` class values for a picture of noise can be.

    Args:
        values: of N queries and C classes.
        names: number of classes that have a name, where that is known: "no object" has none.
        paired: they are an output of their own; those in rows with the boxes never go through a softmax.
        rf_detr: the outputs have the names of RF-DETR's, which gives logits of a sigmoid.
    """
    if not paired:
        return ["sigmoid"] if values.size and values.min() < 0 else ["probabilities"]
    if not values.size or (values.min() >= 0 and values.max() <= 1):
        return ["probabilities"]
    count = values.shape[1]
    if count == 1 or names == count:
        return ["sigmoid"]
    # That a class has no name says nothing: RF-DETR has one too many, and a sigmoid.
    if background_first(values) or min(_wins(values, count - 1)) >= _NEARLY_ALL:
        return ["softmax"]
    if rf_detr:
        return ["sigmoid"]
    # The only class that was trained, or "no object" with small numbers: from a half on softmax cannot be ruled out.
    return ["sigmoid", "softmax"] if _wins(values, count - 1)[0] >= 0.5 else ["sigmoid"]


def background_first(values: NDArray[Any]) -> bool:
    """Whether "no object" is the first class of ``(N, C)`` logits for a picture of noise, as in SSD."""
    return values.shape[1] > 1 and min(_wins(values, 0)) >= _NEARLY_ALL


def _wins(values: NDArray[Any], column: int) -> tuple[float, float]:
    """Share of the rows in which a class is the largest, and in which a sigmoid would call it likely."""
    return float((values.argmax(axis=1) == column).mean()), float((values[:, column] > 0).mean())


def metadata_value(metadata: Mapping[str, str], key: str) -> Any:
    """The value that Ultralytics writes as text under a key of the metadata; None where there is none."""
    try:
        return ast.literal_eval(metadata[key])
    except (KeyError, ValueError, SyntaxError):
        return None


def class_names(metadata: Mapping[str, str]) -> tuple[str, ...] | None:
    """Names of the classes as Ultralytics writes them: a dict from numbers to names."""
    names = metadata_value(metadata, "names")
    if isinstance(names, dict) and sorted(names) == list(range(len(names))):
        names = [names[n] for n in range(len(names))]
    return tuple(str(x) for x in names) if isinstance(names, list | tuple) and names else None


def class_of_people(path: Path, names: Sequence[str] | None, count: int | None) -> int:
    """Number of the class of people among those of objects, from 0.

    Args:
        path: of the file, for messages.
        names: of the classes, where they are known.
        count: of the classes, where it is known.

    Raises:
        RequestError: it is not known which.
    """
    people = [n for n, name in enumerate(names or ()) if name.strip().lower() in PERSON_NAMES]
    if len(people) == 1:
        return people[0]
    if names:
        listed = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
        what = "several classes of people" if people else "no class of people"
        raise RequestError(f"{path}: {what} among {listed}; say which one with `detector_options.person`")
    if count == 1:
        return 0
    if count in COCO:
        return COCO[count]
    which = "an unknown number of" if count is None else str(count)
    raise RequestError(
        f"{path}: {which} classes without names; say which one is people with `detector_options.person` "
        "(COCO: 0 in YOLO, 1 in torchvision and TensorFlow)"
    )
