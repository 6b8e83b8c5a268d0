"""Webcams and streams: read beside the program, which waits for no picture longer than a bound, and connected again.

A webcam is read by OpenCV, which numbers the cameras of every system; all else by `decoding`.
"""

from __future__ import annotations

import math
import queue
import threading
import time
import warnings
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.decoding import FASTEST, Decoder
from tsuiseki.tracking.video.frame_source import DEFAULT_FRAME_RATE, Source, TimedBy
from tsuiseki.tracking.video.levels import DEPTHS, eight_bits

# When it came, seconds of a clock that never falls; and it.
Picture: TypeAlias = tuple[float, ImageArray]
# Seconds without a picture from which on a source counts as lost.
PICTURE = 10.0
# Seconds before the first attempt to connect again; each later one waits twice as long.
PAUSE = 0.5
# Seconds from the loss on after which a source has ended.
ALTOGETHER = 60.0
# Seconds that a reader has to stop.
GOODBYE = 0.2


@dataclass(frozen=True, kw_only=True)
class LiveSource(Source):
    """A webcam or a stream, which ends when the user says so.

    Where it breaks off or stalls, it is connected again, and ``gaps`` says where: the frame before, counted from 1, and
    for how many seconds there was no picture. Of several video streams at the address number ``stream`` is read.
    """

    live: bool = True
    ends: bool = False
    timed_by: TimedBy = "arrival"
    gaps: list[dict[str, Any]] = field(default_factory=list, compare=False)
    stream: int = 1

    @classmethod
    def open(cls, address: str, name: str, frame_range: FrameRange, stream: int | None = None) -> LiveSource:
        """The source at ``address``; raises RequestError where nothing answers."""
        if address.isdecimal():
            with webcam(address) as capture:
                if not capture.isOpened():
                    raise RequestError(f"expected pictures from {name}, got none; is it connected, and free?")
                rate, ends = float(capture.get(cv2.CAP_PROP_FPS)), capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0
            rate = rate if math.isfinite(rate) and 0 < rate <= FASTEST else DEFAULT_FRAME_RATE
            return cls(name=name, address=address, frame_rate=rate, frames_wanted=frame_range, ends=ends)
        with closing(Decoder(address, stream, PICTURE)) as decoder:
            return cls(
                name=name,
                address=address,
                stream=1 if stream is None else stream,
                frame_rate=decoder.rate or DEFAULT_FRAME_RATE,
                size=decoder.size,
                frames_wanted=frame_range,
                ends=decoder.finite,
            )

    def frames(self) -> Iterator[Frame]:
        start = time.monotonic()
        with closing(self._pictures()) as pictures:
            for index, (came, image) in enumerate(pictures):
                if index in self.frames_wanted:
                    yield self.noted(Frame(index, came - start, image))
                if index == self.frames_wanted.last:
                    return

    def _pictures(self) -> Generator[Picture]:
        """Each picture, through losses of the connection."""
        reader, count, last, head = self._reader(), 0, None, None
        try:
            while True:
                picture = reader.next(PICTURE)
                if picture is None:
                    if last is None:
                        raise RunError(f"{self.name} stopped before the first frame")
                    if self.ends and reader.broken:
                        raise RunError(f"{self.name}: the connection breaks off after frame {count}")
                    if self.ends:
                        return
                    reader, picture = self._again(reader, count)
                    # A file that is sent without its length begins anew.
                    if head is not None and reader.head == head:
                        return
                    self.gaps.append({"after_frame": count, "seconds": round(picture[0] - last[0], 3)})
                if last is not None and last[1].shape != picture[1].shape:
                    (now, across), (height, width) = picture[1].shape[:2], last[1].shape[:2]
                    raise RunError(f"{self.name}: expected {width}x{height} pixels throughout, got {across}x{now}")
                head, last, count = head or reader.head, picture, count + 1
                yield picture
        finally:
            reader.stop()

    def _reader(self) -> _Reader:
        return _Reader(self.address, self.stream)

    def _again(self, reader: _Reader, count: int) -> tuple[_Reader, Picture]:
        """A new reader in the place of one that is lost after so many frames, and its first picture."""
        lost, pause, picture = time.monotonic(), PAUSE, None
        what, bound = f"{self.name}: no picture after frame {count}", f"{ALTOGETHER:g} s"
        warnings.warn(f"{what}, connecting again for up to {bound}", InputWarning, stacklevel=2)
        while picture is None:
            reader.stop()
            if time.monotonic() - lost > ALTOGETHER:
                raise RunError(f"{what}, and none within {bound} of connecting again")
            time.sleep(pause)
            pause, reader = min(2 * pause, PICTURE), self._reader()
            picture = reader.next(PICTURE)
        return reader, picture


class _Reader:
    """Reads pictures in a thread of its own: a driver that hangs is left behind.

    Attributes:
        head: what the video begins with, see `Decoder.head`.
        broken: whether it ended because no more could be read.
    """

    def __init__(self, address: str, stream: int) -> None:
        self.head: tuple[int, bytes] | None = None
        self.broken = False
        self._waiting: queue.Queue[Picture | None] = queue.Queue(1)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._read, args=(address, stream), daemon=True)
        self._thread.start()

    def next(self, seconds: float) -> Picture | None:
        """The next picture; None where none comes within so many seconds, or none any more."""
        try:
            return self._waiting.get(timeout=seconds)
        except queue.Empty:
            return None

    def stop(self) -> None:
        """Nothing is read any more."""
        self._stopped.set()
        self._thread.join(GOODBYE)

    def _read(self, address: str, stream: int) -> None:
        pictures = self._from_webcam(address) if address.isdecimal() else self._from_stream(address, stream)
        with closing(pictures), suppress(RequestError, MemoryError):
            for image in pictures:
                self._give((time.monotonic(), image))
                if self._stopped.is_set():
                    return
        self._give(None)

    def _from_webcam(self, number: str) -> Generator[ImageArray]:
        with webcam(number) as capture:
            while capture.grab():
                decoded, image = capture.retrieve()
                if not decoded:
                    return
                yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)

    def _from_stream(self, address: str, stream: int) -> Generator[ImageArray]:
        with closing(Decoder(address, stream, PICTURE)) as decoder:
            for frame in decoder.frames():
                self.head = decoder.head
                yield eight_bits(decoder.levels(frame), DEPTHS[-1])
            self.broken = decoder.broken

    def _give(self, picture: Picture | None) -> None:
        while not self._stopped.is_set():
            with suppress(queue.Full):
                self._waiting.put(picture, timeout=GOODBYE)
                return


@contextmanager
def webcam(number: str) -> Iterator[cv2.VideoCapture]:
    """A capture of the webcam of this number, open or not."""
    capture = cv2.VideoCapture(int(number))
    try:
        yield capture
    finally:
        capture.release()
