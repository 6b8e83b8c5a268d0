"""Whether a camera stands still, by the edges in some pictures of its video, people before them included."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Literal, TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

CameraMotion: TypeAlias = Literal["still", "moves", "unknown"]
# Movement between pictures, as a share of the width, from which a camera does not stand still.
_MOVED = 0.01
# Least correlation of the edges of two pictures of one place. Measured: .8 in a street, .3 in a crowd that hides nearly
# all that stands still; below .1 for pictures of noise, whose best shift is besides anywhere.
_SAME_EDGES = 0.15
# Nine of ten places of a picture in which nothing is to be seen have gradients below this (Sobel, 255 grey levels).
_NOTHING = 15.0
_EDGE_WIDTH = 240


def motion_of(pictures: Sequence[ImageArray]) -> tuple[CameraMotion, int | None]:
    """How the camera moves between ``pictures``, each ``(H, W, 3)`` uint8 RGB, in their order.

    The edges of every two are compared. A picture lies where the others do if it agrees with half of them: one that is
    hidden by people does not decide.

    Returns:
        ``still``; ``moves``, where most pictures lie elsewhere; or ``unknown``, where most show nothing. And the number
        of the first picture after a turn, where a camera that stands still looks elsewhere from one picture on.
    """
    edges = [_gradients(picture) for picture in pictures]
    clear = np.flatnonzero([np.percentile(each, 90) >= _NOTHING for each in edges])
    if 2 * len(clear) <= len(pictures) or len(clear) < 2:
        return "unknown", None
    maps = np.stack([_levelled(edges[n]) for n in clear])
    agreeing = np.zeros((len(maps), len(maps)), dtype=np.bool_)
    for first, second in itertools.combinations(range(len(maps)), 2):
        agreeing[first, second] = agreeing[second, first] = _at_one_place(maps[first], maps[second])
    same = 2 * agreeing.sum(axis=1) >= len(maps) - 1
    turned = _turn(same)
    if turned is not None:
        return "moves", int(clear[turned])
    return ("still" if 2 * same.sum() > len(same) else "moves"), None


def _turn(same: BoolArray) -> int | None:
    """The first picture after a turn: those before or after it, two at least, lie elsewhere, and no others do."""
    changes = np.flatnonzero(same[1:] != same[:-1])
    if len(changes) != 1 or min(same.sum(), (~same).sum()) < 2:
        return None
    return int(changes[0]) + 1


def _at_one_place(first: FloatArray, second: FloatArray) -> bool:
    """Whether two maps of edges agree best where they are."""
    agreement = np.fft.irfft2(np.fft.rfft2(first) * np.conj(np.fft.rfft2(second)), first.shape)
    at = np.array(np.unravel_index(int(agreement.argmax()), first.shape))
    shift = np.minimum(at, np.array(first.shape) - at)
    least = _SAME_EDGES * np.sqrt(np.sum(first * first) * np.sum(second * second))
    return bool(agreement.max() > least and np.hypot(*shift) <= _MOVED * _EDGE_WIDTH)


def edge_correlation(first: ImageArray, second: ImageArray) -> float:
    """Correlation of the edges of two pictures of one size, which light changes little; 1 for equal ones."""
    a, b = _levelled(_gradients(first)), _levelled(_gradients(second))
    return float(np.sum(a * b) / max(np.sqrt(np.sum(a * a) * np.sum(b * b)), 1e-9))


def _gradients(image: ImageArray) -> FloatArray:
    """Lengths of the gradients of a small copy."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    scale = _EDGE_WIDTH / grey.shape[1]
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.hypot(cv2.Sobel(small, cv2.CV_64F, 1, 0), cv2.Sobel(small, cv2.CV_64F, 0, 1))


def _levelled(gradients: FloatArray) -> FloatArray:
    """Blurred, with mean 0; strong edges must not outweigh all others."""
    length = np.sqrt(cv2.GaussianBlur(gradients, (0, 0), 1.5))
    return np.asarray(length - length.mean(), dtype=np.float64)
