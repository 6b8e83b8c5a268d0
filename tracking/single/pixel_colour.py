"""How likely each pixel is the target's, by its colour, and what that says of places and sizes.

Bertinetto et al., "Staple: complementary learners for real-time tracking", CVPR 2016, section 3.2: histograms of the
target and of its surroundings give a pixel the probability F / (F + B). Its mean over the target's box, for every
shift of the box, is a response that bending and turning leave as it is; gradients fail on other frames. Its contrast
between the box and a frame around it tells the size.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.single.colour_model import ColourModel, histogram, quantised
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

Float32Array = NDArray[np.float32]

STEP = 2  # every second pixel of a patch in each direction
INNER = 0.8  # share of the target's sides that surely is target
OUTER = 1.1  # share of its sides beyond which is background
RING = 1.4  # side of the frame around a box over the side of the box


class PixelColour(ColourModel):
    """The colours of a target and of its surroundings in a patch, of which every second pixel is looked at."""

    @classmethod
    def learn(cls, patch: ImageArray, width: float, height: float) -> PixelColour:
        """From a patch ``(H, W, 3)`` in the middle of which the target has ``width`` x ``height`` patch pixels."""
        colours = quantised(patch[::STEP, ::STEP])
        inner, outer = _inside_and_outside(colours.shape[0], colours.shape[1], width, height)
        return cls(histogram(colours.take(inner)), histogram(colours.take(outer)))

    def probabilities(self, patch: ImageArray) -> Float32Array:
        """``(H / 2, W / 2)`` in [0, 1] for every second pixel of a patch ``(H, W, 3)``."""
        return np.asarray(self.table[quantised(patch[::STEP, ::STEP])])


def shift_response(
    probabilities: Float32Array, width: float, height: float, shape: tuple[int, int], cell: int
) -> Float32Array:
    """Mean probability inside the target's box for every cyclic shift by whole cells, Staple eq. 7.

    Args:
        probabilities: from `PixelColour.probabilities` of a patch whose middle is shift zero.
        width: of the target, patch pixels.
        height: likewise.
        shape: rows and columns of the response.
        cell: side of a cell, patch pixels.

    Returns:
        ``shape`` float32 in [0, 1].
    """
    kernel = [max(round(INNER * side / STEP), 1) for side in (width, height)]
    means = cv2.blur(probabilities, (kernel[0], kernel[1]), borderType=cv2.BORDER_REPLICATE)
    rows, columns = (_shifted(n, count, cell) for n, count in zip(means.shape, shape, strict=True))
    return np.asarray(means[rows][:, columns])


def size_contrast(probabilities: Float32Array, width: float, height: float, factors: FloatArray) -> FloatArray:
    """How much more target there is inside a box in the middle than in a frame around it, for several sizes.

    Args:
        probabilities: from `PixelColour.probabilities`.
        width: of the box, patch pixels.
        height: likewise.
        factors: ``(S,)`` on width and height, > 0.

    Returns:
        ``(S,)`` in [-1, 1].
    """
    sums = np.asarray(cv2.integral(probabilities), dtype=np.float64)
    box = np.array([width, height]) / STEP
    totals, areas = _centred_sums(sums, np.outer(np.concatenate([factors, factors * RING]), box))
    (inside, with_ring), (area, large) = totals.reshape(2, -1), areas.reshape(2, -1)
    return np.asarray(inside / area - (with_ring - inside) / np.maximum(large - area, 1e-6))


def coloured_area(probabilities: Float32Array, width: float, height: float) -> float:
    """How many looked-at pixels about the middle are more likely the target's than not, by how much, in halves.

    The zeroth moment of Bradski, "Computer vision face tracking for use in a perceptual user interface", 1998. It does
    not depend on the target's outline, but on how clearly colours tell the target.

    Args:
        probabilities: from `PixelColour.probabilities`.
        width: of the target's box, patch pixels; pixels within twice its sides count.
        height: likewise.
    """
    rows, columns = probabilities.shape
    across, down = round(width / STEP), round(height / STEP)
    top, left = max(rows // 2 - down, 0), max(columns // 2 - across, 0)
    part = probabilities[top : rows // 2 + down, left : columns // 2 + across]
    return float(np.maximum(part - 0.5, 0).sum())


@lru_cache(maxsize=8)
def _inside_and_outside(rows: int, columns: int, width: float, height: float) -> tuple[IntArray, IntArray]:
    """Flat indices of looked-at pixels that surely are the target's, and of those that surely are not."""
    down, across = (np.abs(np.arange(n) - (n - 1) / 2) * STEP for n in (rows, columns))
    inner = (down[:, None] <= INNER * height / 2) & (across[None] <= INNER * width / 2)
    outer = (down[:, None] > OUTER * height / 2) | (across[None] > OUTER * width / 2)
    return np.flatnonzero(inner), np.flatnonzero(outer)


@lru_cache(maxsize=16)
def _shifted(length: int, count: int, cell: int) -> IntArray:
    """``(count,)`` the looked-at pixels at the cyclic shifts by whole cells, along ``length`` of them."""
    steps = (np.fft.fftfreq(count) * count) * cell / STEP
    return np.asarray(np.clip(np.round((length - 1) / 2 + steps).astype(int), 0, length - 1))


def _centred_sums(sums: FloatArray, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sums over boxes of ``sizes`` ``(S, 2)`` in the middle of an integral image, and their areas in the image."""
    rows, columns = sums.shape[0] - 1, sums.shape[1] - 1
    left, top = (np.maximum((n - sizes[:, axis]) / 2, 0) for axis, n in enumerate((columns, rows)))
    x, y = np.stack([left, columns - left]), np.stack([top, rows - top])
    x0, y0 = np.minimum(x.astype(int), columns - 1), np.minimum(y.astype(int), rows - 1)
    fx, fy = (x - x0)[None], (y - y0)[:, None]
    above, before = y0[:, None], x0[None]
    upper = sums[above, before] * (1 - fx) + sums[above, before + 1] * fx
    lower = sums[above + 1, before] * (1 - fx) + sums[above + 1, before + 1] * fx
    corners = upper * (1 - fy) + lower * fy
    total = corners[1, 1] - corners[0, 1] - corners[1, 0] + corners[0, 0]
    return total, (x[1] - x[0]) * (y[1] - y[0])
