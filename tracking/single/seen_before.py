"""Whether a box shows what stood there before the target came: then the filter has slid onto the background.

A correlation filter that slides onto the background learns it and stays sure of itself. What it has slid onto, though,
was mostly in view before, where the target was not. So what the box shows is looked for in earlier frames about the
same place, leaving out where the target was then. This works for a target of any kind, and nothing is trained. Where
the camera has moved by more than the box in between, or the background was hidden or in another light, it says nothing.
"""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np

from tsuiseki.tracking.types import FloatArray, ImageArray

_LEAST = 5  # pixels of the smaller picture, in each direction

ALIKE, SCREEN = 0.9, 0.7
"""Normalised correlation of colours from which on it is the same, in [-1, 1]; and that of pictures of half the size
from which on those of full size are compared."""
EVERY = 3
"""Frames between two looks."""
BACK: tuple[int, ...] = (2, 3, 7, 13)
TURNS = 2
"""How many looks before the present one the frames are that are compared. Looks that find the background are not
counted. So many looks share these frames in turn; one after a look that has found the background compares with all."""
REACH, OVERLAP = 1.0, 0.1
"""How far around the box it looks there, in sides of the box; share of the box up to which a place may overlap the
target's box of that frame."""
SIDE = 28.0
"""Pixels to which the geometric mean of the box's sides is reduced, where it is larger."""


class SeenBefore:
    """Remembers frames of one video, and where the target was in them."""

    def __init__(self) -> None:
        self._before: deque[tuple[ImageArray, FloatArray]] = deque(maxlen=max(BACK))
        self._looks, self._found = 0, False

    def look(self, image: ImageArray, box: FloatArray) -> bool:
        """Take a frame ``(H, W, 3)`` with the box ``(4,)`` of the target; whether it shows what stood there before."""
        self._looks += 1
        turn = slice(None) if self._found else slice(self._looks % TURNS, None, TURNS)
        seen = [self._before[-back] for back in BACK[turn] if back <= len(self._before)]
        scale = min(SIDE / float(np.sqrt((box[2:] - box[:2]).prod())), 1.0)
        shown, _ = _cut(image, box, scale)
        self._found = any(self._likeness(shown, box, scale, *earlier) >= ALIKE for earlier in seen)
        if not self._found:  # else the frames from before the target was lost would be forgotten
            self._before.append((image, box))
        return self._found

    def forget(self) -> None:
        """The box has jumped: where it was before may not have been the target's place."""
        self._before.clear()
        self._found = False

    def _likeness(
        self, shown: ImageArray, box: FloatArray, scale: float, earlier: ImageArray, was: FloatArray
    ) -> float:
        """Greatest correlation of what the box shows with an earlier frame, away from where the target ``was``.

        Where pictures of half the size are not alike (`SCREEN`) it is theirs.
        """
        reach = np.concatenate([box[:2] - box[2:], box[2:] - box[:2]]) * REACH
        around, corner = _cut(earlier, box + reach, scale)
        if min(shown.shape[:2]) < _LEAST or (np.array(around.shape[:2]) <= shown.shape[:2]).any():
            return -1.0
        if min(shown.shape[:2]) >= 2 * _LEAST:
            likeness = self._away(_halved(shown), _halved(around), box, corner, scale / 2, was)
            if likeness < SCREEN:
                return likeness
        return self._away(shown, around, box, corner, scale, was)

    def _away(
        self, shown: ImageArray, around: ImageArray, box: FloatArray, corner: FloatArray, scale: float, was: FloatArray
    ) -> float:
        """Greatest correlation of ``shown`` in ``around``, whose first pixel is at ``corner``, away from ``was``."""
        sides = box[2:] - box[:2]
        likeness = cv2.matchTemplate(around, shown, cv2.TM_CCOEFF_NORMED)
        left, top = (corner[axis] + np.arange(likeness.shape[1 - axis]) / scale for axis in (0, 1))
        wide = np.clip(np.minimum(left + sides[0], was[2]) - np.maximum(left, was[0]), 0, None)
        high = np.clip(np.minimum(top + sides[1], was[3]) - np.maximum(top, was[1]), 0, None)
        away = np.outer(high, wide) <= OVERLAP * sides.prod()
        return float(likeness[away].max(initial=-1.0))


def _halved(image: ImageArray) -> ImageArray:
    """Means of 2 x 2 pixels."""
    return np.asarray(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)


def _cut(image: ImageArray, box: FloatArray, scale: float) -> tuple[ImageArray, FloatArray]:
    """What an image shows of a box, reduced by ``scale``, and its upper left corner ``(2,)`` in the image."""
    high, wide = image.shape[:2]
    x1, y1, x2, y2 = np.clip(np.round(box), 0, [wide, high, wide, high]).astype(int).tolist()
    part = image[y1:y2, x1:x2]
    corner = np.array([x1, y1], dtype=np.float64)
    if scale == 1 or min(part.shape[:2]) * scale < 1:
        return part, corner
    return np.asarray(cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8), corner
