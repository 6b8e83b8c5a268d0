"""Trackers that climb: mean shift, CamShift, median flow; thesis 2.2.2. The climbing itself is OpenCV's."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError, lacks_memory
from tsuiseki.tracking.single.tracker import TargetState
from tsuiseki.tracking.types import FloatArray, ImageArray

# Bins of a histogram of hues.
HUES = 30
# Of 255: paler pixels have no hue worth the name.
LEAST_SATURATION = 40
# Of 255: darker pixels have no hue worth the name.
LEAST_VALUE = 32
# Mean shift ends after 20 steps, or when a step is below half a pixel.
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.5)
# Bhattacharyya coefficient under which mean shift has lost the target.
SAME_COLOURS = 0.5
# Of median flow: points along each side of the box.
SIDE = 10
# Of median flow: share of the points that are left under which the target is lost.
LEAST_LEFT = 0.1
# Of median flow: greatest median error of points tracked there and back, pixels.
MOST_FORWARD_BACKWARD = 2.0


class MeanShift:
    """The mode of the back-projected hue histogram; the score is the Bhattacharyya coefficient (2.4).

    Comaniciu et al., "Real-time tracking of non-rigid objects using mean shift", CVPR 2000; with ``adapts_size`` the
    box grows and shrinks with the mass under it: CamShift, Bradski, 1998.
    """

    def __init__(self, adapts_size: bool = False) -> None:
        self.adapts_size = adapts_size

    def start(self, image: ImageArray, box: FloatArray) -> None:
        self._box = np.asarray(box, dtype=np.float64)
        self._window: Sequence[int] = _whole_window(self._box, image)
        self._histogram = self._hues(image, self._window)
        self._scaled = self._histogram * np.float32(255 / max(float(self._histogram.max()), 1e-9))

    def follow(self, image: ImageArray) -> TargetState:
        colours = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
        likely = cv2.calcBackProject([colours], [0], self._scaled, [0, 180], 1)
        likely = cv2.bitwise_and(likely, _coloured(colours))
        if self.adapts_size:
            rotated, window = cv2.CamShift(likely, self._window, STOP)
            if min(window[2:]) >= 2 and min(rotated[1]) > 0:
                self._window = window
                self._box = _upright_hull(rotated)
        else:
            _, window = cv2.meanShift(likely, self._window, STOP)
            self._box = self._box + np.tile(np.subtract(window[:2], self._window[:2]), 2)
            self._window = window
        score = float(np.sqrt(self._hues(image, self._window) * self._histogram).sum())
        return TargetState(self._box, score, "tracking" if score >= SAME_COLOURS else "lost")

    def _hues(self, image: ImageArray, window: Sequence[int]) -> NDArray[np.float32]:
        """``(30, 1)`` histogram of the clearly coloured pixels, that sums to one; grey windows have their values."""
        x, y, w, h = window
        colours = cv2.cvtColor(np.ascontiguousarray(image[y : y + h, x : x + w]), cv2.COLOR_RGB2HSV)
        mask = _coloured(colours)
        histogram = cv2.calcHist([colours], [0], mask if mask.any() else None, [HUES], [0, 180])
        return np.asarray(histogram / max(float(histogram.sum()), 1.0))


def _coloured(hues: NDArray[Any]) -> NDArray[np.uint8]:
    """255 where a pixel of an HSV image has a hue worth the name."""
    return np.asarray(cv2.inRange(hues, (0, LEAST_SATURATION, LEAST_VALUE), (180, 255, 255)), dtype=np.uint8)


def _upright_hull(ellipse: tuple[Sequence[float], Sequence[float], float]) -> FloatArray:
    """``(4,)`` hull of the rectangle that has the moments of CamShift's ellipse (centre, axes, degrees).

    OpenCV's axes are four standard deviations of the mass, and a rectangle's sides are the root of twelve.
    """
    (x, y), axes, angle = ellipse
    corners = cv2.boxPoints(((x, y), (axes[0] * np.sqrt(12) / 4, axes[1] * np.sqrt(12) / 4), angle))
    return np.concatenate([corners.min(axis=0), corners.max(axis=0)]).astype(np.float64)


def _whole_window(box: FloatArray, image: ImageArray) -> tuple[int, int, int, int]:
    """The part of a box inside the image as x, y, width, height in whole pixels, at least 2 x 2."""
    height, width = image.shape[:2]
    x1, y1, x2, y2 = np.round(box).astype(int).tolist()
    x1, y1 = min(max(x1, 0), width - 2), min(max(y1, 0), height - 2)
    return x1, y1, max(min(x2, width) - x1, 2), max(min(y2, height) - y1, 2)


class MedianFlow:
    """Points tracked by Lucas and Kanade move the box by their median and stretch it by the median of their distances.

    Kalal et al., "Forward-backward error: automatic detection of tracking failures", ICPR 2010. Points that do not come
    back when tracked backwards, and the half that moves least like the image around it, are left out. The score is the
    share of points that are left.
    """

    def start(self, image: ImageArray, box: FloatArray) -> None:
        self._box = np.asarray(box, dtype=np.float64)
        self._grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)

    def follow(self, image: ImageArray) -> TargetState:
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        points = self._points()
        moved, there = _flow(self._grey, grey, points)
        back, again = _flow(grey, self._grey, moved)
        error = np.linalg.norm(back - points, axis=2).ravel()
        good = (there.ravel() == 1) & (again.ravel() == 1)
        if good.any():
            good &= error <= max(float(np.median(error[good])), 1e-9)
        self._grey = grey
        score = 2 * float(good.mean())
        reliable = good.any() and float(np.median(error[good])) <= MOST_FORWARD_BACKWARD
        if not reliable or score < LEAST_LEFT:
            return TargetState(self._box, 0.0 if not reliable else score, "lost")
        self._move(points[good, 0].astype(np.float64), moved[good, 0].astype(np.float64))
        return TargetState(self._box, min(score, 1.0), "tracking")

    def _points(self) -> NDArray[np.float32]:
        share = (np.arange(SIDE) + 0.5) / SIDE
        x, y = np.meshgrid(share, share)
        size = self._box[2:] - self._box[:2]
        points = self._box[:2] + np.column_stack([x.ravel(), y.ravel()]) * size
        return points[:, None].astype(np.float32)

    def _move(self, old_points: FloatArray, new_points: FloatArray) -> None:
        shift = np.median(new_points - old_points, axis=0)
        first, second = np.triu_indices(len(old_points), 1)
        old = np.linalg.norm(old_points[first] - old_points[second], axis=1)
        new = np.linalg.norm(new_points[first] - new_points[second], axis=1)
        growth = float(np.median(new[old > 0] / old[old > 0])) if (old > 0).any() else 1.0
        centre, half = (self._box[:2] + self._box[2:]) / 2 + shift, (self._box[2:] - self._box[:2]) / 2
        half = np.maximum(half * np.clip(growth, 0.8, 1.25), 1.0)
        self._box = np.concatenate([centre - half, centre + half])


def _flow(old: NDArray[Any], new: NDArray[Any], points: NDArray[np.float32]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Where points ``(N, 1, 2)`` went, and which of them ``(N, 1)`` were found."""
    guess = points.copy()  # not used, but OpenCV's types ask for it
    moved, status, _ = cv2.calcOpticalFlowPyrLK(old, new, points, guess, winSize=(11, 11), maxLevel=4)
    return np.asarray(moved), np.asarray(status)


