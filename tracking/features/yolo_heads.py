"""What YOLOs that do more than detect give: boxes and scores come first, then key points, or the weights of masks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.detector_layouts import STRIDE_SETS, Size, cell_count

# What Ultralytics calls networks whose files are detectors, too.
TASKS = ("detect", "obb", "pose", "segment")
# Those that give more in each row.
RICHER_TASKS = ("pose", "segment")
# Sides of the input in sides of the maps from which masks are mixed.
_MASK_STRIDES = (2, 4, 8)
# Columns of a box.
_BOX = 4
# Columns of the smallest set of key points; a single one more is the angle of a turned box.
_FEWEST_MORE = 2


@dataclass(frozen=True)
class Part:
    """The first values of an output along an axis, without that of the batch."""

    axis: int
    count: int

    def of(self, output: NDArray[Any], axes_before: int = 0) -> NDArray[Any]:
        """``output`` cut off behind it; ``axes_before`` are those of the batch that stand before its own."""
        return output[(slice(None),) * (self.axis + axes_before) + (slice(self.count),)]


def rows_beside_masks(outputs: Mapping[str, NDArray[Any]], size: Size) -> tuple[str, int] | None:
    """Name of the output with rows, and how many maps of masks stand beside it; None where there are no such maps."""
    rows = [name for name, x in outputs.items() if x.ndim == 2]
    shapes = {(size[0] // s, size[1] // s) for s in _MASK_STRIDES}
    maps = [x for x in outputs.values() if x.ndim == 3 and x.shape[1:] in shapes]
    return (rows[0], len(maps[0])) if len(outputs) == 2 and len(rows) == len(maps) == 1 else None


def detection_part(
    rows: NDArray[Any], size: Size, task: str, classes: int | None, key_points: Any = None, masks: int = 0
) -> Part | None:
    """The boxes and scores among ``rows``; None where they are all that there is.

    Args:
        rows: of a picture of noise, ``(C, N)`` or ``(N, C)`` for N cells or three times as many.
        size: height and width of the input.
        task: what the file says that the network does.
        classes: how many have a name, where that is known.
        key_points: how many a box has and with how many values, where the file says so.
        masks: that a row weighs.
    """
    if rows.ndim != 2 or task == "obb":
        return None
    counts = [cell_count(size, strides) for strides in STRIDE_SETS]
    axis = 0 if rows.shape[1] in counts and rows.shape[0] not in counts else 1
    if axis == 1 and rows.shape[0] not in (*counts, *(3 * n for n in counts)):
        return None
    total, in_range = rows.shape[axis], _in_range(rows if axis == 1 else rows.T)
    # Three boxes a cell come with the chance of any object; of rows with a box a cell that is not known.
    first = _BOX if rows.shape[1 - axis] in counts else _BOX + 1
    if more := masks or (_product(key_points) if task == "pose" else 0):
        end = total - more
    elif classes is not None and task in RICHER_TASKS and (axis == 0 or first > _BOX):
        end = first + classes
    elif not in_range[:_BOX].all() and (classes is None or total - classes > _BOX + 1):
        end = first + _leading(in_range[first:])
        end = total if total - end < _FEWEST_MORE else end
    else:
        return None
    return Part(axis, end) if first < end < total else None


def _in_range(columns: NDArray[Any]) -> NDArray[np.bool_]:
    """``(C,)`` whether all values of a column can be probabilities, but for half precision."""
    return np.asarray(((columns >= -1e-3) & (columns <= 1 + 1e-3)).all(axis=0))


def _leading(flags: NDArray[np.bool_]) -> int:
    """How many are true before the first that is not."""
    return len(flags) if flags.all() else int(np.argmin(flags))


def _product(shape: Any) -> int:
    numbers = isinstance(shape, list | tuple) and all(isinstance(x, int) and x > 0 for x in shape)
    return math.prod(shape) if numbers else 0
