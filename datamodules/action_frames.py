"""The frames of labelled video by number, from images or from a video file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from tsuiseki.datamodules.identity_crops import read_image
from tsuiseki.datamodules.readers.acting import ActionSequence
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.drone_action import VIDEO_SUFFIXES
from tsuiseki.tracking.types import ImageArray

# (H, W, 3) uint8 RGB of a 0-based frame number; numbers are asked for in rising order.
ReadFrame: TypeAlias = Callable[[int], ImageArray]


def frame_reader(sequence: ActionSequence) -> ReadFrame:
    """What reads the frames of ``sequence``; it raises RequestError where one cannot be read."""
    files = sequence.files
    if len(files) == 1 and files[0].suffix.lower() in VIDEO_SUFFIXES:
        return ForwardVideo(files[0])
    return lambda number: read_image(files[number])


class ForwardVideo:
    """Frames of a video file, asked for in rising order; what lies between is passed over.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._capture = cv2.VideoCapture(str(path))
        self._next = 0

    def __call__(self, number: int) -> ImageArray:
        """``(H, W, 3)`` uint8 RGB of the frame ``number``.

        Raises:
            RequestError: the video ends before, or cannot be decoded there.
            ValueError: the frame lies before the last one.
        """
        if number < self._next:
            raise ValueError(f"expected frames in rising order, got {number} after {self._next - 1}")
        while self._next <= number:
            if not self._capture.grab():
                raise RequestError(
                    f"{self.path}: expected a video of at least {number + 1} frames, got {self._next}; "
                    "are its labels those of another video?"
                )
            self._next += 1
        decoded, image = self._capture.retrieve()
        if not decoded:
            raise RequestError(f"{self.path}: frame {number + 1} cannot be decoded")
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
