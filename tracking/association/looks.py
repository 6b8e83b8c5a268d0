"""Which frames of a video were looked at, and how time passes from one look to the next.

A frame that nobody looked at says nothing: nobody is missed in it. Trackers count looks, and step their filters by the
time between them.
"""

from __future__ import annotations

import itertools
import math
from array import array
from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Looks that show a pattern, twice as many where it is not exact; the share of looks in which somebody is detected.
FEWEST, OCCUPIED = 5, 0.5
# Deviation of the interval between looks, over its mean, up to which it is a stride.
JITTER = 0.5
# A detector that finds so many in the frames around one hardly misses all of them; so often a frame is empty then.
CROWD, DROPPED = 4, 0.1
# Intervals that the usual one is taken from, and how much longer than their median one is that does not count.
MEMORY, PAUSE = 30, 5.0
# Share of an interval by which looks may be off and still are even.
EVEN = 0.01
# Steps of an average interval to which times are rounded where a grid is needed.
TICKS = 4


def looked_at(counts: IntArray) -> BoolArray | None:
    """``(F,)`` the frames that a detector was run on, by a pattern; None where it was run on all.

    Args:
        counts: ``(F,)`` detections in each frame of the video.

    >>> looked_at(np.array([2, 0, 0, 3, 0, 0, 1, 0, 0, 0, 0, 0, 2, 0, 0, 1, 0])).nonzero()[0].tolist()
    [0, 3, 6, 9, 12, 15]
    >>> looked_at(np.array([2, 0, 3, 1, 0, 0, 1, 1, 1]))
    """
    rows = np.flatnonzero(counts)
    if len(rows) < FEWEST:
        return None
    gaps, looked = np.diff(rows), counts > 0
    stride = int(np.gcd.reduce(gaps))
    if stride > 1 and len(rows) >= OCCUPIED * (1 + (rows[-1] - rows[0]) / stride):
        return np.asarray((np.arange(len(counts)) - rows[0]) % stride == 0)
    if gaps.min() > 1 and len(rows) >= 2 * FEWEST and gaps.std() <= JITTER * gaps.mean():
        return np.asarray(looked)
    # Dropped frames of a crowd: nobody where there are many before and after.
    least = np.minimum(counts[rows[:-1]], counts[rows[1:]])
    dropped = np.concatenate([np.arange(a + 1, b) for a, b in itertools.pairwise(rows)])
    dropped = dropped[np.repeat(least >= CROWD, gaps - 1)]
    if len(dropped) < DROPPED * (rows[-1] - rows[0]):
        return None
    looked = np.ones(len(counts), dtype=np.bool_)
    looked[dropped] = False
    return looked


def given_looks(frames: Iterable[int], length: int) -> BoolArray:
    """``(F,)`` the frames that are named.

    Raises:
        RequestError: they are no 0-based numbers of frames, or there is none.
    """
    given = np.asarray(list(frames) if isinstance(frames, Iterable) and not isinstance(frames, str) else frames)
    if given.ndim != 1 or not len(given) or given.dtype.kind not in "iu" or given.min() < 0:
        raise RequestError(
            f"`frames_looked_at`: expected numbers of frames from 0, such as range(0, 300, 10), got {frames!r:.80}"
        )
    looked = np.zeros(max(length, int(given.max()) + 1), dtype=np.bool_)
    looked[given] = True
    return looked


def usual(intervals: Sequence[float] | FloatArray | IntArray) -> float:
    """The mean of the intervals between looks, but for pauses."""
    known = np.asarray(intervals, dtype=np.float64)
    return float(known[known <= PAUSE * np.median(known)].mean())


def stride_of(looked: BoolArray) -> float:
    """Frames from one look to the next, usually."""
    gaps = np.diff(np.flatnonzero(looked))
    return usual(gaps) if len(gaps) else 1.0


class Clock:
    """Counts frames, and checks the times that come with them.

    Attributes:
        frame: number of the next frame.
    """

    def __init__(self) -> None:
        self.frame = 0
        self._timed: bool | None = None
        self._last = -math.inf

    def skip(self) -> None:
        """The next frame is not looked at."""
        self.frame += 1

    def now(self, time: float | None) -> float:
        """The time of a look at the next frame: in seconds where it is given, else its number.

        Raises:
            RequestError: the time is no number, lies before the last one, or is given for some frames only.
        """
        if time is not None and (isinstance(time, bool | str) or not _is_finite(time)):
            raise RequestError(f"`time`: expected seconds, got {time!r}")
        if self._timed is not None and self._timed != (time is not None):
            raise RequestError("`time`: expected with every frame or with none, got it with some")
        now = float(self.frame if time is None else time)
        if now < self._last:
            raise RequestError(f"`time`: expected {self._last:g} s or later, got {now:g}; times do not go back")
        self._timed, self._last = time is not None, now
        self.frame += 1
        return now


