"""A run of a ball in space, whatever its cameras see of it, and when their frames were taken."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.tracking.cameras.camera_files import PlacedCamera
from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.result import StageTimes
from tsuiseki.tracking.sphere.sphere_run import (
    Seen,
    SphereLog,
    Start,
    check_lengths,
    follow_ball,
    run_sphere,
)
from tsuiseki.tracking.sphere.tracker import SphereTracker
from tsuiseki.tracking.types import FloatArray, Position
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.video.synchronise import Moment, align, default_tolerance, read_timestamps

Watched: TypeAlias = Callable[[Iterable[Seen]], Iterable[Seen]]


@dataclass(frozen=True)
class SphereRun:
    """Everything that a run needs, checked.

    Attributes:
        placed: the cameras.
        stamps: ``(T,)`` of each camera, the time of every frame, seconds; none of live cameras.
        tolerance: frames within so many seconds count as taken together; None takes a quarter of the shortest time
            between frames.
        tracker: the filter.
        start: where the ball is looked for first.
        seen: what the cameras see at these moments; of live ones, from now on.
        sources: the videos, where there are some.
    """

    placed: Sequence[PlacedCamera]
    stamps: Sequence[FloatArray]
    tolerance: float | None
    tracker: SphereTracker
    start: Start
    seen: Callable[[Sequence[Moment]], Iterable[Seen]]
    sources: Sequence[Source] = ()

    @property
    def length(self) -> int | None:
        """Frames of the longest video; None of live cameras."""
        return max(map(len, self.stamps)) if self.stamps else None

    def run(self, rng: np.random.Generator, times: StageTimes, watch: Watched) -> SphereLog:
        """See `run_sphere`."""
        return run_sphere(self.tracker, self.start, self._moments(), rng, times, watch)

    def follow(self, rng: np.random.Generator) -> Iterator[Position]:
        """Each position as soon as it is known; nothing is kept."""
        log = SphereLog()
        for position in follow_ball(self.tracker, self.start, self._moments(), rng, StageTimes(), log):
            yield position
            log.forget()

    def _moments(self) -> Iterable[Seen]:
        stamps = list(self.stamps)
        if not stamps:
            return self.seen([])
        return self.seen(align(stamps, default_tolerance(stamps) if self.tolerance is None else self.tolerance))


@dataclass(frozen=True)
class FrameTimes(Shared):
    """When the frames were taken, where the camera file does not say it all.

    Attributes:
        offsets: time of each video's first frame, seconds, separated by commas; wins over cameras.yaml.
        timestamps: one text file per video with the time of each frame, separated by commas.
    """

    offsets: list[float] | None = None
    timestamps: list[Path] | None = None

    def of_videos(self, sources: Sequence[Source], placed: Sequence[PlacedCamera]) -> list[FloatArray]:
        """``(T,)`` the time of every frame of every video, seconds.

        Raises:
            RequestError: offsets, times and videos differ in number or length, or a source is live.
        """
        self._check_number(len(sources), "video")
        lengths = [frame_count(source) for source in sources]
        if self.timestamps is None:
            rates = [p.frame_rate or s.frame_rate for p, s in zip(placed, sources, strict=True)]
            stamps = self._even(lengths, rates, placed)
            if self.offsets is None and not any(p.offset for p in placed):
                check_lengths(stamps, [s.name for s in sources])
            return stamps
        stamps = [read_timestamps(path) for path in self.timestamps]
        for path, stamp, length in zip(self.timestamps, stamps, lengths, strict=True):
            if len(stamp) != length:
                raise RequestError(f"{path}: expected {length} times, one a frame, got {len(stamp)}")
        return self._shifted(stamps)

    def of_pixels(self, pixels: Sequence[FloatArray], placed: Sequence[PlacedCamera]) -> list[FloatArray]:
        """Likewise of the rows of every file of measured pixels.

        Raises:
            RequestError: offsets, times and files differ in number, or a frame rate is not known.
        """
        self._check_number(len(pixels), "file")
        lengths = [len(found) for found in pixels]
        if self.timestamps is None:
            if without := [camera.name for camera in placed if camera.frame_rate is None]:
                raise RequestError(f"`timestamps`: expected times, or a frame_rate of {without[0]} in the camera file")
            return self._even(lengths, [float(camera.frame_rate or 1.0) for camera in placed], placed)
        stamps = [read_timestamps(path) for path in self.timestamps]
        for path, stamp, length in zip(self.timestamps, stamps, lengths, strict=True):
            if len(stamp) < length:
                raise RequestError(f"{path}: expected at least {length} times, one a frame, got {len(stamp)}")
        return self._shifted([stamp[:length] for stamp, length in zip(stamps, lengths, strict=True)])

    def _check_number(self, expected: int, what: str) -> None:
        for name, given in (("`offsets`", self.offsets), ("`timestamps`", self.timestamps)):
            if given is not None and len(given) != expected:
                raise RequestError(f"{name}: expected {expected} values, one a {what}, got {len(given)}")

    def _even(self, lengths: Sequence[int], rates: Sequence[float], placed: Sequence[PlacedCamera]) -> list[FloatArray]:
        starts = [p.offset for p in placed] if self.offsets is None else self.offsets
        return [o + np.arange(n) / r for o, n, r in zip(starts, lengths, rates, strict=True)]

    def _shifted(self, stamps: Sequence[FloatArray]) -> list[FloatArray]:
        offsets = self.offsets or [0.0] * len(stamps)
        return [stamp + offset for stamp, offset in zip(stamps, offsets, strict=True)]


def frame_count(source: Source) -> int:
    """Number of frames; a video file is decoded once to count, for its header only estimates.

    Raises:
        RequestError: the source is live.
    """
    if source.live:
        raise RequestError(f"{source.name}: expected recorded videos beside recorded ones, got a live camera")
    if source.length is not None:
        return source.length
    count = 0
    try:
        for frame in source.frames():
            count = frame.index + 1
    except RunError as error:
        if not count:
            raise
        warnings.warn(f"{error}; it is used up to there", InputWarning, stacklevel=2)
    return count
