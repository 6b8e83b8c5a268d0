"""Detectors and appearance models that are any function.

* A detector is a function from an image, ``(H, W, 3)`` uint8 RGB, to what `as_detections` understands.
* An appearance model is a function from crops, a list of ``(h, w, 3)`` uint8 RGB images of any size, to one row of
  numbers each, ``(N, D)``. Rows are brought to unit length; a row of zeros says that nothing is known.

Exported networks, of this toolkit or of others, are read from their files (`open_detector`, `open_appearance`);
whatever has a ``detect`` or ``describe`` of its own (`Detector`, `Appearance`) is used as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.networks.exported import Describe, Detect, open_appearance, open_detector
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray

DetectorLike: TypeAlias = str | Path | Detect | Callable[[ImageArray], DetectionsLike]
AppearanceLike: TypeAlias = str | Path | Describe | Callable[[Sequence[ImageArray]], ArrayLike]

BLANK = np.zeros((128, 64, 3), dtype=np.uint8)


def as_detector(given: DetectorLike, score_threshold: float = 0.3, threads: int = 0) -> Detect:
    """What finds people in images.

    Args:
        given: an exported network's file, a `Detector`, or a function; see the module.
        score_threshold: of a detector that is read from a file, in [0, 1].
        threads: CPU threads of a network that is read from a file; 0 takes all cores.

    Raises:
        RequestError: it is none of them, or the file is no detector.
    """
    if isinstance(given, str | Path):
        return open_detector(given, score_threshold, threads=threads)
    if hasattr(given, "detect"):
        return given
    if callable(given):
        return FunctionDetector(given)
    raise RequestError(
        f"expected the detector as a file, a Detector, or a function from an image to boxes, got {_type(given)}"
    )


def as_describer(given: AppearanceLike, threads: int = 0) -> Describe:
    """What describes how people look.

    Args:
        given: an exported network's file, an `Appearance`, or a function; see the module.
        threads: CPU threads of a network that is read from a file; 0 takes all cores.

    Raises:
        RequestError: it is none of them, or the file is no appearance network.
    """
    if isinstance(given, str | Path):
        return open_appearance(given, threads)
    if hasattr(given, "describe"):
        return given
    if callable(given):
        return FunctionAppearance(given)
    raise RequestError(
        f"expected the appearance as a file, an Appearance, or a function from crops to rows, got {_type(given)}"
    )


class FunctionDetector:
    """A detector that is a function."""

    def __init__(self, function: Callable[[ImageArray], DetectionsLike]) -> None:
        self.function = function

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """One `Detections` an image; see `Detect`.

        Raises:
            RequestError: the function returned something else than detections.
        """
        found = []
        for image in images:
            result = self.function(image)
            try:
                found.append(as_detections(result))
            except RequestError as error:
                raise RequestError(f"what the detector {_name(self.function)} returned: {error}") from error
        return found


class FunctionAppearance:
    """An appearance model that is a function."""

    def __init__(self, function: Callable[[Sequence[ImageArray]], ArrayLike]) -> None:
        self.function = function
        self._length = 0

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N, D)`` unit-length features; NaN for a box outside the image or a row of zeros. See `Describe`.

        Raises:
            RequestError: the function returned something else than one row a crop, or rows of another length.
        """
        height, width = image.shape[:2]
        corners = np.clip(np.round(boxes), 0, [width, height, width, height]).astype(np.int64)
        inside = (corners[:, 2:] > corners[:, :2]).all(axis=1)
        crops = [image[y1:y2, x1:x2] for x1, y1, x2, y2 in corners[inside]]
        if len(boxes) and not crops and not self._length:
            self._rows([BLANK])  # How long a row is must be known where there is nothing to describe.
        rows = self._rows(crops) if crops else np.empty((0, self._length))
        length = np.linalg.norm(rows, axis=1, keepdims=True)
        features = np.full((len(boxes), self._length), np.nan)
        features[inside] = rows / np.where(length > 0, length, np.nan)
        return features

    def _rows(self, crops: list[ImageArray]) -> FloatArray:
        result: Any = self.function(crops)
        for step in ("detach", "cpu"):
            result = getattr(result, step)() if hasattr(result, step) else result
        expected = f"expected the appearance {_name(self.function)} to return {len(crops)} rows of numbers, one a crop"
        try:
            rows = np.asarray(result, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise RequestError(f"{expected}, got {_type(result)}") from error
        if rows.ndim != 2 or len(rows) != len(crops) or not rows.shape[1]:
            raise RequestError(f"{expected}, got an array of shape {rows.shape}")
        if not np.isfinite(rows).all():
            raise RequestError(f"{expected}, got NaN or infinity")
        if self._length not in (0, rows.shape[1]):
            raise RequestError(f"{expected}, each {self._length} long as before, got {rows.shape[1]}")
        self._length = rows.shape[1]
        return rows


def _name(function: object) -> str:
    return getattr(function, "__name__", type(function).__name__)


def _type(value: object) -> str:
    return type(value).__name__
