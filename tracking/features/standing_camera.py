"""Whether a camera stands still from frame to frame, by small grey copies of its pictures.

Boxes alone cannot tell people who walk together from a camera that turns; a picture can, since most of what it shows
stands still. A frame r is compared with one d a few frames later. Where a change of light and a motion of less than a
pixel explain the difference,

    d(x) = g r(x) + o − ∇r(x)·δ(x),   δ(x) = t + z x + w (−y, x),

with x from the middle, g, o, the shift t, the zoom z and the roll w follow by least squares over the pixels with a
gradient, those that something passes counting less and less (Cauchy weights, iterated). The camera stands still if δ is
small at all corners and if in most parts of the picture most of these pixels hardly differ once the light is taken out:
by then a larger motion, for which the equation does not hold, is out of the question. What moves by less than `_STILL`
of a copy's pixels in `patience` frames is taken to stand still.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from tsuiseki.tracking.features.camera_path import FrameRuns
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

# Width of the copies, pixels.
_WIDTH = 160
# Pixels of a copy by which a corner of a camera that stands still seems to move at most.
_STILL = 0.25
# Gradient from which a place is compared, grey levels a pixel.
_GRADIENT = 4.0
# How many such places are enough.
_PLACES = 100
# How many of them are compared, about.
_MOST_PLACES = 4000
# Half of the places differ by less than this part of their gradient, which a shift of as many pixels would bring.
_DIFFERENCE = 0.35
# Parts of the picture, down and across.
_PARTS = (3, 4)
# Parts that must have enough places: a caption has some alone.
_LEAST_PARTS = 4
# Places of a part that are enough.
_PLACES_OF_PART = 10
# Grey levels: noise of a copy below which no difference counts.
_NOISE = 1.5
# Rounds of the reweighted least squares.
_ROUNDS = 4


@dataclass
class StandingCamera:
    """Tells for each frame whether the camera is where it was in the frame before.

    After a movement it stands still once `settled` frames in a row show what the frame after the movement does: a slow
    turn does not.

    Attributes:
        patience: frames after which another frame is what the next ones are compared with.
        settled: see above; more than a frame, and no more than the patience.
        moved: frames, the first among them, for which nothing says that the camera stood still.
        comparisons: ``(F,)`` by frame, the results of earlier ones, so that pictures need none; None compares them.
        compared: frame that the next one is compared with.
    """

    patience: int = 10
    settled: int = 5
    moved: FrameRuns = field(default_factory=FrameRuns)
    comparisons: BoolArray | None = None
    compared: int = 0
    _count: int = 0
    _moving: bool = False
    _reference: _Compared | None = None

    def __len__(self) -> int:
        """Frames so far."""
        return self._count

    def add(self, image: ImageArray) -> bool:
        """Take the next frame ``(H, W, 3)`` uint8; whether it shows what the frame ``compared`` does."""
        if self.comparisons is not None:
            same = bool(self.comparisons[self._count])
            self.take(same)
            return same
        height = max(round(image.shape[0] * _WIDTH / image.shape[1]), 2)
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        copy = cv2.resize(grey, (_WIDTH, height), interpolation=cv2.INTER_AREA).astype(np.float64)
        reference = self._reference
        same = reference is not None and reference.shape == copy.shape and reference.stands_still_in(copy)
        if self.take(same):
            self._reference = _Compared(copy)
        return same

    def take(self, same: bool) -> bool:
        """Go on by whether the next frame shows what ``compared`` does; whether it is compared with from now on."""
        since = self._count - self.compared
        self._moving = (self._count > 0 and not same) or (self._moving and since < self.settled)
        if not same or self._moving:
            self.moved.append(self._count)
        anew = not same or since >= self.patience
        if anew:
            self.compared = self._count
        self._count += 1
        return anew

    def stands_still(self, frame: int) -> bool:
        """Whether pictures say so of the step into a frame; False for frames that did not come."""
        return 0 <= frame < self._count and frame not in self.moved


class _Compared:
    """A grey picture ``(H, W)`` that others are compared with: its places and the equation at them."""

    def __init__(self, picture: FloatArray) -> None:
        self.shape = picture.shape
        down, across = np.gradient(picture)
        length = np.hypot(across, down)
        y, x = np.nonzero(length > _GRADIENT)
        self.enough = len(y) >= _PLACES
        step = max(-(-len(y) // _MOST_PLACES), 1)
        self.y, self.x = y, x = y[::step], x[::step]
        g_y, g_x, length = np.stack([down, across, length])[:, y, x]
        high, wide = picture.shape
        v, u = y - (high - 1) / 2, x - (wide - 1) / 2
        self.design = np.stack([picture[y, x], np.ones(len(y)), -g_x, -g_y, -(g_x * u + g_y * v), g_x * v - g_y * u])
        self.least = np.maximum(_DIFFERENCE * length, 2 * _NOISE)
        self.part = y * _PARTS[0] // high * _PARTS[1] + x * _PARTS[1] // wide
        self.places = np.bincount(self.part, minlength=_PARTS[0] * _PARTS[1])

    def stands_still_in(self, picture: FloatArray) -> bool:
        """Whether a picture of the same size shows most of what this one shows at the same place."""
        if not self.enough:
            return False
        values, design = picture[self.y, self.x], self.design
        weight, middle = np.ones(len(values)), [(len(values) - 1) // 2, len(values) // 2]
        for _ in range(_ROUNDS):
            weighted = design * weight
            solved = _solved(weighted @ design.T, weighted @ values)
            off = values - solved @ design
            scale = max(1.5 * float(np.partition(np.abs(off), middle)[middle].mean()), _NOISE)
            weight = 1 / (1 + np.square(off / scale))
        differs = np.abs(values - solved[:2] @ design[:2])
        agreeing = np.bincount(self.part, differs < self.least, len(self.places))
        enough = self.places >= _PLACES_OF_PART
        mostly_alike = (
            2 * np.count_nonzero(2 * agreeing[enough] > self.places[enough]) > np.count_nonzero(enough) >= _LEAST_PARTS
        )
        return bool(mostly_alike and _at_corners(solved[2:], *self.shape) < _STILL)


def _solved(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """``(6,)`` the solution of normal equations, the shortest one where there are several."""
    try:
        return np.asarray(np.linalg.solve(matrix, values), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, values, rcond=None)[0])


def _at_corners(motion: FloatArray, high: int, wide: int) -> float:
    """How far the corner that moves most does, pixels; ``motion`` is t, z and w."""
    v, u = np.array([-0.5, -0.5, 0.5, 0.5]) * high, np.array([-0.5, 0.5, -0.5, 0.5]) * wide
    t_x, t_y, zoom, roll = motion.tolist()
    return float(np.hypot(t_x + zoom * u - roll * v, t_y + zoom * v + roll * u).max())
