"""How sure a count is: from the doubt in the tracks to an interval.

A crossing is real with a probability that falls with what was filled in at the line and how short the path is. Where
tracks break off near a line, a crossing may have been missed. A person who is detected in a share s of the frames has a
track at all with probability p = 1 - (1 - s)^n, and stands for (1 - p) / p people without one (Horvitz and Thompson, A
generalization of sampling without replacement, 1952, eq. 4). The true count is the number counted, less the false ones,
plus the missed ones. The false are Poisson; the mean of the missed is itself doubtful, gamma, which makes them negative
binomial.

People in a zone are counted likewise. Of their mean number and mean stay the intervals are normal: a stay errs by a
share of what was filled in, and by its ends.
"""

from __future__ import annotations

import numpy as np
import scipy

from tsuiseki.tracking.counts.crossings import Crossings, line_distances, meets
from tsuiseki.tracking.counts.paths import Paths
from tsuiseki.tracking.counts.polygons import inside
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Up to `ENDS` fitted on generated streets of seeds from 1100 on, each with three simulated detectors.

# Weights of a constant and of what speaks against a crossing, see `Doubt.real`. The constant is chosen on real video
# (MOT15, TUD, PETS, KITTI).
CROSSING_WEIGHTS = np.array([3.5, -4.2, -1.9])
# Share of broken paths ahead of which a line was crossed.
BROKEN = 0.1
# n of the head of this file: how often a person can get a track.
CHANCES = 1.9
# Shape of the gamma of the missed.
SHAPE = 0.9
# Crossings that are missed at any line, on average.
ANY = 0.05
# Share of what is filled in by which a stay errs.
FILLED = 0.6
# Share of people filled in who are not there.
ABSENT = 0.25
# Seconds by which a stay errs anyhow.
ENDS = 0.2
# Least share of frames with a detection.
LEAST_OBSERVED = 0.02
# Seconds that a broken path is thought on.
REACH = 2.0
# Heights from the border of the picture within which a path leaves it.
EDGE = 0.3
# Probability of an interval.
LEVEL = 0.9
# Half the width of a normal interval of that probability, standard deviations.
WIDTH = 1.645


