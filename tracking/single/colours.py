"""How likely a colour is the target's and not its surroundings', by two histograms, and what that says of boxes.

`ForegroundColour` scores boxes by the mean of that probability. Colours do not depend on shape, so they fail on other
frames than gradients do: a correlation filter that has drifted onto the background keeps a high response, and its
colour score falls.

`PixelColour` is Bertinetto et al., "Staple: complementary learners for real-time tracking", CVPR 2016, section 3.2: a
pixel has the probability F / (F + B). Its mean over the target's box, for every shift of the box, is a response that
bending and turning leave as it is. Its contrast between the box and a frame around it tells the size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.filters.correlation_filters import Float32Array
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, IntArray

# Of red, green and blue each.
LEVELS = 16
# 256 / LEVELS values of a channel are one level.
_BITS = 4
# A new colour counts as neither.
_RARE = 1e-4


@dataclass(frozen=True)
class ColourModel:
    """Two histograms over 16 levels of red, green and blue.

    Attributes:
        target: ``(4096,)`` that sums to one.
        around: likewise, of the surroundings.
    """

    target: FloatArray
    around: FloatArray

    def blend(self, new: Self, rate: float) -> Self:
        """Moved towards ``new`` by ``rate`` in [0, 1]."""
        return replace(
            self,
            target=self.target + rate * (new.target - self.target),
            around=self.around + rate * (new.around - self.around),
        )

    @cached_property
    def table(self) -> Float32Array:
        """``(4096,)`` probability in [0, 1] that a pixel of each colour is the target's."""
        shares = (self.target + _RARE) / (self.target + self.around + 2 * _RARE)
        return np.asarray(shares.astype(np.float32))


def quantised(image: ImageArray) -> NDArray[np.int32]:
    """``(H, W)`` number of the colour of each pixel of ``(H, W, 3)`` uint8, in [0, 4096)."""
    levels = (image >> _BITS).astype(np.int32)
    return np.asarray((levels[..., 0] * LEVELS + levels[..., 1]) * LEVELS + levels[..., 2])


def histogram(colours: NDArray[np.int32]) -> FloatArray:
    """``(4096,)`` shares of colours ``(N,)``; all zero where there is none."""
    return np.bincount(colours, minlength=LEVELS**3) / max(len(colours), 1)


# Shares of width and height that are target rather than background.
CORE = (0.7, 0.8)
# Margins of the surroundings, as shares of width and height, both sides together.
AROUND = (1.2, 0.8)


