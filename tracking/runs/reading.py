"""The frames that a run reads: up to where their source breaks off, and again to draw on; and what `run.json` says."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsuiseki.tracking.runs.ending import is_late
from tsuiseki.tracking.types.frame_range import FrameRange

if TYPE_CHECKING:
    from tsuiseki.tracking.types import Frame
    from tsuiseki.tracking.video.source import Source


@dataclass
class Reading:
    """How one source is read.

    Attributes:
        recording: file for the frames of a live source; None where they are not kept.
        first: 0-based number of the first frame that was read.
    """

    recording: Path | None = None
    first: int | None = None

    def frames(
        self, frames: Iterable[Frame], rate: float, broken: Callable[[BaseException], object]
    ) -> Iterator[Frame]:
        """``frames`` of so many a second, up to where they break off; then ``broken`` gets the reason.

        Raises:
            RequestError, RunError, OSError, MemoryError: before the first frame.
        """
        with ExitStack() as stack:
            writer = None
            if self.recording is not None:
                from tsuiseki.tracking.video.webm import VideoWriter

                writer = stack.enter_context(VideoWriter(self.recording, rate))
            try:
                for frame in frames:
                    if writer is not None:
                        writer.write(frame.image)
                    self.first = frame.index if self.first is None else self.first
                    yield frame
            except Exception as error:
                if self.first is None or not is_late(error):
                    raise
                broken(error)

    def replay(self, source: Source, length: int) -> Iterator[Frame]:
        """The first ``length`` frames of ``source`` again: a video that broke off is not asked for more than it had."""
        from tsuiseki.tracking.video.source import open_source

        if self.first is None:
            yield from source.frames()
        elif self.recording is None:
            yield from islice(source.frames(), length)
        else:
            for frame in open_source(self.recording, FrameRange(0, length - 1)).frames():
                yield replace(frame, index=frame.index + self.first)


def facts_of_sources(sources: Sequence[Source]) -> dict[str, Any]:
    """Where the times of their frames come from, whether these are even, and where a live one had gaps."""
    from tsuiseki.tracking.video.frame_source import uneven

    facts = {}
    for source in sources:
        gaps = getattr(source, "gaps", [])
        intervals = {} if source.live else uneven(list(source.times.values()))
        facts[source.name] = {"timed_by": source.timed_by, **intervals, **({"gaps": gaps} if gaps else {})}
    return {"frame_times": facts} if facts else {}
