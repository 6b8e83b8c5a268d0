"""What every source of frames says of itself, and when its frames were taken: where that is known, and how evenly."""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from tsuiseki.tracking.types import FloatArray, Frame, IntArray
from tsuiseki.tracking.types.frame_range import FrameRange

Size: TypeAlias = tuple[int, int]
# Frames a second where nothing says them.
DEFAULT_FRAME_RATE = 25.0
# Where the times of frames come from.
TimedBy = Literal["container", "frame rate", "arrival"]
# Containers round times to milliseconds.
ROUNDING = 0.0015
# From this share of the usual step on two frames are not as far apart as the others.
UNEVEN = 0.25
# Bytes at both ends of a file that a fingerprint reads.
FINGERTIP = 65_536


def container_time(stated: float, times: Sequence[float], frame_rate: float) -> float:
    """Seconds since the first frame of a video.

    Args:
        stated: the container's time since the first frame, seconds; anything where it has none.
        times: of the frames before, seconds.
        frame_rate: a second; a time that agrees with it but for rounding is ``len(times) / frame_rate`` exactly, and a
            time that does not increase is taken to be a frame after the last.
    """
    if times and not (math.isfinite(stated) and stated > times[-1]):
        stated = times[-1] + 1 / frame_rate
    even = len(times) / frame_rate
    return even if abs(stated - even) < ROUNDING else stated


@dataclass(frozen=True, kw_only=True)
class Source(ABC):
    """Somewhere frames come from.

    Attributes:
        name: for people to read.
        address: what `open_source` took to open it; empty for images.
        frames_wanted: those that `frames` gives.
        frame_rate: frames per second.
        timed_by: where the times of frames come from.
        times: seconds of the frames that it gave so far, by 0-based frame number.
        rate_missing: what should say the rate, such as ``seqinfo.ini``, does not, and 25 are taken.
        size: width and height of all images, pixels; None where it does not tell them.
        first_time: seconds of the first frame by the container's own clock; `times` count from it.
        length: number of frames of the whole video; None where only playing it tells.
        promised: number of frames by the header of a video file; 0 where there is none.
        live: it cannot be played again, and ends when the user says so.
        ends: a live one ends by itself, too.
        has_images: False for a sequence that is text only.
    """

    name: str
    frames_wanted: FrameRange
    address: str = ""
    frame_rate: float = DEFAULT_FRAME_RATE
    timed_by: TimedBy = "frame rate"
    times: dict[int, float] = field(default_factory=dict, compare=False)
    rate_missing: bool = False
    size: Size | None = None
    first_time: float = 0.0
    length: int | None = None
    promised: int = 0
    live: bool = False
    ends: bool = True
    has_images: bool = True

    @abstractmethod
    def frames(self) -> Iterator[Frame]:
        """The wanted frames, numbered as in the whole video; one is held at a time.

        Raises:
            RunError: the video breaks off or changes its size, or an image cannot be read.
        """

    def noted(self, frame: Frame) -> Frame:
        """The frame itself, whose time is kept."""
        self.times[frame.index] = frame.time
        return frame

    def times_of(self, frames: Sequence[int] | IntArray) -> FloatArray:
        """``(N,)`` seconds of 0-based ``frames`` ``(N,)``; ``frame_rate`` times those that it did not give."""
        numbers = np.asarray(frames).tolist()
        return np.array([self.times.get(n, n / self.frame_rate) for n in numbers], dtype=np.float64)

    @property
    def fingerprint(self) -> str:
        """32 hexadecimal digits that tell recordings from each other; empty for what cannot be played again."""
        return ""

    @property
    def likely_length(self) -> int | None:
        """How many frames the whole video has, or promises."""
        return self.length or self.promised or None

    @property
    def frames_expected(self) -> int | None:
        """How many frames are wanted, as far as it is known."""
        frame_range, length = self.frames_wanted, self.likely_length
        last = length - 1 if frame_range.last is None and length else frame_range.last
        return None if last is None else last - frame_range.first + 1

    @property
    def endless(self) -> bool:
        """Whether it does not end by itself."""
        return self.live and self.frames_wanted.last is None and not self.ends


def fingerprint_of(files: Sequence[Path]) -> str:
    """32 hexadecimal digits of the sizes of ``files``, and of the ends of the first and the last."""
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.stat().st_size.to_bytes(8, "little"))
    for path in dict.fromkeys((files[0], files[-1])):
        with path.open("rb") as file:
            digest.update(file.read(FINGERTIP))
            file.seek(max(0, path.stat().st_size - FINGERTIP))
            digest.update(file.read(FINGERTIP))
    return digest.hexdigest()[:32]


def uneven(times: Sequence[float] | FloatArray) -> dict[str, Any]:
    """How ``times`` of all frames, seconds, differ from evenly spaced ones; empty where they do not.

    >>> uneven([0.0, 0.1, 0.2, 0.5])
    {'shortest_step': 0.1, 'longest_step': 0.3, 'missing': 2}
    """
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if not (np.abs(steps - usual) > UNEVEN * usual).any():
        return {}
    missing = int(np.maximum(np.round(steps / usual) - 1, 0).sum())
    return {
        "shortest_step": round(float(steps.min()), 4),
        "longest_step": round(float(steps.max()), 4),
        "missing": missing,
    }
