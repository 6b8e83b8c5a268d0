"""Several videos as one sequence of moments: frames of different cameras that were taken together come together."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import read_rows
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray


@dataclass(frozen=True)
class Moment:
    """Frames taken within the tolerance of each other.

    Attributes:
        time: seconds, the mean over the frames.
        frames: one 0-based frame number a video; None where a video has no frame now.
    """

    time: float
    frames: tuple[int | None, ...]


def align(times: Sequence[FloatArray], tolerance: float) -> list[Moment]:
    """Moments in order of time, each frame of each video in exactly one.

    A moment begins with the earliest frame not yet taken and holds the frames of other videos that follow within
    ``tolerance`` seconds; so videos may differ in rate and start, and may lack frames.

    Args:
        times: of the frames of each video, ``(T,)`` seconds, increasing.
        tolerance: seconds.
    """
    stamps = np.concatenate(times)
    videos = np.repeat(np.arange(len(times)), [len(t) for t in times])
    numbers = np.concatenate([np.arange(len(t)) for t in times])
    moments: list[Moment] = []
    group: dict[int, int] = {}
    begin, total = 0.0, 0.0
    for k in np.argsort(stamps, kind="stable"):
        video, stamp = int(videos[k]), float(stamps[k])
        if group and (video in group or stamp - begin > tolerance):
            moments.append(_moment(group, total, len(times)))
            group, total = {}, 0.0
        if not group:
            begin = stamp
        group[video] = int(numbers[k])
        total += stamp
    if group:
        moments.append(_moment(group, total, len(times)))
    return moments


def _moment(group: dict[int, int], total: float, videos: int) -> Moment:
    return Moment(total / len(group), tuple(group.get(v) for v in range(videos)))


def default_tolerance(times: Sequence[FloatArray]) -> float:
    """A quarter of the shortest usual time between two frames: at most one frame a video, and no gap missed."""
    steps = [float(np.median(np.diff(t))) for t in times if len(t) > 1]
    return 0.25 * min(steps) if steps else 0.0


def read_timestamps(path: Path) -> FloatArray:
    """``(T,)`` seconds from a text file: one number a line (or the first column of a CSV), a header line allowed.

    Raises:
        RequestError: a line is no number, or times do not increase.
    """
    rows = read_rows(path, "a text file with one time a line")
    times = []
    for number, row in enumerate(rows.cells):
        try:
            times.append(float(row[0]))
        except ValueError as error:
            if number > 0:
                raise rows.error(number, "seconds") from error
    if not times or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise RequestError(f"{path}: expected increasing times in seconds, got {len(times)} that are not")
    return np.array(times)


def moments_with_images(
    moments: Sequence[Moment], videos: Sequence[Iterator[Frame]]
) -> Iterator[tuple[Moment, list[ImageArray | None]]]:
    """Each moment with its images; every video is read once, front to back, one frame held at a time."""
    for moment in moments:
        images: list[ImageArray | None] = []
        for video, number in zip(videos, moment.frames, strict=True):
            frame = None if number is None else next((frame for frame in video if frame.index == number), None)
            if number is not None and frame is None:
                return
            images.append(None if frame is None else frame.image)
        yield moment, images


T = TypeVar("T")
# When a frame came, seconds of a clock that never falls; and it.
Stamped = tuple[float, Frame]
# Seconds for which a reader is waited for at the end; one that hangs in its camera's driver is left behind.
PATIENCE = 2.0


def paired(newest: Mapping[int, tuple[float, T]], tolerance: float) -> dict[int, tuple[float, T]]:
    """Of the newest frames by camera: the oldest, and those that came within ``tolerance`` seconds after it."""
    oldest = min(stamp for stamp, _ in newest.values())
    return {view: stamped for view, stamped in newest.items() if stamped[0] - oldest <= tolerance}


class LatestFrames:
    """Reads several videos at once.

    Args:
        videos: makes the frames of each camera; called in its thread.
        tolerance: frames that came within so many seconds count as taken together.
    """

    def __init__(self, videos: Sequence[Callable[[], Iterator[Frame]]], tolerance: float) -> None:
        self.videos, self.tolerance = videos, tolerance
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
        begin = time.monotonic()
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
                    self._newest[view] = time.monotonic(), frame
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
                    waited = time.monotonic() - min(stamp for stamp, _ in self._newest.values())
                    if self._running <= self._newest.keys() or waited >= self.tolerance:
                        together = paired(self._newest, self.tolerance)
                        self._newest = {view: stamped for view, stamped in self._newest.items() if view not in together}
                        return together
                    self._changed.wait(self.tolerance - waited)
                elif not self._running:
                    return None
                else:
                    self._changed.wait()
