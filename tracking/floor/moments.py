"""Frames of several cameras that were taken together, grouped while they come; see `video.synchronise`."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from tsuiseki.tracking.video.synchronise import paired

T = TypeVar("T")


@dataclass(frozen=True)
class Together(Generic[T]):
    """What cameras took within the tolerance of each other.

    Attributes:
        time: seconds, the mean.
        views: of each camera; None of one that took nothing then.
    """

    time: float
    views: tuple[T | None, ...]


class ComingMoments(Generic[T]):
    """Groups frames as `align` does, as soon as no camera can add to a moment.

    Args:
        cameras: how many.
        tolerance: seconds within which frames count as taken together.
        hold: seconds for which a moment waits for a camera that has sent nothing since.

    Attributes:
        late: frames of each camera that came when their moment was over, and were left out.
    """

    def __init__(self, cameras: int, tolerance: float, hold: float) -> None:
        self.tolerance, self.hold, self.late = tolerance, hold, [0] * cameras
        self._coming: list[deque[tuple[float, T]]] = [deque() for _ in range(cameras)]
        self._last = float("-inf")

    def add(self, camera: int, time: float, view: T) -> bool:
        """Take the next frame of a camera; says whether it was in time."""
        in_time = time > self._last
        if in_time:
            self._coming[camera].append((time, view))
        else:
            self.late[camera] += 1
        return in_time

    def ready(self, waited_for: Collection[int], now: float) -> Iterator[Together[T]]:
        """The moments that are whole.

        Args:
            waited_for: cameras that may still add to a moment.
            now: seconds, by the clock of the frames.
        """
        while heads := {camera: coming[0] for camera, coming in enumerate(self._coming) if coming}:
            begin = min(time for time, _ in heads.values())
            if any(camera not in heads for camera in waited_for) and now - begin <= self.hold:
                return
            group = paired(heads, self.tolerance)
            for camera in group:
                self._coming[camera].popleft()
            self._last = sum(time for time, _ in group.values()) / len(group)
            views = tuple(group[camera][1] if camera in group else None for camera in range(len(self._coming)))
            # A frame that was held while its moment passed.
            for camera, coming in enumerate(self._coming):
                while coming and coming[0][0] <= self._last:
                    coming.popleft()
                    self.late[camera] += 1
            yield Together(self._last, views)
