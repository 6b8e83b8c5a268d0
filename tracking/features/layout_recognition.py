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
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.detector_layouts import (
    LAYOUTS,
    MORE_STRIDES,
    TENSORFLOW,
    Outputs,
    Size,
    cell_count,
    grid,
    paired,
)
from tsuiseki.tracking.features.foreign_options import LayoutName, ScoreKind

# Rows of a detector that drops doubles itself; more are never asked for.
_MOST_ROWS = 1000
# Queries of a transformer; fewer are never made.
_FEWEST_QUERIES = 50
# How far, in strides, the centre of a box may lie from its cell.
_REACH = 4.0
# Share of cells, or of queries in a picture of noise, that count as nearly all.
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


# From here on a softmax cannot be ruled out.
_HALF = 0.5


def possible_kinds(values: NDArray[Any], names: int | None = None) -> list[ScoreKind]:
    """What ``(N, C)`` class values for a picture of noise can be.

    Args:
        values: of N queries and C classes.
        names: number of classes that have a name, where that is known: "no object" has none.
    """
    if not values.size or (values.min() >= 0 and values.max() <= 1):
        return ["probabilities"]
    count = values.shape[1]
    if count == 1 or names == count:
        return ["sigmoid"]
    if names == count - 1 or background_first(values) or min(_wins(values, count - 1)) >= _NEARLY_ALL:
        return ["softmax"]
    # The only class that was trained, or "no object" with small numbers.
    return ["sigmoid", "softmax"] if _wins(values, count - 1)[0] >= _HALF else ["sigmoid"]


def background_first(values: NDArray[Any]) -> bool:
    """Whether "no object" is the first class of ``(N, C)`` logits for a picture of noise, as in SSD."""
    return values.shape[1] > 1 and min(_wins(values, 0)) >= _NEARLY_ALL


def _wins(values: NDArray[Any], column: int) -> tuple[float, float]:
    """Share of the rows in which a class is the largest, and in which a sigmoid would call it likely."""
    return float((values.argmax(axis=1) == column).mean()), float((values[:, column] > 0).mean())


PERSON_NAMES = ("person", "pedestrian", "people", "human", "persons", "pedestrians")


def class_names(metadata: Mapping[str, str]) -> tuple[str, ...] | None:
    """Names of the classes as Ultralytics writes them: the text of a dict from numbers to names."""
    try:
        names = ast.literal_eval(metadata["names"])
    except (KeyError, ValueError, SyntaxError):
        return None
    if isinstance(names, dict) and sorted(names) == list(range(len(names))):
        names = [names[n] for n in range(len(names))]
    return tuple(str(x) for x in names) if isinstance(names, list | tuple) and names else None


def class_of_people(path: Path, names: Sequence[str] | None, count: int | None, asked: int | None) -> int:
    """Number of the class of people among those of objects, from 0.

    Args:
        path: of the file, for messages.
        names: of the classes, where they are known.
        count: of the classes, where it is known.
        asked: what the user says.

    Raises:
        RequestError: there is no such class, or it is not known which.
    """
    if asked is not None:
        if asked < 0 or (count is not None and asked >= count):
            among = "from 0" if count is None else f"from 0 to {count - 1}"
            raise RequestError(f"{path}: expected a class of people {among}, got {asked}")
        return asked
    if names:
        return _named(path, names)
    if count == 1:
        return 0
    if count in COCO:
        return COCO[count]
    which = "an unknown number of" if count is None else str(count)
    raise RequestError(
        f"{path}: {which} classes without names; say which one is people with `detector_options.person` "
        "(COCO: 0 in YOLO, 1 in torchvision and TensorFlow)"
    )


def _named(path: Path, names: Sequence[str]) -> int:
    found = [n for n, name in enumerate(names) if name.strip().lower() in PERSON_NAMES]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
    what = "several classes of people" if found else "no class of people"
    raise RequestError(f"{path}: {what} among {listed}; say which one with `detector_options.person`")
