"""What one target looks like at several sizes: gradients of boxes on a fixed ladder of sizes.

A filter over sizes looks at a frame twice, to find the size and to learn it. The sizes of both are rungs of one ladder,
so what was cut out for the first is there for the second; how far the target is off a rung goes into what is learnt.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.hog import hog
from tsuiseki.tracking.filters.correlation.scale_filter import ScaleSample
from tsuiseki.tracking.single.search_windows import cut_one
from tsuiseki.tracking.types import FloatArray, ImageArray


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
