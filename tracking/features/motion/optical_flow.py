"""Dense optical flow between two frames: where every pixel of the first has gone in the second.

A flow field is ``(H, W, 2)`` float32, pixels to the right and down: what shows at ``(x, y)`` in the first image shows
at ``(x + u, y + v)`` in the second.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.motion.tv_l1 import tv_l1
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray

FlowField: TypeAlias = NDArray[np.float32]
Grey: TypeAlias = NDArray[np.uint8]
FlowMethod: TypeAlias = Callable[[Grey, Grey], FlowField]
FlowName = Literal["tv-l1", "dis", "dis_fast", "farneback"]
DisPreset = Literal["ultrafast", "fast", "medium"]

# Smallest side that DIS and Farneback take at their coarsest level.
_SMALLEST = 16
# Pixels about a region that its flow is computed with, in sides of the region.
_CONTEXT = 0.25


def dis_flow(first: Grey, second: Grey, preset: DisPreset = "medium") -> FlowField:
    """Dense inverse search, as OpenCV has it (Kroeger et al., *Fast Optical Flow using Dense Inverse Search*, 2016).

    Args:
        first: ``(H, W)`` uint8.
        second: likewise.
        preset: the more careful, the slower.
    """
    presets = {
        "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
        "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
        "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
    }
    start: Any = None
    return np.asarray(cv2.DISOpticalFlow.create(presets[preset]).calc(first, second, start), dtype=np.float32)


def farneback_flow(first: Grey, second: Grey) -> FlowField:
    """Polynomial expansion of ``(H, W)`` uint8, as OpenCV has it (Farnebäck, *Two-Frame Motion Estimation*, 2003)."""
    start: Any = None
    return np.asarray(cv2.calcOpticalFlowFarneback(first, second, start, 0.5, 5, 13, 3, 5, 1.1, 0), dtype=np.float32)


FLOW_METHODS: Mapping[FlowName, FlowMethod] = {
    "tv-l1": tv_l1,
    "dis": dis_flow,
    "dis_fast": partial(dis_flow, preset="fast"),
    "farneback": farneback_flow,
}


def optical_flow(
    first: ImageArray, second: ImageArray, method: FlowMethod = dis_flow, region: FloatArray | None = None
) -> FlowField:
    """The flow from ``first`` to ``second``, of the whole image or of a region.

    Args:
        first: ``(H, W, 3)`` uint8 RGB, or ``(H, W)`` uint8 grey.
        second: of the same shape.
        method: one of ``FLOW_METHODS``, or another function of two grey images.
        region: ``(4,)`` pixels; the flow of `region_pixels`, computed with some of its surroundings.

    Raises:
        ValueError: the images differ in shape, or the region has no pixel in them.
    """
    if first.shape != second.shape:
        raise ValueError(f"expected two images of one shape, got {first.shape} and {second.shape}")
    if region is None:
        return _padded(method, _grey(first), _grey(second))
    height, width = first.shape[:2]
    x1, y1, x2, y2 = region_pixels(region, width, height)
    margin = int(np.ceil(_CONTEXT * max(x2 - x1, y2 - y1)))
    left, top = max(x1 - margin, 0), max(y1 - margin, 0)
    around = (slice(top, min(y2 + margin, height)), slice(left, min(x2 + margin, width)))
    flow = _padded(method, _grey(first[around]), _grey(second[around]))
    return flow[y1 - top : y2 - top, x1 - left : x2 - left]


def region_pixels(region: FloatArray, width: int, height: int) -> tuple[int, int, int, int]:
    """Columns and rows x1, y1, x2, y2 of all pixels that ``region`` ``(4,)`` touches in an image.

    Raises:
        ValueError: there is none.
    """
    x1, y1, x2, y2 = clip_boxes(np.asarray(region, dtype=np.float64), width, height)
    if not (x2 > x1 and y2 > y1):
        raise ValueError(f"expected a region in an image of {width}x{height}, got {np.asarray(region).tolist()}")
    return int(np.floor(x1)), int(np.floor(y1)), int(np.ceil(x2)), int(np.ceil(y2))


def _grey(image: ImageArray) -> Grey:
    return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _padded(method: FlowMethod, first: Grey, second: Grey) -> FlowField:
    """``method`` on images that are too small for it, with their borders repeated."""
    height, width = first.shape
    down, right = max(_SMALLEST - height, 0), max(_SMALLEST - width, 0)
    if down or right:
        first, second = (
            np.asarray(cv2.copyMakeBorder(image, 0, down, 0, right, cv2.BORDER_REPLICATE), dtype=np.uint8)
            for image in (first, second)
        )
    return method(first, second)[:height, :width]
