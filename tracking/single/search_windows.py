"""What correlation filters see and answer: windows and boxes of several sizes in, maps of responses out.

Windows are cut from the image at a fixed template size. A map's ``[0, 0]`` is no shift; its maxima lie between cells,
by parabolas.

A filter over sizes sees gradients of boxes on a fixed ladder of sizes (`SizeLadder`). It takes a frame twice, to
find the size and to learn it. The sizes of both are rungs of one ladder, so what was cut out for the first is mostly
there for the second; how far the target is off a rung goes into what is learnt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.hog import hog
from tsuiseki.tracking.filters.correlation_filters import Float32Array
from tsuiseki.tracking.filters.scale_filter import ScaleSample
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray


def window_grid(reach: int) -> IntArray:
    """``((2 reach + 1)^2, 2)`` steps x, y from the middle one of so many windows to each side, the nearest first."""
    offsets = np.arange(-reach, reach + 1)
    grid = np.array([(x, y) for y in offsets for x in offsets])
    return grid[np.argsort((grid**2).sum(axis=1), kind="stable")]


def _parabola_offset(left: float, at: float, right: float) -> float:
    """Where the parabola through three values has its maximum, in (-0.5, 0.5) around the middle one."""
    curvature = 2 * at - left - right
    return 0.5 * (right - left) / curvature if curvature > 1e-12 else 0.0


def signed_shift(index: FloatArray | float, length: int) -> FloatArray:
    """Cyclic map positions as shifts in [-length/2, length/2)."""
    return np.asarray((index + length / 2) % length - length / 2)


def peak(response: Float32Array) -> tuple[FloatArray, float]:
    """Shift ``(x, y)`` in cells of the greatest value of one map, to sub-cell precision, and the value."""
    row, column = divmod(int(np.argmax(response)), response.shape[1])
    return peak_near(response, np.array([column, row]))


def peak_near(response: Float32Array, cell: IntArray) -> tuple[FloatArray, float]:
    """Shift ``(x, y)`` of the maximum about the cell ``(x, y)`` of one map, to sub-cell precision, and its value."""
    rows, columns = response.shape
    column, row = int(cell[0]) % columns, int(cell[1]) % rows
    value = float(response[row, column])
    dx = _parabola_offset(float(response[row, column - 1]), value, float(response[row, (column + 1) % columns]))
    dy = _parabola_offset(float(response[row - 1, column]), value, float(response[(row + 1) % rows, column]))
    shift = np.array([float(signed_shift(column + dx, columns)), float(signed_shift(row + dy, rows))])
    return shift, value


def maxima_of_each(responses: Float32Array, count: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """The ``count`` greatest local maxima of each of several cyclic maps; fewer come back where there are fewer.

    A cell is one when no neighbour of its eight is greater and one is smaller.

    Args:
        responses: ``(B, rows, columns)`` cyclic maps.
        count: of a map, at most.

    Returns:
        Which map ``(M,)``, ascending, shifts ``(M, 2)`` x, y in whole cells and values ``(M,)``, of a map the greatest
        first.
    """
    greatest = least = responses
    for axis in (-2, -1):
        greatest = np.maximum(np.maximum(greatest, np.roll(greatest, 1, axis)), np.roll(greatest, -1, axis))
        least = np.minimum(np.minimum(least, np.roll(least, 1, axis)), np.roll(least, -1, axis))
    which, row, column = np.nonzero((responses >= greatest) & (responses > least))
    values = responses[which, row, column]
    order = np.lexsort((-values, which))
    rank = np.arange(len(order)) - np.searchsorted(which, which)  # ``which`` is sorted: so many of its map before
    order = order[rank < count]
    which, row, column, values = which[order], row[order], column[order], values[order]
    rows, columns = responses.shape[1:]
    shifts = np.stack([signed_shift(column.astype(np.float64), columns), signed_shift(row.astype(np.float64), rows)], 1)
    return which, shifts, values.astype(np.float64)


@dataclass(frozen=True)
class ResponseMaps:
    """Responses of F filters in W windows of one frame.

    Attributes:
        maps: ``(W, F, rows, columns)`` over cyclic shifts, as :func:`correlation_filters.respond` gives them.
        centres: ``(W, 2)`` of the windows, pixels.
        cell: side of a cell, pixels.
    """

    maps: Float32Array
    centres: FloatArray
    cell: float

    def at(self, places: FloatArray, filters: IntArray) -> FloatArray:
        """Response ``(N,)`` of one filter a place, Eq. (3.5), between cells by bilinear interpolation.

        Args:
            places: ``(N, 2)`` pixels.
            filters: ``(N,)`` index of a filter.

        A place is read in the window whose centre is nearest; outside every window the response is zero.
        """
        shift = (places[:, None] - self.centres[None]) / self.cell
        window = np.argmin((shift**2).sum(axis=2), axis=1)
        shift = shift[np.arange(len(places)), window]
        rows, columns = self.maps.shape[2:]
        x, y = shift[:, 0], shift[:, 1]
        x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        fx, fy = x - x0, y - y0
        total = np.zeros(len(places))
        for dy, wy in ((0, 1 - fy), (1, fy)):
            for dx, wx in ((0, 1 - fx), (1, fx)):
                total += wy * wx * self.maps[window, filters, (y0 + dy) % rows, (x0 + dx) % columns]
        inside = (np.abs(x) <= columns / 2) & (np.abs(y) <= rows / 2)
        return np.where(inside, total, 0.0)

    def climb(self, place: FloatArray, number: int) -> FloatArray:
        """``(2,)`` the local maximum of filter ``number`` that is uphill from ``place`` ``(2,)``, between cells by
        parabolas; ``place`` itself where it is more than a cell and a half away in x or y."""
        window = int(np.argmin(((place - self.centres) ** 2).sum(axis=1)))
        response = self.maps[window, number]
        rows, columns = response.shape
        start = np.round((place - self.centres[window]) / self.cell).astype(int)
        offsets = np.array([(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1)])
        around = start + offsets
        values = response[around[:, 1] % rows, around[:, 0] % columns]
        shift, _ = peak_near(response, around[int(np.argmax(values))])
        maximum = self.centres[window] + shift * self.cell
        return np.asarray(maximum if (np.abs(maximum - place) <= 1.5 * self.cell).all() else place)


# Image pixels per patch pixel from which a patch is averaged: under it bilinear samples miss no pixel.
_AREA_SCALE = 2.0


def cut(image: ImageArray, centres: FloatArray, scales: FloatArray, width: int, height: int) -> ImageArray:
    """``(B, height, width[, C])`` patches around places; outside the image the border pixels repeat.

    Below scale 2 the patch is sampled bilinearly. From scale 2 on, it would skip pixels and alias thin structures:
    each patch pixel is the mean of the pixels that it covers. From scale 4 on the neighbourhood is first halved by
    2 x 2 means, which bounds the cost.

    Args:
        image: ``(H, W[, C])`` uint8.
        centres: ``(B, 2)`` x, y in pixels, 0-based and continuous.
        scales: ``(B,)`` image pixels per patch pixel.
        width: of a patch.
        height: of a patch.
    """
    # A window far outside the image shows only its border. The clip bounds the size of the margin.
    reach = np.asarray(scales)[:, None] * np.array([width, height]) / 2 + 1
    centres = np.minimum(np.maximum(centres, -reach), np.array([image.shape[1], image.shape[0]]) + reach)
    halvings = max(0, math.floor(math.log2(np.max(scales))) - 1)
    if halvings:
        image, origin = _halved(image, (centres - reach).min(axis=0), (centres + reach).max(axis=0), halvings)
        centres, scales = (centres - origin) / 2**halvings, scales / 2**halvings
    patches = [
        cut_one(image, centre, np.full(2, float(scale)), width, height)
        for centre, scale in zip(centres, scales, strict=True)
    ]
    return np.stack(patches) if len(patches) > 1 else patches[0][None]


def cut_one(image: ImageArray, centre: FloatArray, scale: FloatArray, width: int, height: int) -> ImageArray:
    """``(height, width[, C])`` one patch as of `cut`, without halving.

    Args:
        image: ``(H, W[, C])`` uint8.
        centre: ``(2,)`` x, y in pixels.
        scale: ``(2,)`` image pixels per patch pixel along x and y.
        width: of the patch.
        height: of the patch.
    """
    return (_sample if scale.max() < _AREA_SCALE else _average)(image, centre, scale, width, height)


def _halved(image: ImageArray, low: FloatArray, high: FloatArray, halvings: int) -> tuple[ImageArray, FloatArray]:
    """The part of the image between two corners, ``halvings`` times reduced by two, and its origin ``(2,)``."""
    factor = 2**halvings
    size = np.array([image.shape[1], image.shape[0]])
    # Steps of `factor` keep the averaged pixels the same from frame to frame.
    first = np.clip(np.floor(low / factor).astype(int) - 1, 0, np.maximum(size // factor - 1, 0)) * factor
    last = np.clip((np.ceil(high / factor).astype(int) + 1) * factor, first + 1, size)
    part = image[first[1] : last[1], first[0] : last[0]]
    for _ in range(halvings):
        odd = part.shape[0] % 2, part.shape[1] % 2
        if any(odd):
            part = np.asarray(cv2.copyMakeBorder(part, 0, odd[0], 0, odd[1], cv2.BORDER_REPLICATE), dtype=np.uint8)
        half = part.shape[1] // 2, part.shape[0] // 2
        part = np.asarray(cv2.resize(part, half, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return part, first.astype(np.float64)


def _sample(image: ImageArray, centre: FloatArray, scale: FloatArray, width: int, height: int) -> ImageArray:
    """Bilinear values at a grid of points, ``scale`` ``(2,)`` image pixels apart."""
    (x, y), (along, down) = centre.tolist(), scale.tolist()
    left, top = x - along * (width - 1) / 2 - 0.5, y - down * (height - 1) / 2 - 0.5
    matrix = np.array([[along, 0, left], [0, down, top]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(image, matrix, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE))


def _average(image: ImageArray, centre: FloatArray, scale: FloatArray, width: int, height: int) -> ImageArray:
    """Means over the image pixels under each patch pixel, to whole pixels at the patch's border."""
    reach = scale * np.array([width, height]) / 2
    low = np.round(centre - reach).astype(int)
    high = np.maximum(np.round(centre + reach).astype(int), low + 1)
    size = np.array([image.shape[1], image.shape[0]])
    inner_low = np.clip(low, 0, size - 1)
    inner_high = np.clip(high, inner_low + 1, size)
    inner = image[inner_low[1] : inner_high[1], inner_low[0] : inner_high[0]]
    low_border, high_border = np.maximum(inner_low - low, 0), np.maximum(high - inner_high, 0)
    if low_border.any() or high_border.any():
        margins = low_border[1], high_border[1], low_border[0], high_border[0]
        inner = np.asarray(cv2.copyMakeBorder(inner, *margins, cv2.BORDER_REPLICATE), dtype=np.uint8)
    return np.asarray(cv2.resize(inner, (width, height), interpolation=cv2.INTER_AREA))


