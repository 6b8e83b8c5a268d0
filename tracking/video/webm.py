"""Video out: WebM (VP8), which every browser plays and OpenCV from pip can write, or MP4.

MP4 has H.264 where OpenCV or an installed PyAV writes it, or else VP9. The same pictures give the same bytes.
"""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.types import ImageArray

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
        self._av: Any = importlib.import_module("av") if importlib.util.find_spec("av") else None
        self._container: Any = None
        self._stream: Any = None
        if self._av is None:
            return
        try:
            self._container = self._av.open(str(path), "w")
            self._stream = self._container.add_stream("libx264", Fraction(frame_rate).limit_denominator(1001))
        except (self._av.FFmpegError, ValueError):
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
        with self._whole():
            self._container.mux(self._stream.encode(self._av.VideoFrame.from_ndarray(image, format="bgr24")))

    def release(self) -> None:
        """Write what is left and close the file."""
        with self._whole():
            self._container.mux(self._stream.encode(None))
            self._container.close()

    @contextmanager
    def _whole(self) -> Iterator[None]:
        try:
            yield
        except self._av.FFmpegError as error:
            raise RunError(f"{self._path.name}: the video was not written to its end; is the disk full?") from error


# VP8 is several times faster to write than VP9, which is about half the size.
WEBM_CODEC = "VP80"
# H.264 plays everywhere, but few builds of OpenCV write it, and PyAV need not be there; browsers also play VP9 in MP4.
MP4_CODECS = ("avc1", "libx264", "vp09")
# Of smaller pictures OpenCV's VP8 makes files that nothing reads.
SMALLEST_SIDE = 16
# EBML identifiers of a track's number, which FFmpeg draws at random: in the header, and in the tags that refer to it.
TRACK_UID = re.compile(rb"(?<=\x73\xc5\x88).{8}|(?<=\x63\xc5\x88).{8}", re.DOTALL)
# The first element of pictures, before which all of the header lies.
CLUSTER = b"\x1f\x43\xb6\x75"
SEGMENT = b"\x18\x53\x80\x67"
HEADER_BYTES = 4096
# OpenCV asks VP8 and VP9 for 64 bits a pixel, far more than any picture has, but for no more than so many a second.
MOST_BITS = 2**30
# So pictures are coded as if they came fast enough to be left this many bits a pixel, of which a quarter is spent; the
# coded ones are then packed again with their own rate.
BITS_A_PIXEL, FASTEST = 0.5, 3_000
CODING = ".coding"