# Pixels of a box in which OpenCV finds features.
_MIL_AREA = 36


class Mil:
    """OpenCV's tracker by multiple instance learning, Babenko et al., CVPR 2009. It gives no score, so it is 1.

    Args:
        seed: of the features and of the windows that it draws.
    """

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        _seed_opencv(self._rng)
        self._tracker = cv2.TrackerMIL.create()
        self._box = np.asarray(box, dtype=np.float64)
        window = _whole_window(self._box, image)
        if window[2] * window[3] < _MIL_AREA:
            # OpenCV tries features that fit into the box until it has some.
            raise RequestError(
                f"`box`: expected at least {_MIL_AREA} pixels of it in the image, which MIL needs, got "
                f"{window[2]} x {window[3]}; choose another method"
            )
        try:
            self._tracker.init(np.ascontiguousarray(image[..., ::-1]), window)
        except cv2.error as error:
            raise RequestError(
                f"`box`: expected a box with room around it, which MIL needs in an image of {image.shape[1]}x"
                f"{image.shape[0]}, got {', '.join(f'{v:g}' for v in self._box)}; choose another method"
            ) from error

    def follow(self, image: ImageArray) -> TargetState:
        _seed_opencv(self._rng)
        try:
            tracked, (x, y, w, h) = self._tracker.update(np.ascontiguousarray(image[..., ::-1]))
        except cv2.error as error:  # no window of the size of the box near where it was
            if lacks_memory(error):
                raise
            return TargetState(self._box, 0.0, "lost")
        if tracked and w > 0 and h > 0:
            self._box = np.array([x, y, x + w, y + h], dtype=np.float64)
        return TargetState(self._box, float(tracked), "tracking" if tracked else "lost")


def _seed_opencv(rng: np.random.Generator) -> None:
    """OpenCV draws from a generator of its own and from the C library's, both of the whole process."""
    cv2.setRNGSeed(int(rng.integers(2**31)))
    library = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
    library.srand(int(rng.integers(2**31)))
