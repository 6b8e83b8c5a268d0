"""Observers of a recording that is tracked: they get what they would get of a camera, as soon as it is certain."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from tsuiseki.tracking.types import Frame, Targets, Track
from tsuiseki.tracking.types.live import Observer, PeopleInFrame
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
        self._waiting: dict[int, Frame] = {}
        self._answered = -1
        width, height = source.size or (1, 1)
        self._blank = np.zeros((height, width, 3), np.uint8)

    def frames(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """The frames themselves, which wait here for their people."""
        for frame in frames:
            if self._kept:
                self._waiting[frame.index] = frame
            yield frame

    def people(self, people: Targets) -> None:
        """The people of a frame are certain."""
        number = self._answered = people.frame
        frame = self._waiting.get(number)
        self._waiting = {index: later for index, later in self._waiting.items() if index > number}
        if frame is None:
            seconds = self._source.times.get(number, number / self._source.frame_rate)
            frame = Frame(number, seconds, self._blank)
        for observer in self._observers:
            observer(PeopleInFrame(0, self._source.name, frame.time, frame, people))

    def rest(self, tracks: Sequence[Track], frames: Sequence[int]) -> None:
        """The run is over: the people of the 0-based ``frames`` that were not answered."""
        if self._observers:
            for people in targets_of_frames(tracks, [number for number in frames if number > self._answered]):
                self.people(people)
