"""Video out: WebM with VP8 or VP9, which every browser plays and which OpenCV from pip can write."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Literal

import cv2
import numpy as np

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.types import ImageArray


class VideoWriter:
    """A WebM file, written frame by frame and closed with the ``with`` block.

    Args:
        path: ends in ``.webm``.
        frame_rate: frames per second.
        codec: VP8 is several times faster to write, VP9 about half the size.

    Raises:
        RunError: OpenCV cannot write it.
    """

    def __init__(self, path: Path, frame_rate: float, codec: Literal["VP80", "VP90"] = "VP80") -> None:
        self.path, self.frame_rate, self.codec = path, frame_rate, codec
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)

    def write(self, image: ImageArray) -> None:
        """Append ``image`` ``(H, W, 3)`` uint8 RGB; an odd last row or column is left out."""
        height, width = (side - side % 2 for side in image.shape[:2])
        if self._writer is None:
            self._size = (width, height)
            fourcc = cv2.VideoWriter.fourcc(*self.codec)
            with _silent_stderr():
                self._writer = cv2.VideoWriter(str(self.path), fourcc, self.frame_rate, self._size)
            if not self._writer.isOpened():
                raise RunError(f"{self.path}: OpenCV cannot write WebM video ({self.codec}) on this machine")
        if (width, height) != self._size:
            raise RunError(f"{self.path}: expected frames of {self._size[0]}x{self._size[1]}, got {width}x{height}")
        self._writer.write(cv2.cvtColor(np.ascontiguousarray(image[:height, :width]), cv2.COLOR_RGB2BGR))

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.release()


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """OpenCV prints that the container has no tag for the codec, which WebM needs none for, whatever its log level."""
    sys.stderr.flush()
    before = os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)
        os.close(nothing)
