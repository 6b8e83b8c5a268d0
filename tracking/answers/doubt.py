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

# Fitted on generated streets of seeds below 50 and 1100 to 1119, each with three simulated detectors: weights of a
# constant and of `crossing_features`; the share of broken paths ahead of which a line was crossed; missed crossings for
# each one found, as a factor and a power of the share of places that were filled in; and those of any line.
CROSSING_WEIGHTS = np.array([5.6, -4.2, -1.9])
BROKEN, FACTOR, POWER, ANY = 0.4, 1.6, 2.3, 0.04
# Seconds that a broken path is thought on, and heights from the border of the picture within which it leaves.
REACH, EDGE = 2.0, 0.3
LEVEL = 0.9
"""Of the intervals."""


def crossing_features(paths: Paths, found: Crossings, frame_rate: float) -> FloatArray:
    """``(C, 2)`` what speaks against each crossing, [0, 1] each.

    They are: the share of places within half a second that no detection supports, and the lack of path on the shorter
    side of the line (1 for none, 0 from a second on).
    """
    if not len(found.rows):
        return np.empty((0, 2))
    half = max(1, round(0.5 * frame_rate))
    lengths = np.diff(np.append(paths.starts, len(paths)))
    pieces = np.searchsorted(paths.starts, found.rows, "right") - 1
    start, end = paths.starts[pieces], paths.starts[pieces] + lengths[pieces] - 1
    low, high = np.maximum(found.rows - half, start), np.minimum(found.rows + half, end) + 1
    observed = np.append(0, np.cumsum(paths.observed))
    count = observed[high] - observed[low]
    shorter = np.minimum(found.rows - start, end - found.rows + 1)
    return np.column_stack(
        [
            1 - count / (high - low),
            1 - np.clip(shorter / frame_rate, 0, 1),
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
        self._filled = 1.0 - float(paths.observed.mean()) if len(paths) else 0.0

    def real(self, found: Crossings) -> FloatArray:
        """``(C,)`` probability that each crossing is one."""
        odds = CROSSING_WEIGHTS[0] + crossing_features(self.paths, found, self.rate) @ CROSSING_WEIGHTS[1:]
        return np.asarray(1 / (1 + np.exp(-odds)))

    def missed(self, line: SceneLine, found: Crossings) -> dict[int, float]:
        """Crossings of a line that are missed beside those ``found``, on average, by side."""
        ends = self._broken
        here, along = line_distances(ends.points, self.scene, line)
        there, further = line_distances(ends.ahead, self.scene, line)
        return self._missed(_between_ends(here, there, along, further), np.sign(there), found)

    def missed_at_border(self, zone: SceneZone, found: Crossings) -> dict[int, float]:
        """Likewise, of the border of a zone."""
        here, there = (inside(points, zone.corners) for points in (self._broken.points, self._broken.ahead))
        return self._missed(here != there, np.where(there, 1, -1), found)

    def _missed(self, meets: BoolArray, sides: FloatArray | IntArray, found: Crossings) -> dict[int, float]:
        each = FACTOR * self._filled**POWER
        sides = self._broken.turned * sides
        return {
            side: BROKEN * float((meets & (sides == side)).sum()) + each * float((found.sides == side).sum()) + ANY
            for side in (1, -1)
        }


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


def interval_of(count: int, false: float, missed: float) -> tuple[int, int]:
    """Ends of the interval: the likeliest numbers, as near to `LEVEL` together as can be, and the count.

    Args:
        count: found.
        false: crossings of it that are none, on average.
        missed: crossings beside it, on average.

    >>> interval_of(10, 0.0, 0.0)
    (10, 10)
    """
    from scipy.stats import poisson

    def chances(mean: float) -> FloatArray:
        return np.asarray(poisson.pmf(np.arange(int(mean + 10 * np.sqrt(mean) + 10)), mean))

    less = chances(false)
    # Of values from `count` less the most false ones on; without room for more at the ends.
    total = np.concatenate([[0.0], np.convolve(less[::-1], chances(missed)), [0.0]])
    low = high = int(total.argmax())
    held = total[low]
    while True:
        upwards = bool(total[high + 1] >= total[low - 1])
        more = max(total[high + 1], total[low - 1])
        if more == 0 or abs(held + more - LEVEL) >= abs(held - LEVEL):
            break
        held, low, high = held + more, low - (not upwards), high + upwards
    at = count - len(less)
    return max(0, min(count, at + low)), max(count, at + high)
