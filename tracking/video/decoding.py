"""Decodes all video but that of webcams, by PyAV: a file from an open handle, a stream by its address.

A file's name never reaches FFmpeg as an address: it may hold colons, or bytes that are no text.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from tsuiseki.tracking.errors import AbsentCameraError, InputWarning, RequestError, RunError
from tsuiseki.tracking.video.frame_source import Size
from tsuiseki.tracking.video.levels import SAMPLES, Levels

if TYPE_CHECKING:
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

# FFmpeg draws the letters of a text file, which is no video.
TEXT_FORMAT = "tty"
# Formats that name other addresses: their own size says nothing of the video's.
LISTS = ("hls", "dash", "concat", "sdp")
# Frames a second beyond which a header is wrong.
FASTEST = 1000
# Seconds of FFmpeg's unit of durations.
MICROSECOND = 1e-6
# Threads of a decoder at most, for each holds a frame.
THREADS = 4
# No packet follows.
END = object()


class Decoder:
    """An opened video, whose frames come as they are shown; it is to be closed.

    Args:
        place: path of a file, or an address.
        stream: number of the video stream, from 1; by default the first.
        patience: seconds to wait for a network that does not answer.

    Attributes:
        rate: frames a second; None where the header does not say.
        start: seconds of the first frame by the container's clock.
        duration: seconds of the whole, by the header; 0 where it has none.
        promised: number of frames, by the header; 0 where it has none.
        size: width and height by the header, pixels, before they are turned.
        finite: whether the video ends by itself.
        held_back: whether its server waits for who reads, as one that sends a file by HTTP does.
        broken: whether frames ended because no more could be read.
        head: time and bytes of the first packet that was read; None where the format counts no time.

    Raises:
        RequestError: there is nothing that FFmpeg decodes, or no such stream.
        MemoryError: there is not enough.
    """

    def __init__(self, place: Path | str, stream: int | None = None, patience: float | None = None) -> None:
        import av

        self.name = place.name if isinstance(place, Path) else place.split("?")[0]
        self._file = place.open("rb") if isinstance(place, Path) else None
        self.broken = False
        self.head: tuple[int, bytes] | None = None
        self._failures = (av.FFmpegError, ValueError)
        self._converter = av.video.reformatter.VideoReformatter()
        try:
            if self._file is not None:
                opened = av.open(self._file, metadata_errors="replace", io_open=_refuse)
            else:
                # Cameras lose packets by UDP.
                options = {"rtsp_flags": "prefer_tcp"}
                opened = av.open(place, options=options, timeout=patience, metadata_errors="replace")
            self._container: Any = opened
            self._stream: VideoStream = self._chosen(stream)
        except self._failures as error:
            self.close()
            if isinstance(error, RequestError | MemoryError):
                raise
            if self._file is None:
                raise AbsentCameraError(
                    f"expected pictures from {self.name}, got none; is it connected, and free?"
                ) from error
            raise RequestError(f"{place}: expected a video that FFmpeg can decode, found something else") from error
        # Threads for several frames hold back as many: those of a live source would come late.
        self._stream.thread_type = "SLICE" if self._file is None else "AUTO"
        self._stream.thread_count = min(THREADS, os.cpu_count() or 1)
        self._read_header()

    def _chosen(self, number: int | None) -> VideoStream:
        from av.stream import Disposition

        streams: list[VideoStream] = [
            stream
            for stream in self._container.streams.video
            if stream.codec_context is not None and not stream.disposition & Disposition.attached_pic
        ]
        if self._container.format.name == TEXT_FORMAT or not streams:
            raise RequestError(f"{self.name}: expected a video that FFmpeg can decode, found no video in it")
        if not 1 <= (number or 1) <= len(streams):
            raise RequestError(f"{self.name}: expected a stream within 1-{len(streams)}, got {number}")
        if len(streams) > 1 and number is None:
            sizes = ", ".join(f"{n} of {s.width}x{s.height}" for n, s in enumerate(streams, 1))
            warnings.warn(
                f"{self.name} has {len(streams)} video streams, {sizes} pixels: 1 is read; "
                f"{self.name}#stream=2 names another",
                InputWarning,
                stacklevel=2,
            )
        return streams[(number or 1) - 1]

    def _read_header(self) -> None:
        stream, container = self._stream, self._container
        formats = container.format.name.split(",")
        self._base = float(stream.time_base or 0)
        rate = float(stream.guessed_rate or stream.average_rate or 0)
        self.rate = rate if math.isfinite(rate) and 0 < rate <= FASTEST else None
        self.start = (stream.start_time or 0) * self._base
        self.duration = max(0.0, (container.duration or 0) * MICROSECOND or (stream.duration or 0) * self._base)
        # The duration of Matroska counts from 0, whenever its first frame comes.
        if "matroska" in formats and 0 < self.start < self.duration:
            self.duration -= self.start
        self.promised = max(0, stream.frames or math.floor(self.duration * (self.rate or 0) + 0.5))
        self.size: Size = (stream.width, stream.height)
        self.finite = self.duration > 0 or (container.size > 0 and not set(LISTS) & set(formats))
        self._timed = "mpjpeg" not in formats
        by_http = self._file is None and self.name.startswith(("http://", "https://"))
        self.held_back = by_http and self._timed and not set(LISTS) & set(formats)

    def frames(self) -> Iterator[VideoFrame]:
        """Frames from the beginning, or from where `seek` went; a packet that is damaged is passed over."""
        packets = self._container.demux(self._stream)
        while True:
            packet = self._attempt(next, packets, END)
            self.broken = packet is None
            packet = None if packet is END else packet
            if packet is not None and self.head is None and self._timed and packet.pts is not None:
                self.head = packet.pts, bytes(packet)
            yield from self._attempt(self._stream.decode, packet) or ()
            if packet is None:
                return

    def _attempt(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """What a call of FFmpeg gives; None where it fails."""
        try:
            return call(*arguments)
        except MemoryError:
            raise
        except self._failures:
            return None

    def stamps(self) -> list[float] | None:
        """Seconds of all frames by their packets, in order; None where a packet has none. No frame is decoded."""
        stamps = list[float]()
        with suppress(*self._failures):
            for packet in self._container.demux(self._stream):
                if packet.size and packet.pts is None:
                    return None
                if packet.size and not packet.is_discard:
                    stamps.append(packet.pts * self._base)
        return sorted(stamps)

    def seek(self, stamp: float) -> bool:
        """Go to a key frame at or before a time, seconds; says whether that was possible."""
        try:
            self._container.seek(round(stamp / self._base), stream=self._stream)
        except self._failures:
            return False
        return True

    def stamp(self, frame: VideoFrame) -> float | None:
        """Seconds of a frame by the container's clock; None where it has none."""
        ticks = frame.dts if frame.pts is None else frame.pts
        return None if ticks is None else ticks * self._base

    def levels(self, frame: VideoFrame) -> Levels:
        """``(H, W, 3)`` RGB of a frame, upright: uint8, or uint16 of a file that has 16 bits a colour."""
        deep = frame.format.components[0].bits == 16
        convert = partial(self._converter.reformat, format="rgb48le" if deep else "rgb24", threads=1)
        converted = self._attempt(convert, frame)
        if converted is None:
            raise RunError(f"{self.name}: its pictures, {frame.format.name}, cannot be converted to RGB")
        turns = frame.rotation // 90 if frame.rotation % 90 == 0 else 0
        levels: Levels = np.asarray(converted.to_ndarray())
        return np.ascontiguousarray(np.rot90(levels, turns))

    def samples(self) -> Iterator[Levels]:
        """Frames from all parts of a file, as far as it can be entered there."""
        for part in range(SAMPLES):
            frame = next(self.frames(), None) if self.seek(self.start + self.duration * part / SAMPLES) else None
            if frame is not None:
                yield self.levels(frame)

    def close(self) -> None:
        """Close the video; no frame can be asked for any more."""
        container = getattr(self, "_container", None)
        if container is not None:
            container.close()
        if self._file is not None:
            self._file.close()


def _refuse(address: str, *_: Any) -> NoReturn:
    """A file leads to no other."""
    raise PermissionError(f"{address} is not opened")
