"""Which layout a detector of others has, told by the shapes and values of its outputs for a trial picture.

A layout is named only where no other fits: a wrong guess gives boxes at wrong places that look almost right.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.networks.detector_layouts import (
    LAYOUTS,
    MORE_STRIDES,
    TENSORFLOW,
    Outputs,
    Size,
    cell_count,
    grid,
    paired,
)
from tsuiseki.tracking.features.networks.foreign_options import LayoutName

# Rows of a detector that drops doubles itself; more are never asked for.
_MOST_ROWS = 1000
# Queries of a transformer; fewer are never made.
_FEWEST_QUERIES = 50
# How far, in strides, the centre of a box may lie from its cell.
_REACH = 4.0
_NEARLY_ALL = 0.9
# Where people stand in COCO, by how many classes a network tells: 80 without gaps, 90 or 91 with COCO's own numbers.
COCO = {80: 0, 90: 1, 91: 1}
# Layouts that differ by one class and by nothing else.
_TOLD_BY_COUNT = {"yolox-decoded", "yolov8-rows"}
BOX_NAMES = ("dets", "pred_boxes")
_DETR_NAMES = ({"dets", "labels"}, {"logits", "pred_boxes"}, {"pred_logits", "pred_boxes"})


def possible_layouts(outputs: Mapping[str, NDArray[Any]], size: Size, classes: int | None = None) -> list[LayoutName]:
    """The layouts that ``outputs`` can be; none where they are of no known kind.

    Args:
        outputs: by name, for one picture, without the batch axis.
        size: height and width of the input.
        classes: number of classes of objects, where the file or the user tells it; layouts with another number are
            left out.
    """
    arrays = list(outputs.values())
    if any(not np.isfinite(x).all() for x in arrays if np.issubdtype(x.dtype, np.floating)):
        return []
    if tuple(map(plain_name, outputs)) == TENSORFLOW:
        return ["tensorflow"]
    found: list[LayoutName] = []
    if len(arrays) == 1 and arrays[0].ndim == 2:
        found = _single(arrays[0], size)
    elif len(arrays) == 2 and all(x.ndim == 2 for x in arrays) and len(arrays[0]) == len(arrays[1]):
        found = _pair(outputs)
    elif len(arrays) == 3 and _is_torchvision(arrays):
        found = ["torchvision"]
    return _of_so_many_classes(found, arrays, classes)


def plain_name(output: str) -> str:
    """Without the number that frozen graphs give an output.

    >>> plain_name("detection_boxes:0")
    'detection_boxes'
    """
    return output.partition(":")[0]


def _single(rows: NDArray[Any], size: Size) -> list[LayoutName]:
    count, columns = rows.shape
    cells = (cell_count(size), cell_count(size, MORE_STRIDES))
    found: list[LayoutName] = []
    if columns in cells and count >= 5 and count not in cells:
        found.append("yolov8")
    if count in [3 * n for n in cells] and columns >= 6:
        found.append("yolov5")
    if count in cells and columns >= 5:
        found += _box_a_cell(rows, size)
    if columns == 6 and count <= _MOST_ROWS and _can_be_suppressed(rows, size):
        found.append("yolo-suppressed")
    if columns >= 5 and _FEWEST_QUERIES <= count <= _MOST_ROWS and _can_be_shares(rows):
        found.append("rtdetr-joined")
    return found


def _box_a_cell(rows: NDArray[Any], size: Size) -> list[LayoutName]:
    """In strides from the cell, or already in pixels: a centre lies near its cell in one of the two readings.

    In pixels the shape is that of three families. YOLOv6 fills the column of the chance of any object with ones; with
    and without that column the others look the same.
    """
    cells, strides = grid(size, len(rows))
    centres = rows[:, :2].astype(np.float64)
    found: list[LayoutName] = []
    if rows.shape[1] >= 6 and (np.abs(centres) < _REACH).mean() > _NEARLY_ALL:
        found.append("yolox")
    if (np.abs(centres / strides - cells) < _REACH).mean() > _NEARLY_ALL and (rows[:, 2:4] >= 0).all():
        if rows.shape[1] >= 6 and (rows[:, 4] == 1).all():
            return [*found, "yolov6"]
        if rows.shape[1] >= 6:
            found.append("yolox-decoded")
        found.append("yolov8-rows")
    return found


def _can_be_suppressed(rows: NDArray[Any], size: Size) -> bool:
    """Rows of zeros, or corners in order, scores in [0, 1] and whole classes."""
    real = rows[rows[:, 4] > 0].astype(np.float64)
    if not len(real):
        return bool((rows == 0).all())
    ordered = (real[:, 2] >= real[:, 0]) & (real[:, 3] >= real[:, 1])
    whole = (real[:, 5] == np.round(real[:, 5])) & (real[:, 5] >= 0)
    inside = (np.abs(real[:, :4]) <= 4 * max(size)).all(axis=1)
    return bool((ordered & whole & inside & (real[:, 4] <= 1)).all())


def _can_be_shares(rows: NDArray[Any]) -> bool:
    """Centres and sides as shares of the picture, scores in [0, 1]; a transformer's row is never empty."""
    boxes, scores = rows[:, :4], rows[:, 4:]
    inside = (boxes >= -0.5).all() and (boxes <= 1.5).all() and (scores >= 0).all() and (scores <= 1).all()
    return bool(inside and (boxes[:, 2:] > 0).mean() > 0.9)


def _pair(outputs: Mapping[str, NDArray[Any]]) -> list[LayoutName]:
    arrays = list(outputs.values())
    if all(x.shape[1] != 4 for x in arrays) or any(not np.issubdtype(x.dtype, np.floating) for x in arrays):
        return []
    boxes, _ = paired(arrays)
    if (boxes < -0.5).any() or (boxes > 1.5).any():
        return []
    if set(outputs) in _DETR_NAMES:
        return ["detr"]
    found: list[LayoutName] = ["detr"] if (boxes[:, 2:] >= 0).all() else []
    # Corners are in order in every row; of centres and sides some row is not, once there are many.
    return [*found, "corners"] if (boxes[:, 2:] >= boxes[:, :2]).all() else found


def _is_torchvision(arrays: Outputs) -> bool:
    boxes = [x for x in arrays if x.ndim == 2 and x.shape[1] == 4]
    labels = [x for x in arrays if x.ndim == 1 and np.issubdtype(x.dtype, np.integer)]
    scores = [x for x in arrays if x.ndim == 1 and np.issubdtype(x.dtype, np.floating)]
    return len(boxes) == len(labels) == len(scores) == 1 and len(boxes[0]) == len(labels[0]) == len(scores[0])


def _of_so_many_classes(found: list[LayoutName], arrays: Outputs, classes: int | None) -> list[LayoutName]:
    """The layouts that have so many classes; where nothing says how many, COCO's are likelier than one more or less."""
    told = {name: LAYOUTS[name].classes(arrays) for name in found}
    if classes is None:
        likely = [name for name in found if told[name] in COCO]
        return likely if len(found) > 1 and len(likely) == 1 and told.keys() <= _TOLD_BY_COUNT else found
    # One class more is that of "no object".
    return [n for n in found if told[n] in (None, classes) or (LAYOUTS[n].paired and told[n] == classes + 1)]
