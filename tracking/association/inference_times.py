"""The frames on which a detector ran (inferences), and the time from one inference to the next.

A frame without inference is no evidence: it has no misses. Trackers count inferences, and step their filters by the
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
from tsuiseki.tracking.types.inference_frames import InferenceFrames

# Inferences that show a pattern, twice as many where it is not exact.
FEWEST = 5
# Least share of the frames of a pattern that have detections.
OCCUPIED = 0.5
# Deviation of the interval between inferences, over its mean, up to which it is a stride.
JITTER = 0.5
# A detector with so many detections in the frames before and after one hardly misses all of them.
CROWD = 4
# Least share of frames that are empty all the same, from which on such frames count as dropped.
DROPPED = 0.1
# Latest intervals that the usual one is taken from.
MEMORY = 30
# An interval longer than this many medians is a pause, and does not count.
PAUSE = 5.0
# Share of an interval by which inferences may be off and still are even.
EVEN = 0.01
# Inferences that are forgotten at a time.
FORGOTTEN = 1000
# Steps of an average interval to which times are rounded where a grid is needed.
TICKS = 4


def inferred_frames(counts: IntArray) -> BoolArray | None:
    """``(F,)`` the frames with inference, by a pattern of the counts; None where all have it.

    Args:
        counts: ``(F,)`` detections in each frame of the video.

    >>> inferred_frames(np.array([2, 0, 0, 3, 0, 0, 1, 0, 0, 0, 0, 0, 2, 0, 0, 1, 0])).nonzero()[0].tolist()
    [0, 3, 6, 9, 12, 15]
    >>> inferred_frames(np.array([2, 0, 3, 1, 0, 0, 1, 1, 1]))
    """
    rows = np.flatnonzero(counts)
    if len(rows) < FEWEST:
        return None
    gaps, inferred = np.diff(rows), counts > 0
    stride = int(np.gcd.reduce(gaps))
    if stride > 1 and len(rows) >= OCCUPIED * (1 + (rows[-1] - rows[0]) / stride):
        return np.asarray((np.arange(len(counts)) - rows[0]) % stride == 0)
    if gaps.min() > 1 and len(rows) >= 2 * FEWEST and gaps.std() <= JITTER * gaps.mean():
        return np.asarray(inferred)
    # Dropped frames of a crowd: none detected where there are many before and after.
    least = np.minimum(counts[rows[:-1]], counts[rows[1:]])
    dropped = np.concatenate([np.arange(a + 1, b) for a, b in itertools.pairwise(rows)])
    dropped = dropped[np.repeat(least >= CROWD, gaps - 1)]
    if len(dropped) < DROPPED * (rows[-1] - rows[0]):
        return None
    inferred = np.ones(len(counts), dtype=np.bool_)
    inferred[dropped] = False
    return inferred


def named_frames(frames: Iterable[int]) -> InferenceFrames:
    """The frames that are named; a range may go on beyond the end of any video.

    Raises:
        RequestError: they are no 0-based numbers of frames, or there is none.
    """
    if isinstance(frames, range) and len(frames) > 1 and 0 <= frames.start < frames.stop:
        return InferenceFrames(frames, float(frames.step))
    numbers = np.asarray(list(frames) if isinstance(frames, Iterable) and not isinstance(frames, str) else frames)
    if numbers.ndim != 1 or not len(numbers) or numbers.dtype.kind not in "iu" or numbers.min() < 0:
        raise RequestError(
            f"`inference_frames`: expected numbers of frames from 0, such as range(0, 300, 10), got {frames!r:.80}"
        )
    gaps = np.diff(numbers := np.unique(numbers))
    return InferenceFrames(frozenset(numbers.tolist()), usual(gaps) if len(gaps) else 1.0)


def usual(intervals: Sequence[float] | FloatArray | IntArray) -> float:
    """The mean of the intervals between inferences, but for pauses."""
    values = np.asarray(intervals, dtype=np.float64)
    return float(values[values <= PAUSE * np.median(values)].mean())


def stride_of(inferred: BoolArray) -> float:
    """Usual number of frames from one inference to the next."""
    gaps = np.diff(np.flatnonzero(inferred))
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
        """The next frame has no inference."""
        self.frame += 1

    def now(self, time: float | None) -> float:
        """The time of the inference on the next frame: in seconds where it is given, else its number.

        Raises:
            RequestError: the time is no number, lies before the last one, or is given for some frames only.
        """
        if time is not None and (isinstance(time, bool | str) or not _is_finite(time)):
            raise RequestError(f"`time`: expected seconds, got {time!r}")
        if self._timed is not None and self._timed != (time is not None):
            raise RequestError("`time`: expected with every frame or with none, got it with some")
        now = float(self.frame if time is None else time)
        if now < self._last:
            raise RequestError(f"`time`: expected {self._last} s or later, got {now}; times do not go back")
        self._timed, self._last = time is not None, now
        self.frame += 1
        return now


def _is_finite(time: object) -> bool:
    try:
        return math.isfinite(time)  # type: ignore[arg-type]
    except TypeError:
        return False


class Intervals(Clock):
    """Time in usual intervals between inferences: those that come evenly are 1 apart, at whatever rate.

    Attributes:
        passed: usual intervals before each of the last inferences, the newest last.
    """

    def __init__(self, memory: int) -> None:
        super().__init__()
        self.passed: deque[float] = deque(maxlen=memory)
        self._intervals: deque[float] = deque(maxlen=MEMORY)
        self._usual = 0.0

    def step(self, time: float | None) -> tuple[float, float]:
        """Usual intervals since the last inference, and the factor by which the usual interval has become longer.

        Raises:
            RequestError: see `Clock.now`.
        """
        last = self._last
        interval, previous = self.now(time) - last, self._usual
        if interval == math.inf:
            self.passed.append(1.0)
            return 1.0, 1.0
        if interval > 0:
            self._intervals.append(interval)
            self._usual = usual(self._intervals)
        longer = round(self._usual / previous, 9) if previous else 1.0
        passed = round(interval / self._usual, 9) if self._usual else 0.0
        self.passed = deque([span / longer for span in self.passed], self.passed.maxlen)
        self.passed.append(passed)
        return passed, longer

    def since_last(self) -> float:
        """Usual intervals from the last inference to the next frame; 0 where times are given."""
        return 0.0 if self._timed or not self._usual else (self.frame - self._last) / self._usual


class InferenceTimes(Clock):
    """The frame and the time of every inference, counted from the first.

    Args:
        frame_rate: frames a second.
        stride: frames from one inference to the next, on average.

    Attributes:
        rate: inferences a second.
        stride: as given.
        even: whether all of them come at one interval.
    """

    def __init__(self, frame_rate: float, stride: float = 1.0) -> None:
        super().__init__()
        self._frame_rate, self.rate, self.stride = frame_rate, frame_rate / stride, stride
        self.even = self.all = True
        self._count, self._start = 0, 0.0
        self._frames, self._seconds = array("q"), array("d")
        # How many inferences are forgotten, and how far their ticks ran ahead of their numbers.
        self._forgotten, self._ahead = 0, np.iinfo(np.int64).min

    def copy(self) -> InferenceTimes:
        """A copy that goes on by itself."""
        clone = InferenceTimes(self._frame_rate, self._frame_rate / self.rate)
        clone.__dict__.update(self.__dict__)
        clone._frames, clone._seconds = self._frames[:], self._seconds[:]
        return clone

    def add(self, time: float | None) -> None:
        """Take the next inference; see `Clock.now`."""
        frame, now = self.frame, self.now(time)
        seconds = now if time is not None else now / self._frame_rate
        self._start = seconds if self._count == 0 else self._start
        seconds -= self._start
        self.even &= abs(seconds * self.rate - self._count) < EVEN
        self.all &= frame == self._count
        if not (self.even and self.all):
            # Those before came at one interval, and are kept only now.
            earlier = np.arange(self._forgotten + len(self._frames), self._count)
            self._frames.extend([*earlier.tolist(), frame])
            self._seconds.extend([*(earlier / self.rate).tolist(), seconds])
        self._count += 1

    def forget(self, first: int) -> None:
        """Nobody asks for inferences before ``first`` any more."""
        if self.even and self.all:
            self._forgotten = max(self._forgotten, first)
        elif first - self._forgotten >= FORGOTTEN:
            numbers = np.arange(self._forgotten, first)
            self._ahead = max(self._ahead, int((self._rounded()[: len(numbers)] - numbers).max()))
            del self._frames[: len(numbers)], self._seconds[: len(numbers)]
            self._forgotten = first

    def frames(self, inferences: IntArray) -> IntArray:
        """``(N,)`` the frames of ``(N,)`` inferences."""
        return inferences if self.all else np.array(self._frames)[inferences - self._forgotten]

    def _rounded(self) -> IntArray:
        return np.rint(np.array(self._seconds) * self.rate * TICKS).astype(np.int64)

    def ticks(self, inferences: IntArray) -> IntArray:
        """``(N,)`` whole numbers that grow as the times of ``(N,)`` inferences do, `TICKS` an inference on average."""
        if self.even:
            return inferences
        numbers = np.arange(self._forgotten, self._forgotten + len(self._seconds))
        ahead = np.maximum(np.maximum.accumulate(self._rounded() - numbers), self._ahead)
        return np.asarray((ahead + numbers)[inferences - self._forgotten])

    @property
    def ticks_per_inference(self) -> int:
        """Ticks from one inference to the next, on average."""
        return 1 if self.even else TICKS

    def rates(self, first: int, count: int) -> FloatArray:
        """``(count,)`` of inferences from ``first`` on: one over the seconds since the inference before."""
        if self.even:
            return np.full(count, self.rate)
        passed = np.diff(self.seconds(np.maximum(np.arange(first - 1, first + count), 0)))
        return np.asarray(1 / np.maximum(passed, 1 / (self.rate * TICKS)))

    def seconds(self, inferences: IntArray) -> FloatArray:
        """``(N,)`` the times of ``(N,)`` inferences."""
        return inferences / self.rate if self.even else np.array(self._seconds)[inferences - self._forgotten]
