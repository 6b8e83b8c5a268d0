"""How sure a count is: from the doubt in the tracks to an interval.

A crossing is real with a probability that falls with what was filled in at the line and how short the path is. Where
tracks break off near a line, a crossing may have been missed. The true count is the number found, less the false ones,
plus the missed ones; both are taken to be Poisson, so that their difference has Skellam's distribution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.answers.crossings import Crossings, line_distances
from tsuiseki.tracking.answers.paths import Paths
from tsuiseki.tracking.answers.polygons import inside
from tsuiseki.tracking.answers.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Fitted on generated streets, see `trainers.experiments.answers`: weights of a constant and of `crossing_features`, and
# the share of broken paths that would have met a line and did.
CROSSING_WEIGHTS = np.array([6.0, -4.0, -4.0, -3.0])
MISSED = 0.5
# Seconds that a broken path is thought on, and heights from the border of the picture within which it leaves.
REACH, EDGE = 2.0, 0.3
LEVEL = 0.9
"""Of the intervals."""


def crossing_features(paths: Paths, found: Crossings, frame_rate: float) -> FloatArray:
    """``(C, 3)`` what speaks against each crossing, [0, 1] each.

    They are: the share of places within half a second that no detection supports, the lack of path on the shorter side
    of the line (1 for none, 0 from a second on), and 1 less the mean score within half a second.
    """
    if not len(found.rows):
        return np.empty((0, 3))
    half = max(1, round(0.5 * frame_rate))
    lengths = np.diff(np.append(paths.starts, len(paths)))
    pieces = np.searchsorted(paths.starts, found.rows, "right") - 1
    start, end = paths.starts[pieces], paths.starts[pieces] + lengths[pieces] - 1
    low, high = np.maximum(found.rows - half, start), np.minimum(found.rows + half, end) + 1
    observed = np.append(0, np.cumsum(paths.observed))
    scores = np.append(0.0, np.cumsum(np.where(paths.observed, np.clip(paths.scores, 0, 1), 0.0)))
    count = observed[high] - observed[low]
    shorter = np.minimum(found.rows - start, end - found.rows + 1)
    return np.column_stack(
        [
            1 - count / (high - low),
            1 - np.clip(shorter / frame_rate, 0, 1),
            1 - (scores[high] - scores[low]) / np.maximum(count, 1),
        ]
    )


class Doubt:
    """The doubt in the tracks of one video.

    Attributes:
        rate: frames a second.
    """

    def __init__(self, paths: Paths, scene: Scene, rate: float, length: int) -> None:
        self.paths, self.scene, self.rate = paths, scene, rate
        self._broken = broken_ends(paths, scene, rate, length)

    def real(self, found: Crossings) -> FloatArray:
        """``(C,)`` probability that each crossing is one."""
        odds = CROSSING_WEIGHTS[0] + crossing_features(self.paths, found, self.rate) @ CROSSING_WEIGHTS[1:]
        return np.asarray(1 / (1 + np.exp(-odds)))

    def missed(self, line: SceneLine) -> dict[int, float]:
        """Crossings of a line that are missed, on average, by side."""
        ends = self._broken
        here, along = line_distances(ends.points, self.scene, line)
        there, further = line_distances(ends.ahead, self.scene, line)
        meets = _between_ends(here, there, along, further)
        return _by_side(meets, ends.turned * np.sign(there))

    def missed_at_border(self, zone: SceneZone) -> dict[int, float]:
        """Crossings of the border of a zone that are missed, on average, by side."""
        ends = self._broken
        here, there = inside(ends.points, zone.corners), inside(ends.ahead, zone.corners)
        return _by_side(here != there, ends.turned * np.where(there, 1, -1))


@dataclass(frozen=True, eq=False)
class BrokenEnds:
    """Where paths begin and end in the midst of the picture and of the video.

    Attributes:
        points: ``(B, 2)`` in the unit of the scene.
        ahead: ``(B, 2)`` where the person would be `REACH` seconds later, or earlier where the path begins.
        turned: ``(B,)`` 1 for ends, -1 for beginnings.
    """

    points: FloatArray
    ahead: FloatArray
    turned: IntArray


def broken_ends(paths: Paths, scene: Scene, rate: float, length: int) -> BrokenEnds:
    """The ends of paths other than at the border of the picture and at the first and last frame."""
    parts = list[tuple[FloatArray, FloatArray, IntArray]]()
    step = max(1, round(rate))
    lengths = paths.ends - paths.starts
    for rows, sign in ((paths.ends, 1), (paths.starts, -1)):
        back = rows - sign * np.minimum(step, lengths)
        way = (paths.points[rows] - paths.points[back]) / np.maximum(np.abs(rows - back), 1)[:, None]
        ahead = paths.points[rows] + REACH * rate * way
        midst = (paths.frames[rows] > 0) & (paths.frames[rows] < length - 1) & (lengths > 0)
        if scene.unit == "pixels" and scene.size is not None:
            margin = EDGE * paths.heights[rows, None]
            point = paths.points[rows]
            midst &= ((point > margin) & (point < np.array(scene.size) - margin)).all(axis=1)
        parts.append((paths.points[rows][midst], ahead[midst], np.full(int(midst.sum()), sign)))
    points, ahead, turned = (np.concatenate(column) for column in zip(*parts, strict=True))
    return BrokenEnds(points, ahead, turned)


def _between_ends(here: FloatArray, there: FloatArray, along: FloatArray, further: FloatArray) -> BoolArray:
    """``(B,)`` which ways meet a line between its ends."""
    share = here / np.where(here == there, 1.0, here - there)
    place = along + share * (further - along)
    return np.asarray((here > 0) != (there > 0)) & (place >= 0) & (place <= 1)


def _by_side(meets: BoolArray, sides: FloatArray | IntArray) -> dict[int, float]:
    return {side: MISSED * float((meets & (sides == side)).sum()) for side in (1, -1)}


def interval_of(count: int, false: float, missed: float) -> tuple[int, int]:
    """Ends of the interval of `LEVEL` about a count.

    Args:
        count: found.
        false: crossings of it that are none, on average.
        missed: crossings beside it, on average.

    >>> interval_of(10, 0.0, 0.0)
    (10, 10)
    """
    from scipy.stats import poisson

    def chances(mean: float) -> FloatArray:
        most = int(mean + 10 * np.sqrt(mean) + 10)
        return np.asarray(poisson.pmf(np.arange(most), mean))

    less, more = chances(false), chances(missed)
    total = np.cumsum(np.convolve(less[::-1], more))
    values = count + np.arange(len(total)) - (len(less) - 1)
    tail = 0.5 * (1 - LEVEL)
    low, high = values[np.searchsorted(total, tail)], values[np.searchsorted(total, 1 - tail)]
    return max(0, min(count, int(low))), max(count, int(high))
