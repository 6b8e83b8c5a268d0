"""The frames of a video on which a detector runs."""

from __future__ import annotations

from dataclasses import dataclass

from tsuiseki.tracking.types import BoolArray


@dataclass(frozen=True)
class InferenceFrames:
    """The frames of a video on which a detector runs.

    Attributes:
        stride: usual number of frames from one to the next.
        first: frame number of the first.
        named: ``(F,)`` by frame number; by default every ``stride``-th frame.
    """

    stride: float
    first: int = 0
    named: BoolArray | None = None

    def at(self, frame: int) -> bool:
        """Whether the detector runs on the frame of this number."""
        if self.named is not None:
            return bool(self.named[frame : frame + 1].any())
        return (frame - self.first) % self.stride == 0


# Of a detector that passes over none.
EVERY_FRAME = InferenceFrames(stride=1.0)