class Doubt:
    """The doubt in the tracks of one video.

    Attributes:
        rate: frames a second.
        without: ``(N,)`` how many people without a track the person of each row stands for.
    """

    def __init__(self, paths: Paths, scene: Scene, rate: float, length: int) -> None:
        self.paths, self.scene, self.rate = paths, scene, rate
        self._broken = _broken_ends(paths, scene, rate, length)
        whose = np.unique(paths.ids, return_inverse=True)[1]
        detected = np.bincount(whose, paths.observed) / np.maximum(np.bincount(whose), 1)
        tracked = 1 - (1 - np.clip(detected, LEAST_OBSERVED, 1)) ** CHANCES
        self.without: FloatArray = ((1 - tracked) / tracked)[whose]

    def real(self, crossings: Crossings) -> FloatArray:
        """``(C,)`` probability that each crossing is one.

        Against it speak the share of places within half a second that no detection supports, and the lack of path on
        the shorter side of the line (1 for none, 0 from a second on).
        """
        if not len(crossings.rows):
            return np.empty(0)
        paths, half = self.paths, max(1, round(0.5 * self.rate))
        pieces = np.searchsorted(paths.starts, crossings.rows, "right") - 1
        start, end = paths.starts[pieces], paths.ends[pieces]
        low, high = np.maximum(crossings.rows - half, start), np.minimum(crossings.rows + half, end) + 1
        observed = np.append(0, np.cumsum(paths.observed))
        unsupported = 1 - (observed[high] - observed[low]) / (high - low)
        shorter = np.minimum(crossings.rows - start, end - crossings.rows + 1)
        against = np.column_stack([unsupported, 1 - np.clip(shorter / self.rate, 0, 1)])
        return np.asarray(1 / (1 + np.exp(-(CROSSING_WEIGHTS[0] + against @ CROSSING_WEIGHTS[1:]))))

    def missed(self, line: SceneLine, crossings: Crossings) -> dict[int, float]:
        """Crossings of a line that are missed beside those that were detected, on average, by side."""
        points, ahead, _ = self._broken
        here, along = line_distances(points, self.scene, line)
        there, further = line_distances(ahead, self.scene, line)
        return self._missed(meets(here, there, along, further), np.sign(there), crossings)

    def missed_at_border(self, zone: SceneZone, crossings: Crossings) -> dict[int, float]:
        """Entries to a zone and exits from it that are missed beside those that were detected, on average, by side."""
        here, there = (inside(points, zone.corners) for points in self._broken[:2])
        return self._missed(here != there, np.where(there, 1, -1), crossings)

    def _missed(self, meets: BoolArray, sides: FloatArray | IntArray, crossings: Crossings) -> dict[int, float]:
        sides, without = self._broken[2] * sides, self.without[crossings.rows]
        return {
            side: float(BROKEN * (meets & (sides == side)).sum() + without[crossings.sides == side].sum() + ANY)
            for side in (1, -1)
        }

    def of_stays(self, first: IntArray, last: IntArray, length: int) -> tuple[FloatArray, FloatArray]:
        """Ends of the intervals of the mean number of people in a zone and of their mean stay, seconds.

        Args:
            first: ``(S,)`` row of `Paths` at which each stay begins.
            last: ``(S,)`` last row.
            length: frames that were processed.
        """
        filled = np.append(0, np.cumsum(~self.paths.observed))
        seconds, without = (last - first + 1) / self.rate, self.without[first]
        errors = FILLED * (filled[last + 1] - filled[first]) / self.rate
        error = float((errors**2).sum() + len(first) * ENDS**2)
        # People without a track: mean and variance of the seconds that they stayed, and of their number.
        missed, untracked = float(without @ seconds), float(without.sum())
        spread = float((without * (1 + without)) @ seconds**2) + missed**2 / SHAPE
        total, number, duration = seconds.sum(), max(len(first), 1), max(length / self.rate, 1e-9)
        mean = total / number
        people = total - WIDTH * np.sqrt(error), total + missed + WIDTH * np.sqrt(error + spread)
        others = (untracked + untracked**2 / SHAPE) * (mean / (number + untracked)) ** 2
        width = WIDTH * np.sqrt(error / number**2 + others)
        return np.maximum(people, 0) / duration, np.maximum([mean - width, mean + width], 0)


def _broken_ends(paths: Paths, scene: Scene, rate: float, length: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Where paths begin and end in the midst of the picture and of the video, in the unit of the scene.

    Returns:
        The ends ``(B, 2)``; where the person would be `REACH` seconds later, or earlier where the path begins
        ``(B, 2)``; and 1 for ends, -1 for beginnings ``(B,)``.
    """
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
    return points, ahead, turned


def interval_of(count: int, false: float, missed: float) -> tuple[int, int]:
    """Ends of the interval: the likeliest numbers, as near to `LEVEL` together as can be, and the count.

    Args:
        count: of what was detected.
        false: crossings of it that are none, on average.
        missed: crossings beside it, on average; its gamma has the shape `SHAPE`.

    >>> interval_of(10, 0.0, 0.0)
    (10, 10)
    """
    numbers = np.arange(int(false + 10 * np.sqrt(false) + 10))
    less = np.exp(scipy.special.xlogy(numbers, false) - false - scipy.special.gammaln(numbers + 1))
    numbers = np.arange(int(missed + 10 * np.sqrt(missed + missed**2 / SHAPE) + 10))
    more_chances = np.exp(
        scipy.special.gammaln(numbers + SHAPE)
        - scipy.special.gammaln(numbers + 1)
        - scipy.special.gammaln(SHAPE)
        - SHAPE * np.log1p(missed / SHAPE)
        + scipy.special.xlogy(numbers, missed / (SHAPE + missed))
    )  # negative binomial
    # Of values from `count` less the most false ones on; without room for more at the ends.
    total = np.concatenate([[0.0], np.convolve(less[::-1], more_chances), [0.0]])
    low = high = int(total.argmax())
    held = total[low]
    while True:
        upwards = bool(total[high + 1] >= total[low - 1])
        gain = max(total[high + 1], total[low - 1])
        if gain == 0 or abs(held + gain - LEVEL) >= abs(held - LEVEL):
            break
        held, low, high = held + gain, low - (not upwards), high + upwards
    at = count - len(less)
    return max(0, min(count, at + low)), max(count, at + high)
