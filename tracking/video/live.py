"""Webcams and streams: read beside the program, which waits for no picture longer than a bound, and connected again.

A camera that is away is waited for, with growing pauses between two attempts; the run ends when the user says so. A
picture that nobody takes before the next one comes is dropped and counted: what is worked on is never old. Waiting
goes by a clock that never falls; whoever notes a time of day reads another one, which may jump (`LiveClock`).

A webcam is read by OpenCV, which numbers the cameras of every system; all else by `decoding`.
"""

from __future__ import annotations

import math
import queue
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import cv2
import numpy as np

from tsuiseki.tracking.errors import AbsentCameraError, InputWarning, RequestError, RunError
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.live import CameraState
from tsuiseki.tracking.video.decoding import FASTEST, Decoder
from tsuiseki.tracking.video.frame_source import DEFAULT_FRAME_RATE, Size, Source, TimedBy
from tsuiseki.tracking.video.levels import DEPTHS, eight_bits

# Seconds without a picture from which on a source counts as lost.
PICTURE = 10.0
# Seconds before the first attempt to connect again; each later one waits twice as long.
PAUSE = 0.5
# Seconds between two attempts at most.
LONGEST_PAUSE = 30.0
# Seconds that a reader has to stop.
GOODBYE = 0.2
# Gaps that are remembered, the latest.
GAPS = 1000
# Seconds of a gap at most that count as frames without inference: nobody is linked over more.
SKIPPED = 10.0
# Share by which the sides of two pictures may differ in proportion and still show the same view.
PROPORTION = 0.02


class TimedPicture(NamedTuple):
    """When a picture came, seconds of a clock that never falls; its number from 0 since the connection; and it."""

    came: float
    number: int
    image: ImageArray


@dataclass(frozen=True)
class LiveClock:
    """What a live source waits by, and what its result is dated by.

    Attributes:
        monotonic: seconds that never fall, for waits.
        wall: seconds since 1970, which may jump, for records.
        sleep: waits for so many seconds.
    """

    monotonic: Callable[[], float] = time.monotonic
    wall: Callable[[], float] = time.time
    sleep: Callable[[float], None] = time.sleep


