"""Cameras that exist in a test alone: what they send, and when, by a clock that costs no time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.live import LiveClock, LiveSource, TimedPicture


@dataclass
class Hours:
    """A clock that is moved by those who wait; its time of day may be set."""

    now: float = 0.0
    set_by: float = 0.0
    slept: list[float] = field(default_factory=list)

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds

    @property
    def clock(self) -> LiveClock:
        return LiveClock(lambda: self.now, lambda: self.now + self.set_by, self.sleep)


# What one connection sends: seconds at which pictures come, and what they show by their number.
@dataclass(frozen=True)
class Sends:
    times: Sequence[float]
    image: Callable[[int], ImageArray] = lambda _: np.zeros((48, 64, 3), np.uint8)


class ScriptedReader:
    head = None
    broken = False

    def __init__(self, hours: Hours, sends: Sends | None) -> None:
        self.hours, self.sends, self.count = hours, sends, 0

    def next(self, seconds: float) -> TimedPicture | None:
        sends = self.sends
        times = () if sends is None else sends.times
        while self.count < len(times) and times[self.count] < self.hours.now:
            self.count += 1
        if self.count >= len(times) or times[self.count] > self.hours.now + seconds:
            self.hours.now += seconds
            return None
        assert sends is not None
        self.hours.now, number = times[self.count], self.count
        self.count += 1
        return TimedPicture(self.hours.now, number, sends.image(number))

    def stop(self) -> None:
        pass


@dataclass(frozen=True, kw_only=True)
class ScriptedCamera(LiveSource):
    """Sends what ``plan`` says for the connection of each moment: the first entry that ends later; else nothing."""

    hours: Hours = field(default_factory=Hours)
    plan: Sequence[Sends] = ()

    @property
    def waits(self) -> bool:
        return True

    def _reader(self) -> Any:
        later = (sends for sends in self.plan if len(sends.times) and sends.times[-1] >= self.hours.now)
        return ScriptedReader(self.hours, next(later, None))


def camera(plan: Sequence[Sends], rate: float = 1.0, last: int | None = None, **details: Any) -> ScriptedCamera:
    hours = details.pop("hours", None) or Hours()
    wanted = FrameRange(0, last)
    return ScriptedCamera(
        name="door", frames_wanted=wanted, frame_rate=rate, hours=hours, clock=hours.clock, plan=plan, **details
    )
