"""Video out, by PyAV: WebM (VP8) or MP4 (H.264), which browsers play. The same pictures give the same bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import ImageArray


@dataclass(frozen=True)
class Encoder:
    """How a codec is asked for pictures of a quality that is not seen to be less, with one pass over them.

    Attributes:
        name: in FFmpeg.
        bits: a pixel at most on average, for noise has no bound.
        options: of the encoder.
    """

    name: str
    bits: float
    options: Mapping[str, str]


# A positive speed of VP8 would follow the clock, and two files of the same pictures would differ.
VP8 = Encoder("libvpx", 0.125, {"deadline": "realtime", "cpu-used": "-8", "crf": "10", "lag-in-frames": "0"})
# The fastest of VP9: it stands in where H.264 is not there.
VP9 = Encoder("libvpx-vp9", 0.125, {"deadline": "realtime", "cpu-used": "8", "crf": "30", "lag-in-frames": "0"})
# With frames between two others x264 reads memory that it has not written, and files of the same pictures may differ.
H264 = Encoder("libx264", 0.15, {"preset": "veryfast", "crf": "23", "bf": "0"})
# By the end of a file's name, the best first: not all builds of FFmpeg have that of H.264.
ENCODERS = {".webm": (VP8, VP9), ".mp4": (H264, VP9)}
# Bits a second below which an encoder leaves pictures out.
LEAST_RATE = 64_000
# Seconds of its bits that a change of scene may spend at once.
BURST = 2
# Of smaller pictures encoders make files that nothing reads.
SMALLEST_SIDE = 16
# The largest denominator of a frame rate, that of 30000/1001.
DENOMINATOR = 1001
# The number in ITU-T H.273 of levels from 16 to 235, as `yuv420p` has them.
LIMITED_RANGE = 1
# The number in ITU-T H.273 of the matrix of BT.601.
BT601_MATRIX = 6


def check_ending(path: Path, option: str = "") -> None:
    """Refuse the name of a video that cannot be written; raises RequestError, which names the ``option``."""
    if path.suffix.lower() not in ENCODERS:
        place = option and f"`{option}`: "
        raise RequestError(f"{place}expected a name that ends in {' or '.join(ENCODERS)}, got {path}")


class VideoWriter:
    """A file ``.webm`` or ``.mp4`` of bounded bit rate, written frame by frame and closed with the ``with`` block.

    Args:
        path: of the file.
        frame_rate: frames a second.
        metadata: texts by name that the file carries.

    Raises:
        RunError: it cannot be written, or the disk is full.
    """

    def __init__(self, path: Path, frame_rate: float, metadata: Mapping[str, str] | None = None) -> None:
        self.path, self.frame_rate, self.metadata = path, frame_rate, metadata or {}
        self._size = (0, 0)
        self._frames = 0
        self._file: BinaryIO | None = None
        self._container: Any = None
        self._stream: Any = None

    def write(self, image: ImageArray) -> None:
        """Append ``image`` ``(H, W, 3)`` uint8 RGB.

        An odd last row or column is left out; the border of a picture below 16 pixels is repeated.
        """
        import av
        from av.video.reformatter import Colorspace

        image = _even(image)
        height, width = image.shape[:2]
        if self._file is None:
            self._size = (width, height)
            self._open()
        if (width, height) != self._size:
            raise RunError(f"{self.path}: expected frames of {self._size[0]}x{self._size[1]}, got {width}x{height}")
        picture = av.VideoFrame.from_ndarray(image, format="rgb24")
        frame = self._converter.reformat(picture, format="yuv420p", dst_colorspace=Colorspace.ITU601, threads=1)
        frame.pts, frame.time_base = self._frames, self._step
        self._frames += 1
        with self._whole():
            self._container.mux(self._stream.encode(frame))

    def _open(self) -> None:
        import av

        suffix = self.path.suffix.lower()
        encoder = next((encoder for encoder in ENCODERS[suffix] if encoder.name in av.codecs_available), None)
        if encoder is None:
            names = " and ".join(encoder.name for encoder in ENCODERS[suffix])
            raise RunError(f"{self.path.name}: this build of PyAV has no encoder {names}")
        rate = Fraction(self.frame_rate).limit_denominator(DENOMINATOR)
        width, height = self._size
        bits = max(LEAST_RATE, round(encoder.bits * width * height * self.frame_rate))
        self._step, self._converter = 1 / rate, av.video.reformatter.VideoReformatter()
        with self._whole():
            self._file = self.path.open("wb")
            # Exact bits: FFmpeg's version, the time and a random number stay out of the file.
            self._container = av.open(self._file, "w", suffix[1:], options={"fflags": "+bitexact"})
            self._container.metadata.update(self.metadata)
            self._stream = self._container.add_stream(encoder.name, rate)
            self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
            burst = {"maxrate": bits, "bufsize": BURST * bits} if encoder is H264 else {}
            bounds = {name: str(value) for name, value in ({"b": bits} | burst).items()}
            self._stream.options = {**bounds, **encoder.options}
            # Of several threads the rate would depend on which is first.
            self._stream.thread_count = 1
            context = self._stream.codec_context
            context.color_range, context.colorspace = LIMITED_RANGE, BT601_MATRIX

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is None:
            return
        if kind is None:
            with self._whole():
                self._container.mux(self._stream.encode(None))
                self._container.close()
                self._file.close()
        else:
            with suppress(Exception):
                self._container.close()
            with suppress(OSError):
                self._file.close()

    @contextmanager
    def _whole(self) -> Iterator[None]:
        import av

        try:
            yield
        except (av.FFmpegError, OSError) as error:
            raise RunError(f"{self.path.name}: the video was not written to its end; is the disk full?") from error


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
