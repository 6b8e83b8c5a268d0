"""How likely each pixel is the target's, by its colour, and what that says of places and sizes.

Bertinetto et al., "Staple: complementary learners for real-time tracking", CVPR 2016, section 3.2: histograms of the
target and of its surroundings give a pixel the probability F / (F + B). Its mean over the target's box, for every
shift of the box, is a response that bending and turning leave as it is; gradients fail on other frames. Its contrast
between the box and a frame around it tells the size.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray, ImageArray

Float32Array = NDArray[np.float32]

STEP = 2  # every second pixel of a patch in each direction
INNER = 0.8  # share of the target's sides that surely is target
OUTER = 1.1  # share of its sides beyond which is background
RING = 1.4  # side of the frame around a box over the side of the box
_BITS = 4
_LEVELS = 256 >> _BITS
_RARE = 1e-4  # a colour that was never seen counts as neither


@dataclass(frozen=True)
class PixelColour:
    """Two histograms over 16 levels of red, green and blue.

    Attributes:
        target: ``(4096,)`` that sums to one.
        around: likewise.
    """

    target: FloatArray
    around: FloatArray

    @classmethod
    def learn(cls, patch: ImageArray, width: float, height: float) -> PixelColour:
        """From a patch ``(H, W, 3)`` in the middle of which the target has ``width`` x ``height`` patch pixels."""
        colours = _quantised(patch)
        rows, columns = (np.abs(np.arange(n) - (n - 1) / 2) * STEP for n in colours.shape)
        inner = (rows[:, None] <= INNER * height / 2) & (columns[None] <= INNER * width / 2)
        outer = (rows[:, None] > OUTER * height / 2) | (columns[None] > OUTER * width / 2)
        return cls(_histogram(colours[inner]), _histogram(colours[outer]))

    def blend(self, new: PixelColour, rate: float) -> PixelColour:
        """Moved towards ``new`` by ``rate`` in [0, 1]."""
        return PixelColour(
            self.target + rate * (new.target - self.target), self.around + rate * (new.around - self.around)
        )

    def probabilities(self, patch: ImageArray) -> Float32Array:
        """``(H / 2, W / 2)`` in [0, 1] for every second pixel of a patch ``(H, W, 3)``."""
        table = (self.target + _RARE) / (self.target + self.around + 2 * _RARE)
        return np.asarray(table.astype(np.float32)[_quantised(patch)])


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
    steps = [(np.fft.fftfreq(n) * n) * cell / STEP for n in shape]
    places = [
        np.clip(np.round((n - 1) / 2 + step).astype(int), 0, n - 1)
        for n, step in zip(probabilities.shape, steps, strict=True)
    ]
    return np.asarray(means[places[0]][:, places[1]])


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
    inside, area = _centred_sums(sums, np.outer(factors, box))
    with_ring, large = _centred_sums(sums, np.outer(factors * RING, box))
    return np.asarray(inside / area - (with_ring - inside) / np.maximum(large - area, 1e-6))


def _centred_sums(sums: FloatArray, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sums over boxes of ``sizes`` ``(S, 2)`` in the middle of an integral image, and their areas in the image."""
    rows, columns = sums.shape[0] - 1, sums.shape[1] - 1
    left, top = (np.maximum((n - sizes[:, axis]) / 2, 0) for axis, n in enumerate((columns, rows)))
    right, bottom = columns - left, rows - top

    def at(y: FloatArray, x: FloatArray) -> FloatArray:
        y0, x0 = np.minimum(y.astype(int), rows - 1), np.minimum(x.astype(int), columns - 1)
        fy, fx = y - y0, x - x0
        upper = sums[y0, x0] * (1 - fx) + sums[y0, x0 + 1] * fx
        lower = sums[y0 + 1, x0] * (1 - fx) + sums[y0 + 1, x0 + 1] * fx
        return np.asarray(upper * (1 - fy) + lower * fy)

    total = at(bottom, right) - at(top, right) - at(bottom, left) + at(top, left)
    return total, (right - left) * (bottom - top)


def _quantised(patch: ImageArray) -> NDArray[np.int32]:
    levels = (patch[::STEP, ::STEP] >> _BITS).astype(np.int32)
    return np.asarray((levels[..., 0] * _LEVELS + levels[..., 1]) * _LEVELS + levels[..., 2])


def _histogram(colours: NDArray[np.int32]) -> FloatArray:
    return np.bincount(colours, minlength=_LEVELS**3) / max(len(colours), 1)
