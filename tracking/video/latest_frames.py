"""The newest frames of several live cameras, read side by side and paired by the time at which they came.

Cameras without a common trigger deliver when they like, and some stall. Each is read by a thread of its own, which
keeps its newest frame only: a filter that is slower than the cameras misses frames and does not fall behind.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.video.synchronise import Moment

Stamped = tuple[float, Frame]
PATIENCE = 2.0
"""Seconds for which a reader is waited for at the end; one that hangs in its camera's driver is left behind."""


def paired(newest: Mapping[int, Stamped], tolerance: float) -> dict[int, Stamped]:
    """Of the newest frames by camera: the oldest, and those that came within ``tolerance`` seconds after it."""
    oldest = min(stamp for stamp, _ in newest.values())
    return {view: one for view, one in newest.items() if one[0] - oldest <= tolerance}


class LatestFrames:
    """Reads several videos at once.

    Args:
        videos: makes the frames of each camera; called in its thread.
        tolerance: frames that came within so many seconds count as taken together.
        clock: seconds, never falling.
    """

    def __init__(
        self,
        videos: Sequence[Callable[[], Iterator[Frame]]],
        tolerance: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.videos, self.tolerance, self.clock = videos, tolerance, clock
        self._changed = threading.Condition()
        self._newest: dict[int, Stamped] = {}
        self._running: set[int] = set()
        self._error: BaseException | None = None
        self._stopping = False

    def moments(self) -> Iterator[tuple[Moment, list[ImageArray | None]]]:
        """Each moment with the image of every camera, None of one that had none then; until all cameras have ended.

        A frame waits for the other cameras no longer than the tolerance. Times count from the first call.

        Raises:
            RunError, RequestError: a camera cannot be read, or has not the right size.
        """
        begin = self.clock()
        self._running = set(range(len(self.videos)))
        readers = [threading.Thread(target=self._read, args=(view,), daemon=True) for view in self._running]
        for reader in readers:
            reader.start()
        try:
            while (together := self._next()) is not None:
                stamps = [stamp - begin for stamp, _ in together.values()]
                numbers = tuple(together[k][1].index if k in together else None for k in range(len(self.videos)))
                images = [together[k][1].image if k in together else None for k in range(len(self.videos))]
                yield Moment(sum(stamps) / len(stamps), numbers), images
        finally:
            self._stopping = True
            for reader in readers:
                reader.join(PATIENCE)

    def _read(self, view: int) -> None:
        frames = self.videos[view]()
        try:
            for frame in frames:
                with self._changed:
                    self._newest[view] = self.clock(), frame
                    self._changed.notify_all()
                if self._stopping:
                    return
        except BaseException as error:  # it belongs to whoever takes the moments
            self._error = error
        finally:
            close = getattr(frames, "close", None)
            if close is not None:
                close()
            with self._changed:
                self._running.discard(view)
                self._changed.notify_all()

    def _next(self) -> dict[int, Stamped] | None:
        """What belongs together next; None when every camera has ended."""
        with self._changed:
            while True:
                if self._error is not None:
                    raise self._error
                if self._newest:
                    waited = self.clock() - min(stamp for stamp, _ in self._newest.values())
                    if self._running <= self._newest.keys() or waited >= self.tolerance:
                        together = paired(self._newest, self.tolerance)
                        self._newest = {view: one for view, one in self._newest.items() if view not in together}
                        return together
                    self._changed.wait(self.tolerance - waited)
                elif not self._running:
                    return None
                else:
                    self._changed.wait()
