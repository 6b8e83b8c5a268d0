"""How likely a colour is the target's and not its surroundings': two histograms."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray, ImageArray

LEVELS = 16  # of red, green and blue each
_BITS = 4  # 256 / LEVELS values of a channel are one level
_RARE = 1e-4  # a colour that was never seen counts as neither


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
    def table(self) -> NDArray[np.float32]:
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
