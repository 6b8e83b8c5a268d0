"""Observers of one source that is tracked up to its end: they get its people as soon as they are certain."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from tsuiseki.tracking.types import Frame, Targets, Track
from tsuiseki.tracking.types.live import CameraOutage, LiveEvent, Observer, PeopleInFrame
from tsuiseki.tracking.types.tracks import targets_of_frames
from tsuiseki.tracking.video.frame_source import Source


class Recorded:
    """Passes frames and their people on to observers.

    Args:
        source: of the frames.
        observers: who gets them.
        while_it_runs: the tracker answers while it runs; else all come at the end, without pictures.
    """

    def __init__(self, source: Source, observers: Sequence[Observer], while_it_runs: bool) -> None:
        self._source, self._observers = source, observers
        self._kept = bool(observers) and while_it_runs
        # By number, with seconds since 1970, or of a recording since its beginning.
        self._waiting: dict[int, tuple[Frame, float]] = {}
        self._answered, self._gaps = -1, 0
        width, height = source.size or (1, 1)
        self._blank = np.zeros((height, width, 3), np.uint8)

    def frames(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """The frames themselves, which wait here for their people."""
        for frame in frames:
            if self._kept:
                self._waiting[frame.index] = frame, time.time() if self._source.live else frame.time
            yield frame

    def people(self, people: Targets) -> None:
        """The people of a frame are certain."""
        number = self._answered = people.frame
        frame, came = self._waiting.get(number, (None, 0.0))
        self._waiting = {index: later for index, later in self._waiting.items() if index > number}
        if frame is None:
            seconds = self._source.times.get(number, number / self._source.frame_rate)
            frame, came = Frame(number, seconds, self._blank), seconds
        self._tell_gaps(number, came)
        self._tell(PeopleInFrame(0, self._source.name, came, frame, people))

    def _tell_gaps(self, number: int, came: float) -> None:
        """Tell of outages of a live source before the frame of this number, which are known when they are over."""
        gaps = [gap for gap in getattr(self._source, "gaps", ())[self._gaps :] if gap["after_frame"] <= number]
        for gap in gaps:
            self._tell(CameraOutage(0, self._source.name, came - gap["seconds"]))
            self._tell(CameraOutage(0, self._source.name, came, gap["seconds"]))
        self._gaps += len(gaps)

    def _tell(self, happening: LiveEvent) -> None:
        for observer in self._observers:
            observer(happening)

    def rest(self, tracks: Sequence[Track], frames: Sequence[int]) -> None:
        """The run is over: the people of the 0-based ``frames`` that were not answered."""
        if self._observers:
            for people in targets_of_frames(tracks, [number for number in frames if number > self._answered]):
                self.people(people)
