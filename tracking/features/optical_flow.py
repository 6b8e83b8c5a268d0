"""Dense optical flow between two frames: where every pixel of the first has gone in the second.

A flow field is ``(H, W, 2)`` float32, pixels to the right and down: what shows at ``(x, y)`` in the first image shows
at ``(x + u, y + v)`` in the second.

TV-L1 takes the total variation of the flow against the L1 norm of the brightness differences: Zach, Pock and Bischof,
*A Duality Based Approach for Realtime TV-L1 Optical Flow*, 2007. At every level of a pyramid the second image is warped
several times by the flow so far. After each warp the flow u and a coupled field v are computed in turn until they no
longer change: v pixel by pixel, by thresholding (eq. 15 there), and u by Chambolle's dual variable p (eq. 14).

Two parts are from later papers:

* median filtering of the flow between warps: Wedel et al., *An Improved Algorithm for TV-L1 Optical Flow*, 2009;
* bicubic warps, and image gradients by five-point differences averaged over both images: Sun, Roth and Black, *Secrets
  of Optical Flow Estimation and Their Principles*, 2010.

Both components of the flow lie in one array, one below the other, and all operations write to memory allocated before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import ImageArray

Float32 = NDArray[np.float32]
Grey = NDArray[np.uint8]


# Standard deviation of the blur that takes the sensor's finest noise away, pixels.
SMOOTHING = 0.5
# Weight of the brightness differences (in grey levels of 255) against the total variation, lambda.
ATTACHMENT = 0.18
# Coupling of u and v, theta, the smaller the tighter.
TIGHTNESS = 0.2
# Step size of the dual variable, tau, at most 0.25.
STEP = 0.25
# Size of a level of the pyramid over the one before.
SCALE = 0.5
# Most levels of the pyramid.
LEVELS = 6
# Smallest side of a level and of what DIS and Farneback take, pixels.
SMALLEST_SIDE = 16
# Warps of the second image at each level.
WARPS = 10
# Most iterations after each warp.
ITERATIONS = 40
# Mean squared change of the flow in an iteration under which a warp is done, square pixels.
TOLERANCE = 1e-4
# Iterations from one look at that change to the next.
CHECK_EVERY = 5
# Side of the median filter after each warp, pixels.
MEDIAN = 5


def tv_l1(first: Grey, second: Grey, start: Float32 | None = None, warps: int = WARPS) -> Float32:
    """The flow ``(H, W, 2)`` from ``first`` to ``second``, both ``(H, W)`` uint8.

    Args:
        first: image.
        second: image.
        start: ``(H, W, 2)`` a flow to refine: only the finest level is then solved.
        warps: of the second image at each level.
    """
    pyramid = [tuple(cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING) for image in (first, second))]
    while start is None and len(pyramid) < LEVELS:
        size = tuple(round(side * SCALE) for side in pyramid[-1][0].shape[::-1])
        if min(size) < SMALLEST_SIDE:
            break
        pyramid.append(tuple(cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in pyramid[-1]))
    height, width = pyramid[-1][0].shape
    flow = np.zeros((2, height, width), dtype=np.float32)
    if start is not None:
        flow[:] = start.transpose(2, 0, 1)
    for level in reversed(pyramid):
        flow = _resized(flow, level[0].shape[::-1])
        _Level(*(np.asarray(image, dtype=np.float32) for image in level)).solve(flow, warps)
    return np.ascontiguousarray(flow.transpose(1, 2, 0))


def _resized(flow: Float32, size: tuple[int, ...]) -> Float32:
    """``flow`` ``(2, h, w)`` at another size (width, height), in its pixels."""
    height, width = flow.shape[1:]
    if (width, height) == size:
        return flow
    factors = np.array([size[0] / width, size[1] / height], dtype=np.float32)
    parts = [cv2.resize(part, size, interpolation=cv2.INTER_LINEAR) for part in flow]
    return np.asarray(np.stack(parts) * factors[:, None, None], dtype=np.float32)


class _Level:
    """One level of the pyramid and the memory for its iterations."""

    def __init__(self, first: Float32, second: Float32) -> None:
        self.first, self.second = first, second
        height, width = first.shape
        self.columns, self.rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        self.first_slope, self.second_slope = _gradient(first), _gradient(second)
        shape = (2, height, width)
        self.slope = np.empty(shape, dtype=np.float32)
        self.auxiliary = np.empty(shape, dtype=np.float32)
        self.dual_x, self.dual_y = np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32)
        self.gradient_x, self.gradient_y = np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32)
        self.divergence = np.empty(shape, dtype=np.float32)
        self.previous = np.empty(shape, dtype=np.float32)
        self.product = np.empty(shape, dtype=np.float32)
        self.residual = np.empty((height, width), dtype=np.float32)

    def solve(self, flow: Float32, warps: int) -> None:
        """Improve ``flow`` ``(2, h, w)`` in place."""
        for _ in range(warps):
            constant, inverse = self._warp(flow)
            for iteration in range(ITERATIONS):
                check = iteration % CHECK_EVERY == CHECK_EVERY - 1
                if check:
                    np.copyto(self.previous, flow)
                self._threshold(flow, constant, inverse)
                self._smooth(flow)
                if check:
                    change = cv2.norm(_flat(flow), _flat(self.previous), cv2.NORM_L2SQR) / self.residual.size
                    if change < TOLERANCE:
                        break
            for part in flow:
                cv2.medianBlur(part, MEDIAN, dst=part)

    def _warp(self, flow: Float32) -> tuple[Float32, Float32]:
        """The part of the residual that does not change with the flow, and 1 / |slope|^2, both ``(h, w)``."""
        x, y = self.columns + flow[0], self.rows + flow[1]
        border = cv2.BORDER_REPLICATE
        warped = cv2.remap(self.second, x, y, cv2.INTER_CUBIC, borderMode=border)
        for part, target in zip(self.second_slope, self.slope, strict=True):
            cv2.remap(part, x, y, cv2.INTER_CUBIC, dst=target, borderMode=border)
        cv2.addWeighted(_flat(self.slope), 0.5, _flat(self.first_slope), 0.5, 0.0, dst=_flat(self.slope))
        # What has left the image says nothing.
        height, width = self.first.shape
        outside = (x < 0) | (y < 0) | (x > width - 1) | (y > height - 1)
        self.slope[:, outside] = 0
        squared = self.slope[0] ** 2 + self.slope[1] ** 2
        constant = warped - self.first
        constant -= self.slope[0] * flow[0]
        constant -= self.slope[1] * flow[1]
        inverse = 1 / np.maximum(squared, np.float32(1e-3))
        return constant, inverse

    def _threshold(self, flow: Float32, constant: Float32, inverse: Float32) -> None:
        """v from u: a step along the slope that undoes the residual, of a bounded length (eq. 15)."""
        limit = ATTACHMENT * TIGHTNESS
        cv2.multiply(_flat(self.slope), _flat(flow), dst=_flat(self.product))
        cv2.add(self.product[0], self.product[1], dst=self.residual)
        cv2.add(self.residual, constant, dst=self.residual)
        cv2.multiply(self.residual, inverse, dst=self.residual)
        np.clip(self.residual, -limit, limit, out=self.residual)
        for part, slope, target in zip(flow, self.slope, self.auxiliary, strict=True):
            cv2.multiply(slope, self.residual, dst=target)
            cv2.subtract(part, target, dst=target)

    def _smooth(self, flow: Float32) -> None:
        """u from v by one step of the dual (eq. 14)."""
        ratio = STEP / TIGHTNESS
        x, y = self.dual_x, self.dual_y
        np.add(x, y, out=self.divergence)
        self.divergence[:, :, 1:] -= x[:, :, :-1]
        self.divergence[:, 1:] -= y[:, :-1]
        cv2.scaleAdd(_flat(self.divergence), TIGHTNESS, _flat(self.auxiliary), dst=_flat(flow))
        np.subtract(flow[:, :, 1:], flow[:, :, :-1], out=self.gradient_x[:, :, :-1])
        np.subtract(flow[:, 1:], flow[:, :-1], out=self.gradient_y[:, :-1])
        size = _flat(self.product)
        cv2.magnitude(_flat(self.gradient_x), _flat(self.gradient_y), magnitude=size)
        cv2.addWeighted(size, ratio, size, 0.0, 1.0, dst=size)
        for dual, slope in ((x, self.gradient_x), (y, self.gradient_y)):
            cv2.scaleAdd(_flat(slope), ratio, _flat(dual), dst=_flat(dual))
            cv2.divide(_flat(dual), size, dst=_flat(dual))


def _flat(stacked: Float32) -> Float32:
    """``(2, h, w)`` as the ``(2 h, w)`` that OpenCV takes, in the same memory."""
    return stacked.reshape(-1, stacked.shape[2])


def _gradient(image: Float32) -> Float32:
    """``(2, h, w)`` slopes along x and y by five points, exact for polynomials of degree 4."""
    kernel = np.array([[1, -8, 0, 8, -1]], dtype=np.float32) / 12
    border = cv2.BORDER_REPLICATE
    along = [cv2.filter2D(image, cv2.CV_32F, k, borderType=border) for k in (kernel, kernel.T)]
    return np.asarray(np.stack(along), dtype=np.float32)


FlowMethod: TypeAlias = Callable[[Grey, Grey], Float32]
FlowName = Literal["tv-l1", "dis", "dis_fast", "farneback"]


def dis_flow(first: Grey, second: Grey, preset: int = cv2.DISOPTICAL_FLOW_PRESET_MEDIUM) -> Float32:
    """Dense inverse search, as OpenCV has it (Kroeger et al., *Fast Optical Flow using Dense Inverse Search*, 2016).

    Args:
        first: ``(H, W)`` uint8.
        second: ``(H, W)`` uint8.
        preset: of OpenCV; the more careful, the slower.
    """
    start: Any = None
    return np.asarray(cv2.DISOpticalFlow.create(preset).calc(first, second, start), dtype=np.float32)


def farneback_flow(first: Grey, second: Grey) -> Float32:
    """Polynomial expansion of ``(H, W)`` uint8, as OpenCV has it (Farnebäck, *Two-Frame Motion Estimation*, 2003)."""
    start: Any = None
    return np.asarray(cv2.calcOpticalFlowFarneback(first, second, start, 0.5, 5, 13, 3, 5, 1.1, 0), dtype=np.float32)


FLOW_METHODS: Mapping[FlowName, FlowMethod] = {
    "tv-l1": tv_l1,
    "dis": dis_flow,
    "dis_fast": partial(dis_flow, preset=cv2.DISOPTICAL_FLOW_PRESET_FAST),
    "farneback": farneback_flow,
}


def optical_flow(first: ImageArray, second: ImageArray, method: FlowMethod = dis_flow) -> Float32:
    """The flow from ``first`` to ``second``.

    Args:
        first: ``(H, W, 3)`` uint8 RGB, or ``(H, W)`` uint8 grey.
        second: of the same shape.
        method: one of ``FLOW_METHODS``, or another function of two grey images.

    Raises:
        ValueError: the images differ in shape.
    """
    if first.shape != second.shape:
        raise ValueError(f"expected two images of one shape, got {first.shape} and {second.shape}")
    height, width = first.shape[:2]
    # Of images that are too small the borders are repeated.
    down, right = max(SMALLEST_SIDE - height, 0), max(SMALLEST_SIDE - width, 0)
    grey_first, grey_second = (
        cv2.copyMakeBorder(
            image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY),
            0, down, 0, right, cv2.BORDER_REPLICATE,
        )
        for image in (first, second)
    )  # fmt: skip
    return method(np.asarray(grey_first, dtype=np.uint8), np.asarray(grey_second, dtype=np.uint8))[:height, :width]
