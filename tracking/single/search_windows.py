"""Search windows of correlation filters.

A window is cut from the image at a fixed template size, its features are computed, and they are Fourier transformed.

A filter over sizes sees gradients of boxes on a fixed ladder of sizes (`SizeLadder`). It
looks at a frame twice, to find the size and to learn it. The sizes of both are rungs of one ladder, so what was cut out
for the first is there for the second; how far the target is off a rung goes into what is learnt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.hog import hog
from tsuiseki.tracking.filters.kernelised_correlation import Samples, cosine_window, transform
from tsuiseki.tracking.filters.scale_filter import ScaleSample
from tsuiseki.tracking.types import FloatArray, ImageArray

Float32Array = NDArray[np.float32]
Features = Literal["hog", "grey"]

_AREA_SCALE = 2.0
_SMALLEST_GRID = 4  # cells; fewer leave no room for a shift


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
    before, after = np.maximum(inner_low - low, 0), np.maximum(high - inner_high, 0)
    if before.any() or after.any():
        margins = before[1], after[1], before[0], after[0]
        inner = np.asarray(cv2.copyMakeBorder(inner, *margins, cv2.BORDER_REPLICATE), dtype=np.uint8)
    return np.asarray(cv2.resize(inner, (width, height), interpolation=cv2.INTER_AREA))


@dataclass(frozen=True)
class WindowShape:
    """How a target's surroundings map to a grid of cells, the same for all its frames.

    Attributes:
        rows: of the grid.
        columns: of the grid.
        cell: side of a cell in template pixels.
        scale: image pixels per template pixel when the target has its first size.
        features: ``hog`` (31 channels) or ``grey`` (one channel in [-0.5, 0.5]).
        target_share: side of the target over the side of the window.
    """

    rows: int
    columns: int
    cell: int
    scale: float
    features: Features
    target_share: float

    @cached_property
    def taper(self) -> Float32Array:
        """The cosine window."""
        return cosine_window((self.rows, self.columns))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    def cell_pixels(self, size: float) -> float:
        """Side of a cell in image pixels for a target of relative ``size``."""
        return self.cell * self.scale * size

    def describe(self, image: ImageArray, centres: FloatArray, sizes: FloatArray) -> Samples:
        """Samples of the windows around ``centres`` ``(B, 2)`` for targets of relative ``sizes`` ``(B,)``."""
        features = self.features_at(image, centres, sizes)
        features *= self.taper
        return transform(features)

    def features_at(self, image: ImageArray, centres: FloatArray, sizes: FloatArray) -> Float32Array:
        """``(B, C, rows, columns)`` features of the windows, without the cosine window."""
        border = 2 if self.features == "hog" else 0  # the outermost cells only normalise
        width, height = (self.columns + border) * self.cell, (self.rows + border) * self.cell
        patches = cut(image, centres, self.scale * np.asarray(sizes), width, height)
        return hog(patches, self.cell) if self.features == "hog" else _grey(patches, self.cell)

    def describe_around(
        self, image: ImageArray, centre: FloatArray, size: float, reach: int
    ) -> tuple[Samples, FloatArray]:
        """Samples of overlapping windows on a grid about ``centre``, described once where they overlap.

        Args:
            image: ``(H, W, C)`` uint8.
            centre: ``(2,)`` of the middle window, pixels.
            size: relative size of the target.
            reach: windows to each side; 1 gives 3 x 3. They stand a target's side apart.

        Returns:
            The windows, the middle one first, and their centres ``((2 reach + 1)^2, 2)``.
        """
        step = np.maximum(np.round(np.array([self.columns, self.rows]) * self.target_share).astype(int), 1)
        columns, rows = np.array([self.columns, self.rows]) + 2 * reach * step
        large = WindowShape(int(rows), int(columns), self.cell, self.scale, self.features, self.target_share)
        everything = large.features_at(image, centre[None], np.array([size]))[0]
        offsets = np.arange(-reach, reach + 1)
        grid = np.array([(x, y) for y in offsets for x in offsets])
        grid = grid[np.argsort((grid**2).sum(axis=1), kind="stable")]
        corners = (grid + reach) * step
        windows = np.stack([everything[:, y : y + self.rows, x : x + self.columns] for x, y in corners])
        return transform(windows * self.taper), centre + grid * step * self.cell_pixels(size)


def _grey(patches: ImageArray, cell: int) -> Float32Array:
    """``(B, 1, H/cell, W/cell)`` brightness in [-0.5, 0.5]."""
    planes = [cv2.cvtColor(patch, cv2.COLOR_RGB2GRAY) if patch.ndim == 3 else patch for patch in patches]
    grey = np.stack(planes).astype(np.float32) / 255 - 0.5
    count, height, width = grey.shape
    means = grey.reshape(count, 1, height // cell, cell, width // cell, cell).mean(axis=(3, 5), dtype=np.float32)
    return np.asarray(means)


def window_shape(
    width: float, height: float, padding: float, longest: int, cell: int, features: Features = "hog"
) -> WindowShape:
    """The window of a target of ``width`` x ``height`` pixels.

    The window is ``padding`` times the target. Its longer side is ``longest`` template pixels for every target,
    which keeps the cost constant. Both sides are an even number of cells.
    """
    scale = padding * max(width, height) / longest
    rows, columns = (max(_SMALLEST_GRID, 2 * round(padding * side / (2 * cell * scale))) for side in (height, width))
    return WindowShape(rows, columns, cell, scale, features, 1 / padding)


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

    def sizes(self, first: int) -> FloatArray:
        """``(S,)`` relative sizes of a sample."""
        return np.asarray(self.step ** (first + np.arange(self.count, dtype=np.float64)))

    def sample(self, image: ImageArray, centre: FloatArray, middle: int, seen: SizeSample | None = None) -> SizeSample:
        """The levels about ``middle``; those already ``seen`` at this place of this frame are not cut out again."""
        first = middle - self.count // 2
        old = range(0) if seen is None else range(max(first, seen.first), min(first, seen.first) + self.count)
        levels = [level for level in range(first, first + self.count) if level not in old]
        if seen is not None and not levels:
            return seen
        width, height = (self.template + 2 * self.cell).tolist()
        pixels = self.target / self.template  # image pixels per template pixel, at the first size
        patches = [cut_one(image, centre, pixels * self.step**level, width, height) for level in levels]
        rows = hog(np.stack(patches), self.cell).reshape(len(patches), -1)
        if seen is None or not len(old):
            return SizeSample(rows, first)
        kept = seen.rows[old.start - seen.first : old.stop - seen.first]
        return SizeSample(np.concatenate([kept, rows] if levels[0] > first else [rows, kept]), first)
