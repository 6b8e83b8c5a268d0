"""The frames of a video on which a detector runs."""

from __future__ import annotations

import sys
from collections.abc import Container
from dataclasses import dataclass


@dataclass(frozen=True)
class InferenceFrames:
    """The frames of a video on which a detector runs.

    Attributes:
        numbers: of the frames, from 0.
        stride: usual number of frames from one to the next.
    """

    numbers: Container[int]
    stride: float

    @classmethod
    def every(cls, stride: int, first: int = 0) -> InferenceFrames:
        """Every ``stride``-th frame from the ``first`` on, however long the video."""
        return cls(range(first, sys.maxsize, stride), stride)

    def at(self, frame: int) -> bool:
        """Whether the detector runs on the frame of this number."""
        # A range looks an int up at once, and other numbers one by one.
        return int(frame) in self.numbers


# Of a detector that passes over none.
ALL_INFERRED = InferenceFrames.every(1)