@dataclass(frozen=True, kw_only=True)
class LiveSource(Source):
    """A webcam or a stream, which ends when the user says so.

    Where it breaks off or stalls, it is connected again, and ``gaps`` says where: the frame before, counted from 1, and
    for how many seconds there was no picture. Of several video streams at the address number ``stream`` is read.

    Attributes:
        give_up: seconds without a picture after which it has ended; None waits for it as long as it takes.
        awaited: it need not be there at first.
        held_back: see `Decoder`.
        state: what it has given.
        origin: from which the times of frames count, of the clock that never falls; by default the first attempt.
        told: is called with None when it is lost, and with the seconds of the gap when it is back.
    """

    live: bool = True
    ends: bool = False
    timed_by: TimedBy = "arrival"
    gaps: list[dict[str, Any]] = field(default_factory=list, compare=False)
    stream: int = 1
    give_up: float | None = None
    awaited: bool = False
    held_back: bool = False
    clock: LiveClock = field(default=LiveClock(), compare=False)
    origin: float | None = field(default=None, compare=False)
    state: CameraState = field(default_factory=lambda: CameraState(""), compare=False)
    told: Callable[[float | None], None] = field(default=lambda _: None, compare=False)

    @classmethod
    def open(cls, address: str, name: str, frame_range: FrameRange, stream: int | None = None) -> LiveSource:
        """The source at ``address``; raises RequestError where nothing answers."""
        if address.isdecimal():
            with webcam(address) as capture:
                if not capture.isOpened():
                    raise AbsentCameraError(f"expected pictures from {name}, got none; is it connected, and free?")
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
                held_back=decoder.held_back,
            )

    @property
    def waits(self) -> bool:
        """Whether a picture waits until it is taken, as those of a recording do; others give way to the next."""
        return self.ends or self.held_back

    def frames(self) -> Iterator[Frame]:
        with closing(self.numbered()) as frames:
            for index, frame in enumerate(frames):
                if index in self.frames_wanted:
                    yield self.noted(replace(frame, index=index))
                if index == self.frames_wanted.last:
                    return

    def numbered(self) -> Generator[Frame]:
        """Each frame with the number that it has among all that came or would have come.

        Dropped pictures count, and a gap as its frames at the usual rate, up to `SKIPPED` seconds.

        Raises:
            RunError: it gave nothing, it is given up, or a recording at an address breaks off.
        """
        reader, head, size = self._reader(), None, self.size
        count, index, before, came = 0, -1, -1, self.clock.monotonic()
        start = came if self.origin is None else self.origin
        try:
            while True:
                picture = _fitted(reader.next(PICTURE), size)
                if picture is None:
                    self._check_end(reader, count)
                    if self.ends:
                        return
                    reader, picture = self._again(reader, count, size, came)
                    # A file that is sent without its length begins anew.
                    if head is not None and reader.head == head:
                        return
                    index += self._noted_gap(count, picture.came - came)
                    before = picture.number - 1
                size = size or (picture.image.shape[1], picture.image.shape[0])
                self.state.dropped += picture.number - before - 1
                index += picture.number - before
                head, before, came, count = head or reader.head, picture.number, picture.came, count + 1
                self.state.frames, self.state.last = self.state.frames + 1, self.clock.wall()
                yield Frame(index, came - start, picture.image)
        finally:
            reader.stop()

    def _check_end(self, reader: _Reader, count: int) -> None:
        if not count and not self.awaited:
            raise RunError(f"{self.name} stopped before the first frame")
        if self.ends and reader.broken:
            raise RunError(f"{self.name}: the connection breaks off after frame {count}")

    def _noted_gap(self, count: int, seconds: float) -> int:
        """Note a gap after so many frames; for how many it counts."""
        self.gaps.append({"after_frame": count, "seconds": round(seconds, 3)})
        del self.gaps[:-GAPS]
        self.state.away = False
        self.told(seconds)
        return max(0, round(min(seconds, SKIPPED) * self.frame_rate) - 1) if count else 0

    def _reader(self) -> _Reader:
        return _Reader(self.address, self.stream, not self.waits)

    def _again(self, reader: _Reader, count: int, size: Size | None, came: float) -> tuple[_Reader, TimedPicture]:
        """A new reader in the place of one that is lost, and its first picture of the usual size."""
        what = f"{self.name}: no picture after frame {count}"
        bound = "until it is back" if self.give_up is None else f"for up to {self.give_up:g} s"
        warnings.warn(f"{what}, connecting again {bound}", InputWarning, stacklevel=2)
        self.state.away, self.state.outages = True, self.state.outages + 1
        self.told(None)
        pause, shape = PAUSE, None
        while True:
            reader.stop()
            left = math.inf if self.give_up is None else came + self.give_up - self.clock.monotonic()
            if left <= 0:
                raise RunError(f"{what}, and none within {self.give_up:g} s of connecting again")
            self.clock.sleep(min(pause, left))
            pause, reader = min(2 * pause, LONGEST_PAUSE), self._reader()
            newest = reader.next(PICTURE)
            picture = _fitted(newest, size)
            if newest is not None and size is not None and newest.image.shape[1::-1] not in (size, shape):
                shape = newest.image.shape[1::-1]
                done = "are not of the same view: it is waited for" if picture is None else "are scaled to them"
                warnings.warn(
                    f"{self.name}: expected {size[0]}x{size[1]} pixels throughout, got {shape[0]}x{shape[1]}, "
                    f"which {done}", InputWarning, stacklevel=2,
                )  # fmt: skip
            if picture is not None:
                return reader, picture


def _fitted(picture: TimedPicture | None, size: Size | None) -> TimedPicture | None:
    """A picture of that size, scaled where it has the same proportions; None where it has not, or there is none."""
    if picture is None or size is None or picture.image.shape[1::-1] == size:
        return picture
    (height, width), (across, high) = picture.image.shape[:2], size
    if abs(width * high / (height * across) - 1) > PROPORTION:
        return None
    return picture._replace(image=np.asarray(cv2.resize(picture.image, size, interpolation=cv2.INTER_AREA), np.uint8))


class _Reader:
    """Reads pictures in a thread of its own: a driver that hangs is left behind.

    Args:
        address: of the source.
        stream: number of its video stream.
        newest: a picture that nobody has taken gives way to the next one; otherwise the next one waits.

    Attributes:
        head: what the video begins with, see `Decoder.head`.
        broken: whether it ended because no more could be read.
    """

    def __init__(self, address: str, stream: int, newest: bool) -> None:
        self.head: tuple[int, bytes] | None = None
        self.broken = False
        self._waiting: queue.Queue[TimedPicture | None] = queue.Queue(1)
        self._stopped, self._newest = threading.Event(), newest
        self._thread = threading.Thread(target=self._read, args=(address, stream), daemon=True)
        self._thread.start()

    def next(self, seconds: float) -> TimedPicture | None:
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
            for number, image in enumerate(pictures):
                if self._newest:
                    with suppress(queue.Empty):
                        self._waiting.get_nowait()
                self._give(TimedPicture(time.monotonic(), number, image))
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

    def _give(self, picture: TimedPicture | None) -> None:
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