class ForegroundColour(ColourModel):
    """The colours of a target's inner part and of its surroundings."""

    @classmethod
    def learn(cls, image: ImageArray, box: FloatArray) -> ForegroundColour | None:
        """From an image ``(H, W, 3)`` and a box ``(4,)``; None where target or surroundings have no pixel."""
        size = box[2:] - box[:2]
        outer = np.concatenate([box[:2] - size * AROUND / 2, box[2:] + size * AROUND / 2])
        x1, y1, x2, y2 = _clipped(outer, image)
        if x2 <= x1 or y2 <= y1:
            return None
        colours = quantised(image[y1:y2, x1:x2])
        inner = _mask(_shrunk(box[None])[0] - [x1, y1, x1, y1], colours.shape)
        outside = ~_mask(box - [x1, y1, x1, y1], colours.shape)
        if not inner.any() or not outside.any():
            return None
        return cls(histogram(colours[inner]), histogram(colours[outside]))

    def score(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N,)`` in [0, 1] for boxes ``(N, 4)``; what lies outside the image counts as background."""
        inner = _shrunk(boxes)
        x1, y1, x2, y2 = _clipped(np.concatenate([inner[:, :2].min(axis=0), inner[:, 2:].max(axis=0)]), image)
        if x2 <= x1 or y2 <= y1:
            return np.zeros(len(boxes))
        sums = cv2.integral(self.table.take(quantised(image[y1:y2, x1:x2])))
        corners = np.round(inner).astype(int)
        area = np.maximum((corners[:, 2] - corners[:, 0]) * (corners[:, 3] - corners[:, 1]), 1)
        left, top, right, bottom = np.clip(corners - [x1, y1, x1, y1], 0, [x2 - x1, y2 - y1, x2 - x1, y2 - y1]).T
        total = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        return np.asarray(total / area)


def _shrunk(boxes: FloatArray) -> FloatArray:
    margin = (boxes[:, 2:] - boxes[:, :2]) * (1 - np.array(CORE)) / 2
    return np.concatenate([boxes[:, :2] + margin, boxes[:, 2:] - margin], axis=1)


def _clipped(box: FloatArray, image: ImageArray) -> tuple[int, int, int, int]:
    height, width = image.shape[:2]
    x1, y1, x2, y2 = (round(float(value)) for value in box)
    return max(x1, 0), max(y1, 0), min(x2, width), min(y2, height)


def _mask(box: FloatArray, shape: tuple[int, ...]) -> BoolArray:
    mask = np.zeros(shape, dtype=np.bool_)
    x1, y1, x2, y2 = (max(round(float(value)), 0) for value in box)
    mask[y1:y2, x1:x2] = True
    return mask


# Every second pixel of a patch in each direction.
STEP = 2
# Share of the target's sides that surely is target.
INNER = 0.8
# Share of its sides beyond which is background.
OUTER = 1.1
# Side of the frame around a box over the side of the box.
RING = 1.4


class PixelColour(ColourModel):
    """The colours of a target and of its surroundings in a patch, of which every second pixel counts."""

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
        height: of the same, patch pixels.
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
        height: of the same, patch pixels.
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
    """How many counted pixels about the middle are more likely the target's than not, by how much, in halves.

    The zeroth moment of Bradski, "Computer vision face tracking for use in a perceptual user interface", 1998. It does
    not depend on the target's outline, but on how clearly colours tell the target.

    Args:
        probabilities: from `PixelColour.probabilities`.
        width: of the target's box, patch pixels; pixels within twice its sides count.
        height: of the same, patch pixels.
    """
    rows, columns = probabilities.shape
    across, down = round(width / STEP), round(height / STEP)
    top, left = max(rows // 2 - down, 0), max(columns // 2 - across, 0)
    part = probabilities[top : rows // 2 + down, left : columns // 2 + across]
    return float(np.maximum(part - 0.5, 0).sum())


@lru_cache(maxsize=8)
def _inside_and_outside(rows: int, columns: int, width: float, height: float) -> tuple[IntArray, IntArray]:
    """Flat indices of counted pixels that surely are the target's, and of those that surely are not."""
    down, across = (np.abs(np.arange(n) - (n - 1) / 2) * STEP for n in (rows, columns))
    inner = (down[:, None] <= INNER * height / 2) & (across[None] <= INNER * width / 2)
    outer = (down[:, None] > OUTER * height / 2) | (across[None] > OUTER * width / 2)
    return np.flatnonzero(inner), np.flatnonzero(outer)


@lru_cache(maxsize=16)
def _shifted(length: int, count: int, cell: int) -> IntArray:
    """``(count,)`` the counted pixels at the cyclic shifts by whole cells, along ``length`` of them."""
    steps = (np.fft.fftfreq(count) * count) * cell / STEP
    return np.asarray(np.clip(np.round((length - 1) / 2 + steps).astype(int), 0, length - 1))


def _centred_sums(sums: FloatArray, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sums over boxes of ``sizes`` ``(S, 2)`` in the middle of an integral image, and their areas in the image."""
    rows, columns = sums.shape[0] - 1, sums.shape[1] - 1
    left, top = (np.maximum((n - sizes[:, axis]) / 2, 0) for axis, n in enumerate((columns, rows)))
    x, y = np.stack([left, columns - left]), np.stack([top, rows - top])
    x0, y0 = np.minimum(x.astype(int), columns - 1), np.minimum(y.astype(int), rows - 1)
    fx, fy = (x - x0)[None], (y - y0)[:, None]
    above, beside = y0[:, None], x0[None]
    upper = sums[above, beside] * (1 - fx) + sums[above, beside + 1] * fx
    lower = sums[above + 1, beside] * (1 - fx) + sums[above + 1, beside + 1] * fx
    corners = upper * (1 - fy) + lower * fy
    total = corners[1, 1] - corners[0, 1] - corners[1, 0] + corners[0, 0]
    return total, (x[1] - x[0]) * (y[1] - y[0])
