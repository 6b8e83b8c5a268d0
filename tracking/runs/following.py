"""What the runs share that follow something through a video: the options of its source, drawing and messages."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY
from functools import partial
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal

from pydantic import field_validator
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.fields import FrameRate, Options
from tsuiseki.tracking.types.frame_range import parse_frames

if TYPE_CHECKING:
    from tsuiseki.tracking.result import Result
    from tsuiseki.tracking.runs.run import Run
    from tsuiseki.tracking.types import Frame
    from tsuiseki.tracking.video.source import Source, SourceLike


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Drawing(Options):
    """Whether to draw.

    Attributes:
        overlay: also write a video with the result drawn in.
        overlay_format: of that video.
    """

    overlay: bool = False
    overlay_format: Literal["webm", "mp4"] = "webm"

    def draw(
        self,
        run: Run,
        source: Source,
        result: Result[Any],
        folder: str = "",
        frames: Callable[[], Iterable[Frame]] | None = None,
    ) -> None:
        """Write a video with ``result`` drawn in, where that is wanted, on the finished frames or ``frames``."""
        from tsuiseki.tracking.report.overlay import write_drawn

        if self.overlay and result.painter is not None:
            name, rate, painter = f"overlay.{self.overlay_format}", result.frame_rate, result.painter
            again = frames or partial(run.replay, source)
            run.draw(str(PurePath(folder, name)), lambda path: write_drawn(path, again(), rate, painter))


@dataclass(frozen=True, config=SETTINGS)
class SourceOptions(Options):
    """The source and its frames.

    Attributes:
        source: a video, a folder of images or a sequence, a webcam, a stream.
        frames: these only, counted from 1 with both ends, such as 301-400.
        fps: frames a second, where the source does not state it or is wrong.
    """

    source: str
    _: KW_ONLY
    frames: str | None = None
    fps: FrameRate | None = None

    @field_validator("frames")
    @classmethod
    def _range(cls, frames: str | None) -> str | None:
        parse_frames(frames)
        return frames

    def open(self, **checks: Any) -> Source:
        """The source, checked; see `open_checked`."""
        return open_checked(self.source, self.frames, self.fps, **checks)


def open_checked(
    source: SourceLike,
    frames: str | None = None,
    fps: float | None = None,
    *,
    images: bool = False,
    replayable: bool = False,
    timed: bool = False,
    ends: str | None = None,
) -> Source:
    """A source, of which these frames are read.

    Args:
        source: whatever `open_source` takes.
        frames: the first and the last, such as 301-400.
        fps: frames a second, where the source does not state it.
        images: refuse a sequence that is text only.
        replayable: refuse a webcam or stream.
        timed: the result depends on the frame rate, so say where it is not known.
        ends: refuse what does not end by itself; what else to do then, or nothing.

    Raises:
        RequestError: see `open_source`.
    """
    from tsuiseki.tracking.video.source import open_source

    opened = open_source(source, parse_frames(frames), fps)
    if timed and opened.rate_missing:
        warnings.warn(
            f"{opened.name} does not say its frame rate: {opened.frame_rate:g} a second are taken; give `fps`",
            InputWarning,
            stacklevel=3,
        )
    if images and not opened.has_images:
        raise RequestError(f"{opened.name} has no images; expected them in its folder img1/")
    if replayable and opened.live:
        raise RequestError(
            "expected a video that can be played again, got a live source; record it, or give a list of images"
        )
    if ends is not None and opened.endless:
        raise RequestError(f"{opened.name} does not end by itself; give `frames`{ends}")
    return opened


@dataclass(frozen=True, config=SETTINGS)
class Video(Drawing, SourceOptions):
    """The source, its frames, and whether to draw."""

    def open(self, **checks: Any) -> Source:
        """The source, checked; raises RequestError where it is wrong, or there is nothing to draw the overlay on."""
        opened = super().open(**checks)
        if self.overlay and not opened.has_images:
            raise RequestError(f"{opened.name} has no images to draw on; leave `overlay` out")
        return opened


def count(number: int, singular: str, plural: str) -> str:
    """``1 person`` or ``3 people``."""
    return f"{number} {singular if number == 1 else plural}"
