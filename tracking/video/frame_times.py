"""When the frames of a video were taken: what the container says, where it says it, and how evenly they lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import cv2
import numpy as np

from tsuiseki.tracking.types import FloatArray, Frame, IntArray

TimedBy = Literal["container", "frame rate", "arrival"]
"""Where the times of frames come from."""
# Containers round times to milliseconds.
ROUNDING = 0.0015
# From this share of the usual step on two frames are not as far apart as the others.
UNEVEN = 0.25


def stated_rate(capture: cv2.VideoCapture) -> float | None:
    """Frames a second, as an open capture says; None where that is none."""
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    return rate if math.isfinite(rate) and 0 < rate <= 1000 else None


def container_time(stated: float, before: Sequence[float], frame_rate: float) -> float:
    """Seconds since the first frame of a video.

    Args:
        stated: the container's time since the first frame, seconds; anything where it has none.
        before: times of the frames before, seconds.
        frame_rate: a second; a time that agrees with it but for rounding is ``len(before) / frame_rate`` exactly, and a
            time that does not increase is taken to be a frame after the last.
    """
    if before and not (math.isfinite(stated) and stated > before[-1]):
        stated = before[-1] + 1 / frame_rate
    even = len(before) / frame_rate
    return even if abs(stated - even) < ROUNDING else stated


@dataclass
class NotedTimes:
    """Times of the frames that a source gave.

    Attributes:
        noted: seconds, by 0-based frame number.
    """

    noted: dict[int, float] = field(default_factory=dict)

    def note(self, frame: Frame) -> Frame:
        """The frame itself."""
        self.noted[frame.index] = frame.time
        return frame

    def at(self, frames: Sequence[int] | IntArray, frame_rate: float) -> FloatArray:
        """``(N,)`` seconds of 0-based ``frames`` ``(N,)``; ``frame_rate`` times those that were not given."""
        return np.array([self.noted.get(n, n / frame_rate) for n in np.asarray(frames).tolist()], dtype=np.float64)


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
