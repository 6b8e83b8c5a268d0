"""Several sources at once, in one order: live ones as they come, recorded ones by their times.

Each live camera has a thread of its own. What is worked on is its newest frame: one that is not taken before the next
one comes is dropped and counted. Recorded sources, and recordings at an address, wait until a frame is taken.
"""

from __future__ import annotations

import heapq
import math
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.types import Frame
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.live import CameraOutage, CameraState
from tsuiseki.tracking.video.frame_source import Source
from tsuiseki.tracking.video.live import LiveClock, LiveSource
from tsuiseki.tracking.video.source import SourceLike, is_live, live_name, open_source, split_stream

# Seconds after which somebody who waits for frames looks whether to stop, and how late it is.
LOOK = 0.2
# Seconds that a reader has to stop: one that hangs in its camera's driver is left behind.
PATIENCE = 1.0


@dataclass(frozen=True)
class Arrival:
    """A frame of one of several sources.

    Attributes:
        camera: number of the source, from 0.
        time: at which it came, seconds since 1970; of a recording, since its beginning.
        frame: with its number among all that came or would have come, and its seconds since the beginning of all.
    """

    camera: int
    time: float
    frame: Frame


def check_different(sources: Sequence[Source]) -> None:
    """Refuse one camera under two names; raises RequestError."""
    addresses = Counter((source.address, source.stream) for source in sources if isinstance(source, LiveSource))
    if twice := [address for (address, _), count in addresses.items() if count > 1]:
        raise RequestError(f"expected different cameras, got {twice[0]} twice; leave one out")


def open_several(
    sources: Sequence[SourceLike],
    frames: FrameRange | None = None,
    frame_rate: float | None = None,
    give_up: float | None = None,
) -> list[Source]:
    """Several sources, each checked; a live one that is not there while others are is waited for.

    Args:
        sources: files, folders, numbers of webcams, or addresses.
        frames: to read of each; by default all.
        frame_rate: see `open_source`.
        give_up: seconds without a picture that end a live source; by default it is waited for.

    Raises:
        RequestError: one cannot be used, or none is there.
    """
    opened, missing = list[Source | None](), dict[int, RequestError]()
    for number, source in enumerate(sources):
        address = str(source) if isinstance(source, str | Path | int) else ""
        try:
            opened.append(open_source(source, frames, frame_rate))
        except RequestError as error:
            if not is_live(address):
                raise
            missing[number] = error
            opened.append(None)
    if len(missing) == len(opened):
        raise next(iter(missing.values()), RequestError("expected sources, got none"))
    for number in missing:
        address, stream = split_stream(str(sources[number]))
        name = live_name(address) or address
        warnings.warn(f"{name} is not there yet, it is waited for", InputWarning, stacklevel=2)
        rate = frame_rate or next(source.frame_rate for source in opened if source is not None)
        opened[number] = LiveSource(
            name=name, address=address, stream=stream or 1, frames_wanted=frames or FrameRange(), frame_rate=rate,
            awaited=True,
        )  # fmt: skip
    given = [source for source in opened if source is not None]
    return [replace(source, give_up=give_up) if isinstance(source, LiveSource) else source for source in given]


