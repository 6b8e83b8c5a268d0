"""Whether boxes fit the pictures that they are said to lie in: shares, corners and other sizes are recognised."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.types import FloatArray

# Boxes that tell, and the share of them that has to be odd.
ENOUGH, MOST, MANY = 20, 0.9, 0.3
# How far beyond the picture a box is odd, shares of the picture.
BEYOND = 1.05


@dataclass
class BoxCheck:
    """Takes the boxes of a video until there are enough, and says once what does not fit.

    Attributes:
        what: where they come from, for people to read.
        size: width and height of the pictures; None where not known.
    """

    what: str
    size: tuple[int, int] | None = None
    _boxes: list[FloatArray] | None = field(default_factory=list)

    def add(self, boxes: FloatArray) -> None:
        """Take the ``(N, 4)`` boxes of the next frame.

        Raises:
            RequestError: see `tell`.
        """
        if self._boxes is None:
            return
        self._boxes.append(boxes)
        if sum(map(len, self._boxes)) >= ENOUGH:
            self.tell()

    def tell(self) -> None:
        """Warn of boxes that do not fit, where that was not done before.

        Raises:
            RequestError: they are shares of the picture.
        """
        boxes = np.concatenate([np.empty((0, 4)), *(self._boxes or [])])
        self._boxes = None
        if not len(boxes):
            return
        if boxes.max() <= 1 and boxes.min() >= -1:
            width, height = self.size or ("the width", "the height")
            raise RequestError(
                f"{self.what}: expected boxes in pixels, got numbers up to {boxes.max():.3g} that look like shares of "
                f"the picture; multiply x by {width} and y by {height}"
            )
        if self.size is not None and (odd := _odd(boxes, self.size)):
            warnings.warn(f"{self.what}: {odd}", InputWarning, stacklevel=3)


def _odd(boxes: FloatArray, size: tuple[int, int]) -> str | None:
    """What does not fit, in words."""
    picture, shown = np.array(size, dtype=np.float64), f"the {size[0]}x{size[1]} picture"
    beyond = (boxes[:, 2:] > BEYOND * picture).any(axis=1)
    corners = boxes[:, 2:] - boxes[:, :2]
    fits = (corners > boxes[:, :2]).all(axis=1) & (corners <= BEYOND * picture).all(axis=1)
    if beyond.mean() >= MANY and fits.mean() >= MOST:
        return (
            f"{beyond.sum()} of {len(boxes)} boxes reach beyond {shown}, and few would with x2, y2 for width and "
            "height; are they corners?"
        )
    outside = ((boxes[:, 2:] <= 0) | (boxes[:, :2] >= picture)).any(axis=1)
    if outside.mean() >= MOST:
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        return (
            f"{outside.sum()} of {len(boxes)} boxes lie outside {shown}, from {low[0]:.0f},{low[1]:.0f} to "
            f"{high[0]:.0f},{high[1]:.0f}; are they of another video, or of pictures of another size?"
        )
    return None
