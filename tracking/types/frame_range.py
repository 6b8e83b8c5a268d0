"""Frames of a video, as users write them: ``301-400``, counted from 1 and with both ends."""

from __future__ import annotations

import re
from dataclasses import dataclass

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, IntArray


@dataclass(frozen=True)
class FrameRange:
    """Frames ``first`` to ``last``, 0-based, both included; a last of None goes on to the end of the video."""

    first: int = 0
    last: int | None = None

    def __contains__(self, frame: int) -> bool:
        return self.first <= frame and (self.last is None or frame <= self.last)

    def mask(self, frames: IntArray) -> BoolArray:
        """``(N,)`` which of the 0-based ``frames`` ``(N,)`` lie in it."""
        inside = frames >= self.first
        return inside if self.last is None else inside & (frames <= self.last)

    def __str__(self) -> str:
        return f"{self.first + 1}-{'' if self.last is None else self.last + 1}"

    def within(self, length: int) -> FrameRange:
        """The range in a video of ``length`` frames, with its end filled in.

        Raises:
            RequestError: it reaches beyond the video.
        """
        last = length - 1 if self.last is None else self.last
        if self.first >= length or last >= length:
            if length == 0:
                raise RequestError("expected a video with frames, got none, and nothing says how long it is")
            raise RequestError(f"expected frames within 1-{length}, got `frames` {self}")
        return FrameRange(self.first, last)


EVERY_FRAME = FrameRange()
# The largest frame number, from 1, that a file may name: four days at 30 frames a second.
LAST_FRAME = 10_000_000


def parse_frames(text: str | None) -> FrameRange:
    """The range that ``301-400``, ``301-`` or ``-400`` names; None is the whole video.

    Raises:
        RequestError: the text is something else.

    >>> parse_frames("301-400")
    FrameRange(first=300, last=399)
    """
    if text is None:
        return FrameRange()
    match = re.fullmatch(r"\s*(\d*)\s*-\s*(\d*)\s*", text) if isinstance(text, str) else None
    if match is None or not any(match.groups()):
        raise RequestError(f"expected `frames` FIRST-LAST counted from 1, such as 301-400, got {text!r}")
    first = int(match[1] or 1) - 1
    last = int(match[2]) - 1 if match[2] else None
    if first < 0 or (last is not None and last < first):
        raise RequestError(f"expected `frames` FIRST-LAST with 1 <= FIRST <= LAST, got {text!r}")
    return FrameRange(first, last)
