"""Frames of which something is to be told, as runs of neighbours: an hour without news takes no more than a second."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator


class FrameRuns:
    """Frames that come in increasing order.

    Args:
        frames: to begin with.

    Attributes:
        runs: first and last frame of each run of neighbours.

    >>> runs = FrameRuns([3, 7, 8, 9])
    >>> runs.runs, len(runs), 8 in runs, 5 in runs
    ([(3, 3), (7, 9)], 4, True, False)
    """

    def __init__(self, frames: Iterable[int] = ()) -> None:
        self.runs: list[tuple[int, int]] = []
        self._count = 0
        for frame in frames:
            self.append(frame)

    def append(self, frame: int) -> None:
        """Add a frame that comes after all others."""
        first, last = self.runs[-1] if self.runs else (frame, -1)
        if self.runs and frame <= last:
            raise ValueError(f"expected a frame after {last}, got {frame}")
        if self.runs and frame == last + 1:
            self.runs[-1] = first, frame
        else:
            self.runs.append((frame, frame))
        self._count += 1

    def copy(self) -> FrameRuns:
        """A copy that goes on by itself."""
        other = FrameRuns()
        other.runs, other._count = [*self.runs], self._count
        return other

    def from_one(self) -> list[list[int]]:
        """First and last frame of each run, counted from 1."""
        return [[first + 1, last + 1] for first, last in self.runs]

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[int]:
        return (frame for first, last in self.runs for frame in range(first, last + 1))

    def __contains__(self, frame: object) -> bool:
        if not isinstance(frame, int):
            return False
        place = bisect_right(self.runs, (frame, frame)) - 1
        return any(first <= frame <= last for first, last in self.runs[max(place, 0) : place + 2])
