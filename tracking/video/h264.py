"""H.264 by PyAV, which brings x264, where the user has installed it; OpenCV from pip writes none."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RunError

# Quality of x264 (its default) and, since noise has no bound, the most bits a pixel and as seconds of a burst.
QUALITY, MOST_BITS_A_PIXEL, BURST = 23, 0.15, 2


class X264Writer:
    """An MP4 file, with the calls of `cv2.VideoWriter`; opened where PyAV is installed.

    Args:
        path: of the file.
        frame_rate: frames per second.
        size: width and height, even.
    """

    def __init__(self, path: Path, frame_rate: float, size: tuple[int, int]) -> None:
        self._path = path
        self._container: Any = None
        self._stream: Any = None
        if importlib.util.find_spec("av") is None:
            return
        import av

        try:
            self._container = av.open(str(path), "w")
            self._stream = self._container.add_stream("libx264", Fraction(frame_rate).limit_denominator(1001))
        except (av.FFmpegError, ValueError):
            return
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        most = round(MOST_BITS_A_PIXEL * size[0] * size[1] * frame_rate)
        bounds = {"maxrate": str(most), "bufsize": str(BURST * most)}
        # Of several threads the rate would depend on which is first.
        self._stream.options = {"threads": "1", "preset": "veryfast", "crf": str(QUALITY), **bounds}

    def isOpened(self) -> bool:  # noqa: N802
        """Whether pictures can be written."""
        return self._stream is not None

    def write(self, image: NDArray[np.uint8]) -> None:
        """Append ``image`` ``(H, W, 3)`` BGR."""
        import av

        with self._whole():
            self._container.mux(self._stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))

    def release(self) -> None:
        """Write what is left and close the file."""
        with self._whole():
            self._container.mux(self._stream.encode(None))
            self._container.close()

    @contextmanager
    def _whole(self) -> Iterator[None]:
        import av

        try:
            yield
        except av.FFmpegError as error:
            raise RunError(f"{self._path.name}: the video was not written to its end; is the disk full?") from error
