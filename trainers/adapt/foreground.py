"""Where the kept pictures of a fixed camera differ from its empty view (background subtraction), found once a picture.

Every round labels the same pictures, so what was found is kept beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray
from tsuiseki.trainers.adapt.silhouettes import difference, edge_offsets, told_from_shadow
from tsuiseki.trainers.adapt.watch import Watched, plain_view

_SAME, _SHADOW, _BRIGHT = 0, 1, 2


@dataclass(frozen=True)
class Difference:
    """A picture, as it differs from the empty view.

    Attributes:
        different: ``(H, W)`` pixels that differ.
        bright: those of them that are no shadow.
    """

    different: BoolArray
    bright: BoolArray

    def offsets(self, boxes: FloatArray) -> FloatArray:
        """``(N, 4)`` by how much boxes ``(N, 4)`` lie off silhouettes, see `edge_offsets`.

        NaN also where clothes look like a shadow.
        """
        told = told_from_shadow(self.different, self.bright, boxes)
        return np.where(told[:, None], edge_offsets(self.bright, boxes), np.nan)


@dataclass(frozen=True)
class Foreground:
    """What of a video's kept pictures is not its empty view.

    Attributes:
        watched: the video.
        empty: ``(H, W, 3)`` uint8 RGB, its view without people.
    """

    watched: Watched
    empty: ImageArray

    def picture(self, number: int) -> Difference:
        """Of the kept picture ``number``, 0-based."""
        file = Path(self.watched.folder) / "foreground" / f"{number + 1:06d}.png"
        levels = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) if file.is_file() else None
        if levels is None:
            levels = self._levels(number)
            _write(levels, file)
        return Difference(np.asarray(levels != _SAME), np.asarray(levels == _BRIGHT))

    def _levels(self, number: int) -> np.ndarray:
        different, bright = difference(self.watched.picture(number), self.empty)
        return np.where(bright, _BRIGHT, np.where(different, _SHADOW, _SAME)).astype(np.uint8)


def foreground_of(watched: Watched) -> Foreground:
    """What of the kept pictures of a fixed camera is not its empty view."""
    return Foreground(watched, plain_view(watched))


def _write(levels: np.ndarray, file: Path) -> None:
    """Whole or not at all: a run that is stopped must not leave half a picture."""
    _, content = cv2.imencode(".png", levels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    with whole_file(file) as picture:
        picture.write(content.tobytes())
