"""Options that the commands of `tsuiseki simulate` share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import Shared

T = TypeVar("T")
LARGEST, LONGEST = 16_384, 1_000_000


@dataclass(frozen=True)
class Length(Shared):
    """How long is drawn.

    Attributes:
        frames: length of the clip.
    """

    frames: int

    def check(self) -> None:
        """See `Shared.check`."""
        for name, most in (("frames", LONGEST), ("width", LARGEST), ("height", LARGEST)):
            value = getattr(self, name, 1)
            if not 1 <= value <= most:
                raise RequestError(f"`{name}`: expected 1 to {most}, got {value}")

    def watch(self, drawn: Iterable[T]) -> Iterator[T]:
        """Pass frames through and show how many went by."""
        return progress(drawn, "drawing", self.frames)


@dataclass(frozen=True)
class Size(Length):
    """How much is drawn.

    Attributes:
        width: of the images, pixels.
        height: of the images, pixels.
    """

    width: int = 640
    height: int = 480

    @property
    def told(self) -> str:
        """What is drawn, for people."""
        return f"{self.frames} frames of {self.width}x{self.height}"


@dataclass(frozen=True)
class Clip(Size):
    """How much is drawn, and how fast.

    Attributes:
        frame_rate: frames per second.
    """

    frame_rate: float = 25.0


def fill(output: SeededOutput, what: str, write: Callable[[Path], object]) -> int:
    """Let ``write`` fill the output folder; ``what`` is told when it is whole."""
    with output.run() as run:
        with run.times.measure("draw"):
            run.fill(write)
        run.done(f"{what}: {output.out}")
    return run.status