class SeveralSources:
    """Frames of several sources.

    Args:
        sources: all live, or all recorded.
        stopped: says whether to stop.

    Attributes:
        states: what each has given.
        live: whether they are live.
        clock: that live ones go by.

    Raises:
        RequestError: some are live and others not, or one is there twice.
    """

    def __init__(self, sources: Sequence[Source], stopped: Callable[[], bool] = lambda: False) -> None:
        self.live, self._stopped = any(source.live for source in sources), stopped
        if recorded := [source.name for source in sources if self.live and not source.live]:
            raise RequestError(f"expected live cameras beside live ones, got {recorded[0]}, which is recorded")
        check_different(sources)
        self.states = [CameraState(source.name) for source in sources]
        self.clock = next((s.clock for s in sources if isinstance(s, LiveSource)), LiveClock())
        self._changed = threading.Condition()
        self._waiting: dict[int, Arrival] = {}
        self._outages: list[CameraOutage] = []
        self._running: set[int] = set()
        self._errors: list[BaseException] = []
        self._closing = False
        self._sources = list(sources)

    def now(self) -> float:
        """Seconds since the beginning, of live sources."""
        return self.clock.monotonic() - self._begin

    @property
    def running(self) -> frozenset[int]:
        """Numbers of the sources that have frames to give yet, or are waited for."""
        with self._changed:
            return frozenset(self._running | self._waiting.keys())

    @property
    def away(self) -> frozenset[int]:
        """Numbers of the sources that give nothing now."""
        return frozenset(camera for camera, state in enumerate(self.states) if state.away)

    def batches(self) -> Iterator[list[Arrival | CameraOutage]]:
        """Outages, then at most one frame of each source; empty where none comes for a while.

        Raises:
            RunError: a camera is given up, or a recording breaks off.
        """
        self._begin = self.clock.monotonic()
        self._running = set(range(len(self._sources)))
        yield from self._arriving() if self.live else self._recorded()

    def _recorded(self) -> Iterator[list[Arrival | CameraOutage]]:
        with ExitStack() as stack:
            videos = [iter(source.frames()) for source in self._sources]
            for video in videos:
                if close := getattr(video, "close", None):
                    stack.callback(close)
            batch: list[Arrival | CameraOutage] = []
            heads = [(frame.time, camera, frame) for camera, video in enumerate(videos) if (frame := next(video, None))]
            self._running = {camera for _, camera, _ in heads}
            heapq.heapify(heads)
            while heads and not self._stopped():
                time, camera, frame = heads[0]
                if any(isinstance(a, Arrival) and (a.camera == camera or a.frame.time != time) for a in batch):
                    yield batch
                    batch = []
                batch.append(Arrival(camera, time, replace(frame, camera=camera)))
                self.states[camera].frames, self.states[camera].last = self.states[camera].frames + 1, time
                following = next(videos[camera], None)
                if following is None:
                    heapq.heappop(heads)
                    self._running.discard(camera)
                else:
                    heapq.heapreplace(heads, (following.time, camera, following))
            if batch:
                yield batch

    def _arriving(self) -> Iterator[list[Arrival | CameraOutage]]:
        cameras = range(len(self._sources))
        readers = [threading.Thread(target=self._read, args=(camera,), daemon=True) for camera in cameras]
        for reader in readers:
            reader.start()
        try:
            while not self._stopped():
                with self._changed:
                    if self._errors:
                        raise self._errors[0]
                    if not (self._waiting or self._outages):
                        if not self._running:
                            return
                        self._changed.wait(LOOK)
                    batch: list[Arrival | CameraOutage] = [
                        *self._outages,
                        *(self._waiting[camera] for camera in sorted(self._waiting)),
                    ]
                    self._outages.clear()
                    self._waiting.clear()
                    self._changed.notify_all()
                yield batch
        finally:
            with self._changed:
                self._closing = True
                self._changed.notify_all()
            for reader in readers:
                reader.join(PATIENCE / len(readers))

    def _read(self, camera: int) -> None:
        source, state = self._sources[camera], self.states[camera]
        assert isinstance(source, LiveSource)
        last = math.inf if source.frames_wanted.last is None else source.frames_wanted.last
        source = replace(source, state=state, origin=self._begin, told=lambda seconds: self._tell(camera, seconds))
        try:
            with closing(source.numbered()) as frames:
                for frame in frames:
                    wanted = frame.index in source.frames_wanted
                    arrival = Arrival(camera, self.clock.wall(), replace(frame, camera=camera))
                    if (wanted and not self._hand_over(arrival, source.waits)) or frame.index >= last:
                        return
        except BaseException as error:  # it belongs to whoever takes the frames
            self._errors.append(error)
        finally:
            with self._changed:
                self._running.discard(camera)
                self._changed.notify_all()

    def _hand_over(self, arrival: Arrival, waits: bool) -> bool:
        """Leave a frame to whoever takes them; says whether any is wanted still."""
        with self._changed:
            while waits and arrival.camera in self._waiting and not self._closing:
                self._changed.wait(LOOK)
            if arrival.camera in self._waiting:
                self.states[arrival.camera].dropped += 1
            self._waiting[arrival.camera] = arrival
            self._changed.notify_all()
            return not self._closing

    def _tell(self, camera: int, seconds: float | None) -> None:
        with self._changed:
            state, now = self.states[camera], self.clock.wall()
            last = state.last or now
            self._outages.append(CameraOutage(camera, state.name, last if seconds is None else now, seconds))
            self._changed.notify_all()