@dataclass(frozen=True)
class SizeSample(ScaleSample):
    """Gradients of boxes about one place of one frame.

    Attributes:
        rows: ``(S, D)`` of neighbouring levels.
        first: level of the first row.
    """

    first: int


@dataclass(frozen=True)
class SizeLadder:
    """Levels of size of one target: at level n it is ``step ** n`` times as large as in its first frame.

    Attributes:
        target: ``(2,)`` first width and height, pixels.
        template: ``(2,)`` width and height to which boxes are scaled, pixels, multiples of ``cell``.
        cell: side of a cell, template pixels.
        step: ratio of neighbouring sizes.
        count: levels in a sample, odd.
    """

    target: FloatArray
    template: NDArray[np.int64]
    cell: int
    step: float
    count: int

    def level(self, size: float) -> float:
        """How many steps ``size`` is above the first one."""
        return float(np.log(size) / np.log(self.step))

    def sample(
        self, image: ImageArray, centre: FloatArray, middle: int, previous: SizeSample | None = None
    ) -> SizeSample:
        """The levels about ``middle``; those of ``previous``, at this place of this frame, are not cut again."""
        first = middle - self.count // 2
        if previous is not None and previous.first == first:
            return previous
        width, height = (self.template + 2 * self.cell).tolist()
        pixels = self.target / self.template  # image pixels per template pixel, at the first size
        levels = range(first, first + self.count)
        patches = [cut_one(image, centre, pixels * self.step**level, width, height) for level in levels]
        return SizeSample(hog(np.stack(patches), self.cell).reshape(len(patches), -1), first)
