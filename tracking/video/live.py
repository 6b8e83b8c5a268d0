"""Webcams and streams: read beside the program, which waits for no picture longer than a bound, and connected again."""

from __future__ import annotations

import queue
import threading
import time
import warnings
from collections.abc import Generator, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.frame_source import DEFAULT_FRAME_RATE, Source, TimedBy, stated_rate

Picture: TypeAlias = tuple[float, ImageArray]
"""When it came, seconds of a clock that never falls; and it."""
GOODBYE = 0.2


# Seconds without a picture from which on a source counts as lost, before the first attempt to connect again, each being
# twice as long after, and from the loss on after which it has ended.
PICTURE, PAUSE, ALTOGETHER = 10.0, 0.5, 60.0


@dataclass(frozen=True, kw_only=True)
class LiveSource(Source):
    """A webcam or a stream, which ends when the user says so.

    Where it breaks off or stalls, it is connected again, and ``gaps`` says where: the frame before, counted from 1, and
    for how many seconds there was no picture.
    """

    live: bool = True
    ends: bool = False
    timed_by: TimedBy = "arrival"
    gaps: list[dict[str, Any]] = field(default_factory=list, compare=False)

    @classmethod
    def open(cls, address: str, name: str, wanted: FrameRange) -> LiveSource:
        """The source at ``address``; raises RequestError where nothing answers."""
        capture = connected(address)
        try:
            if not capture.isOpened():
                raise RequestError(f"expected pictures from {name}, got none; is it connected, and free?")
            # A recording has a length; what comes from a camera has none.
            ends = capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0
            rate = stated_rate(capture) or DEFAULT_FRAME_RATE
            return cls(name=name, address=address, frame_rate=rate, frames_wanted=wanted, ends=ends)
        finally:
            capture.release()

    def frames(self) -> Iterator[Frame]:
        """See `Source.frames`."""
        start = time.monotonic()
        with closing(self._pictures()) as pictures:
            for index, (came, image) in enumerate(pictures):
                if index in self.frames_wanted:
                    yield self.noted(Frame(index, came - start, image))
                if index == self.frames_wanted.last:
                    return

    def _pictures(self) -> Generator[Picture]:
        """Each picture, through losses of the connection."""
        reader, count, last = _Reader(self.address), 0, None
        try:
            while True:
                picture = reader.next(PICTURE)
                if picture is None:
                    if last is None:
                        raise RunError(f"{self.name} stopped before the first frame")
                    if self.ends:
                        return
                    reader, picture = self._again(reader, count, last[0])
                if last is not None and last[1].shape != picture[1].shape:
                    (now, across), (height, width) = picture[1].shape[:2], last[1].shape[:2]
                    raise RunError(f"{self.name}: expected {width}x{height} pixels throughout, got {across}x{now}")
                last, count = picture, count + 1
                yield picture
        finally:
            reader.stop()

    def _again(self, reader: _Reader, count: int, last: float) -> tuple[_Reader, Picture]:
        """A new reader in the place of one that is lost, and its first picture; ``last`` came at frame ``count``."""
        lost, pause, picture = time.monotonic(), PAUSE, None
        what, bound = f"{self.name}: no picture after frame {count}", f"{ALTOGETHER:g} s"
        warnings.warn(f"{what}, connecting again for up to {bound}", InputWarning, stacklevel=2)
        while picture is None:
            reader.stop()
            if time.monotonic() - lost > ALTOGETHER:
                raise RunError(f"{what}, and none within {bound} of connecting again")
            time.sleep(pause)
            pause, reader = min(2 * pause, PICTURE), _Reader(self.address)
            picture = reader.next(PICTURE)
        self.gaps.append({"after_frame": count, "seconds": round(picture[0] - last, 3)})
        return reader, picture


class _Reader:
    """Reads pictures in a thread of its own: a driver that hangs is left behind."""

    def __init__(self, address: str) -> None:
        self._waiting: queue.Queue[Picture | None] = queue.Queue(1)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._read, args=(address,), daemon=True)
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

    def _read(self, address: str) -> None:
        capture = connected(address)
        try:
            while not self._stopped.is_set() and capture.grab():
                now = time.monotonic()
                decoded, image = capture.retrieve()
                if not decoded:
                    break
                self._give((now, np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)))
            self._give(None)
        finally:
            capture.release()

    def _give(self, picture: Picture | None) -> None:
        while not self._stopped.is_set():
            with suppress(queue.Full):
                self._waiting.put(picture, timeout=GOODBYE)
                return


def connected(address: str) -> cv2.VideoCapture:
    """A capture of an address or the number of a webcam, open or not; the network is waited for within bounds."""
    if address.isdecimal():
        return cv2.VideoCapture(int(address))
    bound = round(1000 * PICTURE)
    bounds = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, bound, cv2.CAP_PROP_READ_TIMEOUT_MSEC, bound]
    return cv2.VideoCapture(address, cv2.CAP_FFMPEG, bounds)
