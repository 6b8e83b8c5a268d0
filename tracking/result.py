"""What a run gives: the tracks, and what is known of how they came to be; the command writes it, the user takes it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar, overload

from tsuiseki.tracking.output import RunRecord, output_folder
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.video.source import Source, image_size

T_co = TypeVar("T_co", covariant=True)
Writer = Callable[[Path, Path], object]
"""Writes one file: its path, and the folder in which the files before it lie."""


@dataclass(frozen=True, eq=False, repr=False)
class Result(Sequence[T_co]):
    """The tracks of a run, in a sequence.

    >>> import numpy as np
    >>> from tsuiseki.tracking.types import Track
    >>> one = Track(7, np.array([0]), np.array([[1.0, 1.0, 5.0, 9.0]]), np.array([0.9]), np.array([True]))
    >>> result = Result([one], source="street.mp4", frame_rate=25.0)
    >>> len(result), result.by_id[7] is one
    (1, True)

    Attributes:
        tracks: one for each person or object; of a ball in space, its position at each moment.
        source: name of what was tracked in.
        frame_rate: frames a second of the source; 0 where there are none.
        size: width and height of a frame in pixels; None where not known.
        settings: of the run, by name, as for ``run.json``.
        facts: what the run measured of its input or chose by itself, by name.
        seconds: that each stage of the run took.
        frames: what happened in each frame: columns by name, all as long as ``frame``, whose numbers count from 1.
        files: what `save` writes, by name and in this order.
        painter: gives the image of a frame with the tracks drawn in; None where there is nothing to draw on.
    """

    tracks: Sequence[T_co]
    source: str = ""
    frame_rate: float = 0.0
    size: tuple[int, int] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    frames: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    files: Mapping[str, Writer] = field(default_factory=dict)
    painter: Callable[[Frame], ImageArray] | None = None

    @classmethod
    def of(cls, source: Source, tracks: Sequence[Any], **known: Any) -> Self:
        """The tracks in a video, with what it says of itself; ``known`` are the other attributes."""
        return cls(tracks, source.name, source.frame_rate, image_size(source), **known)

    def __len__(self) -> int:
        return len(self.tracks)

    def __iter__(self) -> Iterator[T_co]:
        return iter(self.tracks)

    @overload
    def __getitem__(self, index: int) -> T_co: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[T_co]: ...
    def __getitem__(self, index: int | slice) -> T_co | Sequence[T_co]:
        return self.tracks[index]

    def __repr__(self) -> str:
        where = f" in {self.source}" if self.source else ""
        return f"<Result: {len(self)} tracks{where}>"

    @cached_property
    def by_id(self) -> Mapping[int, T_co]:
        """The tracks by their ids."""
        every: Sequence[Any] = self.tracks
        return {track.id: track for track in every}

    def save(self, folder: str | Path, overwrite: bool = False) -> Path:
        """Write the files that the command writes, and ``run.json``; returns the folder.

        Args:
            folder: for the result; made where it does not exist.
            overwrite: replace an earlier result in it.

        Raises:
            RequestError: the folder holds files and ``overwrite`` is False, or it cannot be written to.
        """
        with output_folder(Path(folder), overwrite) as work:
            for name, write in self.files.items():
                write(work / name, work)
            seed = int(self.settings.get("seed", 0))
            record = RunRecord(["tsuiseki"], self.settings, seed, self.seconds, self.frames, facts=self.facts)
            record.write(work)
        return Path(folder)


@dataclass
class StageTimes:
    """Wall-clock seconds per stage: together no more than the run took.

    While several threads work, each moment is shared out among the stages that they are in; of stages within each other
    the inner one counts.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    _under_way: dict[int, list[str]] = field(default_factory=dict, repr=False, compare=False)
    _last: float = field(default=0.0, repr=False, compare=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time spent inside the ``with`` block to ``stage``."""
        thread = threading.get_ident()
        with self._lock:
            self._share_out()
            self._under_way.setdefault(thread, []).append(stage)
        try:
            yield
        finally:
            with self._lock:
                self._share_out()
                self._under_way[thread].remove(stage)
                if not self._under_way[thread]:
                    del self._under_way[thread]

    def _share_out(self) -> None:
        """The time since the last call among the stages that are under way."""
        now = time.perf_counter()
        for stages in self._under_way.values():
            share = (now - self._last) / len(self._under_way)
            self.seconds[stages[-1]] = self.seconds.get(stages[-1], 0.0) + share
        self._last = now