def _is_finite(time: object) -> bool:
    try:
        return math.isfinite(time)  # type: ignore[arg-type]
    except TypeError:
        return False


class Intervals(Clock):
    """Time in usual intervals between looks: those that come evenly are 1 apart, at whatever rate.

    Attributes:
        passed: of the last looks, how long before each the one before it was; the newest last.
    """

    def __init__(self, memory: int) -> None:
        super().__init__()
        self.passed: deque[float] = deque(maxlen=memory)
        self._intervals: deque[float] = deque(maxlen=MEMORY)
        self._usual = 0.0

    def step(self, time: float | None) -> tuple[float, float]:
        """How long before this look the last one was, and by what factor the usual interval has become longer.

        Raises:
            RequestError: see `Clock.now`.
        """
        last = self._last
        interval, before = self.now(time) - last, self._usual
        if interval == math.inf:
            self.passed.append(1.0)
            return 1.0, 1.0
        if interval > 0:
            self._intervals.append(interval)
            self._usual = usual(self._intervals)
        longer = round(self._usual / before, 9) if before else 1.0
        passed = round(interval / self._usual, 9) if self._usual else 0.0
        self.passed = deque([one / longer for one in self.passed], self.passed.maxlen)
        self.passed.append(passed)
        return passed, longer

    def since_look(self) -> float:
        """How long before the frame to come the last look was, where frames are numbered."""
        return 0.0 if self._timed or not self._usual else (self.frame - self._last) / self._usual


class Looks(Clock):
    """The frame and the time of every look, counted from the first.

    Args:
        frame_rate: frames a second.
        stride: frames from one look to the next, on average.

    Attributes:
        rate: looks a second.
        stride: as given.
        even: whether all of them came in their turn.
    """

    def __init__(self, frame_rate: float, stride: float = 1.0) -> None:
        super().__init__()
        self._frame_rate, self.rate, self.stride = frame_rate, frame_rate / stride, stride
        self.even = self.all = True
        self._count, self._start = 0, 0.0
        self._frames, self._seconds = array("q"), array("d")

    def copy(self) -> Looks:
        """A copy that goes on by itself."""
        other = Looks(self._frame_rate, self._frame_rate / self.rate)
        other.__dict__.update(self.__dict__)
        other._frames, other._seconds = self._frames[:], self._seconds[:]
        return other

    def add(self, time: float | None) -> None:
        """Take the next look; see `Clock.now`."""
        frame, now = self.frame, self.now(time)
        seconds = now if time is not None else now / self._frame_rate
        self._start = seconds if self._count == 0 else self._start
        seconds -= self._start
        self.even &= abs(seconds * self.rate - self._count) < EVEN
        self.all &= frame == self._count
        if not (self.even and self.all):
            # What came before was in its turn, and is kept only now.
            before = np.arange(len(self._frames), self._count)
            self._frames.extend([*before.tolist(), frame])
            self._seconds.extend([*(before / self.rate).tolist(), seconds])
        self._count += 1

    def frames(self, looks: IntArray) -> IntArray:
        """``(N,)`` the frames of ``(N,)`` looks."""
        return looks if self.all else np.array(self._frames)[looks]

    def ticks(self, looks: IntArray) -> IntArray:
        """``(N,)`` whole numbers that grow as the times of ``(N,)`` looks do, `TICKS` a look on average."""
        if self.even:
            return looks
        every = np.arange(len(self._seconds))
        ticks = np.rint(np.array(self._seconds) * self.rate * TICKS).astype(np.int64)
        return np.asarray((np.maximum.accumulate(ticks - every) + every)[looks])

    @property
    def ticks_per_look(self) -> int:
        """On average."""
        return 1 if self.even else TICKS

    def rates(self, first: int, count: int) -> FloatArray:
        """``(count,)`` of looks from ``first`` on: one over the seconds since the look before."""
        if self.even:
            return np.full(count, self.rate)
        passed = np.diff(self.seconds(np.maximum(np.arange(first - 1, first + count), 0)))
        return np.asarray(1 / np.maximum(passed, 1 / (self.rate * TICKS)))

    def seconds(self, looks: IntArray) -> FloatArray:
        """``(N,)`` the times of ``(N,)`` looks."""
        return looks / self.rate if self.even else np.array(self._seconds)[looks]
