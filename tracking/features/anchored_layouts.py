"""Raw heads of single-shot detectors: codes of boxes beside anchors, in the order of TensorFlow's and MediaPipe's maps.

Liu et al. 2016, *SSD: Single shot multibox detector*, section 2.2, has the anchors and their code; Bazarevsky et al.
2020, *BlazePose: On-device real-time body pose tracking*, section 2.1, the circle about a body. Outputs are without
their batch axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray

# Strides of an SSD's six maps, pixels of the input.
SSD_STRIDES = (16, 32, 64, 128, 256, 512)
# Widths over heights of its anchors; the first map has the first three only.
ASPECTS = (1.0, 2.0, 0.5, 3.0, 1 / 3)
# Side of the anchors of the first map, share of the input.
SMALLEST = 0.2
# Side of those of the last map, share of the input.
LARGEST = 0.95
# Side of the first map's additional anchor, share of the input.
ADDITIONAL = 0.1
# What the codes of places are divided by.
PLACE_CODE = 10.0
# What the codes of sides are divided by.
SIDE_CODE = 5.0
# Strides of BlazePose's maps with the number of anchors in each cell, which are points.
BLAZEPOSE_MAPS = ((8, 2), (16, 2), (32, 6))
# Width of a body over its length.
SLENDERNESS = 0.41


@cache
def ssd_anchors(height: int, width: int) -> FloatArray:
    """``(N, 4)`` centres x, y, widths and heights as shares of an input of this size; 1,917 for 300 x 300.

    >>> len(ssd_anchors(300, 300))
    1917
    """
    scales = [*np.linspace(SMALLEST, LARGEST, len(SSD_STRIDES)), 1.0]
    maps = []
    for level, stride in enumerate(SSD_STRIDES):
        scale, between = scales[level], np.sqrt(scales[level] * scales[level + 1])
        sides = [(scale * a**0.5, scale / a**0.5) for a in ASPECTS] + [(between, between)]
        if level == 0:
            sides = [(ADDITIONAL, ADDITIONAL), *sides[1:3]]
        centres = np.repeat(_centres(height, width, stride), len(sides), axis=0)
        maps.append(np.concatenate([centres, np.tile(sides, (len(centres) // len(sides), 1))], axis=1))
    return np.concatenate(maps)


@cache
def blazepose_anchors(height: int, width: int) -> FloatArray:
    """``(N, 2)`` points x, y as shares of an input of this size; 2,254 for 224 x 224.

    >>> len(blazepose_anchors(224, 224))
    2254
    """
    return np.concatenate(
        [np.repeat(_centres(height, width, stride), count, axis=0) for stride, count in BLAZEPOSE_MAPS]
    )


def _centres(height: int, width: int, stride: int) -> FloatArray:
    """``(N, 2)`` of the cells of a map, as shares, row by row."""
    rows, columns = -(-height // stride), -(-width // stride)
    y, x = np.mgrid[0:rows, 0:columns]
    return np.stack([(x.ravel() + 0.5) / columns, (y.ravel() + 0.5) / rows], axis=1)


def ssd_boxes(codes: FloatArray, height: int, width: int) -> FloatArray:
    """``(N, 4)`` corners in pixels of ``(N, 4)`` codes y, x, height, width."""
    anchors = ssd_anchors(height, width)
    middle = anchors[:, :2] + codes[:, [1, 0]] / PLACE_CODE * anchors[:, 2:]
    half = anchors[:, 2:] * np.exp(np.minimum(codes[:, [3, 2]] / SIDE_CODE, 12)) / 2
    return np.concatenate([middle - half, middle + half], axis=1) * [width, height, width, height]


def blazepose_boxes(codes: FloatArray, height: int, width: int) -> FloatArray:
    """``(N, 4)`` corners in pixels about the bodies of ``(N, 12)`` codes: a face's box, then four points.

    The first point lies between the hips, the second on the circle about the whole body, where its axis ends. The box
    is that about an ellipse of this axis.
    """
    centre, end = (codes[:, k : k + 2] + blazepose_anchors(height, width) * [width, height] for k in (4, 6))
    axis = end - centre
    half = np.sqrt(axis**2 + (SLENDERNESS * axis[:, ::-1]) ** 2)
    return np.concatenate([centre - half, centre + half], axis=1)


def is_ssd(outputs: Sequence[NDArray[Any]], height: int, width: int) -> bool:
    """Whether two outputs are codes ``(N, 4)`` and class values of as many anchors."""
    return _are(outputs, 4, len(ssd_anchors(height, width)))


def is_blazepose(outputs: Sequence[NDArray[Any]], height: int, width: int) -> bool:
    """Whether two outputs are codes ``(N, 12)`` and one value each of as many points."""
    return _are(outputs, 12, len(blazepose_anchors(height, width))) and outputs[1].shape[1] == 1


def _are(outputs: Sequence[NDArray[Any]], columns: int, count: int) -> bool:
    if len(outputs) != 2 or any(x.ndim != 2 or len(x) != count for x in outputs):
        return False
    return bool(outputs[0].shape[1] == columns)