class VideoWriter:
    """A file ``.webm`` or ``.mp4`` of bounded bit rate, written frame by frame and closed with the ``with`` block.

    Raises:
        RunError: OpenCV cannot write it, or the disk is full.
    """

    def __init__(self, path: Path, frame_rate: float) -> None:
        self.path, self.frame_rate = path, frame_rate
        self._codecs = MP4_CODECS if path.suffix.lower() == ".mp4" else (WEBM_CODEC,)
        self._writer: Any = None
        self._size = (0, 0)
        self._written = 0

    def write(self, image: ImageArray) -> None:
        """Append ``image`` ``(H, W, 3)`` uint8 RGB.

        An odd last row or column is left out; the border of a picture below 16 pixels is repeated.
        """
        image = _even(image)
        height, width = image.shape[:2]
        if self._writer is None:
            self._size = (width, height)
            self._writer = self._opened()
        if (width, height) != self._size:
            raise RunError(f"{self.path}: expected frames of {self._size[0]}x{self._size[1]}, got {width}x{height}")
        self._writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        self._written += 1

    def _opened(self) -> Any:
        fast = min(FASTEST, MOST_BITS / (BITS_A_PIXEL * self._size[0] * self._size[1]))
        for codec in self._codecs:
            self._codec, self._fast = codec, codec in (WEBM_CODEC, "vp09")  # H.264 is coded by quality
            rate = max(self.frame_rate, round(fast)) if self._fast else self.frame_rate
            writer = self._writing(self._coding if self._fast else self.path, rate, [])
            if writer.isOpened():
                return writer
        shown = " or ".join(self._codecs)
        kind = self.path.suffix.lower().lstrip(".")
        advice = "; WebM can usually be written" if kind == "mp4" else ""
        raise RunError(
            f"{self.path.name}: OpenCV on this machine cannot write {kind} video ({shown}) of "
            f"{self._size[0]}x{self._size[1]} pixels{advice}"
        )

    @property
    def _coding(self) -> Path:
        return self.path.with_suffix(CODING + self.path.suffix)

    def _writing(self, path: Path, rate: float, options: list[int]) -> Any:
        if self._codec == "libx264":
            return X264Writer(path, rate, self._size)
        with silent_stderr():
            fourcc = cv2.VideoWriter.fourcc(*self._codec)
            return cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, fourcc, rate, self._size, options)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is None:
            return
        self._writer.release()
        try:
            if kind is None and self._fast:
                self._check_complete(self._coding)
                self._pack()
            if kind is None:
                self._check_complete(self.path)
        finally:
            self._coding.unlink(missing_ok=True)
        if kind is None and self.path.suffix.lower() != ".mp4":
            _number_the_track(self.path)

    def _pack(self) -> None:
        """Put the coded pictures into the file, at their own rate."""
        coded = cv2.VideoCapture(str(self._coding), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
        # An interval of 0: each picture says whether it is a key frame.
        options = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1, cv2.VIDEOWRITER_PROP_KEY_INTERVAL, 0]
        packed = self._writing(self.path, self.frame_rate, options)
        try:
            while (read := coded.read())[0]:
                packed.set(cv2.VIDEOWRITER_PROP_KEY_FLAG, coded.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME))
                packed.write(read[1].reshape(1, -1))
        finally:
            coded.release()
            packed.release()

    def _check_complete(self, path: Path) -> None:
        """OpenCV does not say that a write failed; a file that was cut short lacks what is written last."""
        capture = cv2.VideoCapture(str(path))
        try:
            counted = capture.get(cv2.CAP_PROP_FRAME_COUNT) if capture.isOpened() else 0
        finally:
            capture.release()
        short = path.suffix.lower() != ".mp4" and _promised_size(path) != path.stat().st_size
        if short or (path == self.path and abs(counted - self._written) > 1 + 0.02 * self._written):
            raise RunError(f"{self.path.name}: the video was not written to its end; is the disk full?")


def video_type(path: Path) -> str:
    """The media type of a video file, for a page that holds it."""
    return "video/mp4" if path.suffix.lower() == ".mp4" else "video/webm"


def _even(image: ImageArray) -> ImageArray:
    """``image`` with an even number of rows and columns, as the codecs want it."""
    height, width = image.shape[:2]
    if min(height, width) < SMALLEST_SIDE:
        image = np.pad(image, ((0, max(0, SMALLEST_SIDE - height)), (0, max(0, SMALLEST_SIDE - width)), (0, 0)), "edge")
        height, width = image.shape[:2]
    return np.ascontiguousarray(image[: height - height % 2, : width - width % 2])


def _promised_size(path: Path) -> int:
    """Bytes that a WebM file has by its own account: its last element fills the rest."""
    with path.open("rb") as file:
        head = file.read(HEADER_BYTES)
    start = head.find(SEGMENT) + len(SEGMENT)
    # Eight bytes, the first of which says just that.
    return start + 8 + int.from_bytes(head[start + 1 : start + 8], "big")


def _number_the_track(path: Path) -> None:
    """Call the only track number 1, wherever it is named."""
    with path.open("r+b") as file:
        head = file.read(HEADER_BYTES).partition(CLUSTER)[0]
        file.seek(0)
        file.write(TRACK_UID.sub((1).to_bytes(8, "big"), head))


@contextmanager
def silent_stderr() -> Iterator[None]:
    """Nothing is printed, by what is not Python neither.

    OpenCV prints that the container has no tag for the codec, which WebM needs none for, whatever its log level.
    """
    with suppress(OSError, ValueError):
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
