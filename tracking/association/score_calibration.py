"""What a detector's scores are worth in this very video, learnt without labels.

A detection of a person is found again in the frames before and after it; a false one mostly is not. So the share of
detections of a score that are borne out by a neighbour in time says how far that score can be trusted, on whatever
scale it is: the isotonic fit of "borne out" on the score is the probability that `DetectionCost` takes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import isotonic_regression

from tsuiseki.tracking.association.nearby import centres, near_pairs, sizes
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class DetectionCost:
    """Cost of using a detection of probability p: -(offset + weight logit p) times the weight of a frame.

    Neighbouring frames err together: at 10 frames a second a detection says more than at 30. Its weight is the square
    root of the time between two frames in thirtieths of a second, at least 1.

    Attributes:
        offset: what a detection of p = 0.5 is worth.
        weight: of the logit.
        least: p is kept within [least, 1 - least].
        overlap: intersection over union with a box of the next frame that bears a detection out.
        speed: heights a second that such a box may be moved beforehand, beyond a thirtieth of a second.
        memory: detections that the fit is made on, the latest.
    """

    offset: float = 3.0
    weight: float = 0.5
    least: float = 0.02
    overlap: float = 0.6
    speed: float = 1.0
    memory: int = 30_000

    def __post_init__(self) -> None:
        if not (0 < self.least < 0.5 and 0 < self.overlap < 1 and self.speed >= 0 and self.memory > 0):
            raise ValueError("expected least in (0, 0.5), overlap in (0, 1), speed from 0 and memory from 1")

    def __call__(self, probability: FloatArray, frame_rate: float) -> FloatArray:
        """``(N,)`` costs of detections of ``(N,)`` probabilities in (0, 1)."""
        logit = np.log(probability / (1 - probability))
        return np.asarray(-(self.offset + self.weight * logit) * np.sqrt(max(1.0, 30 / frame_rate)))


def borne_out(
    frames: IntArray, boxes: FloatArray, settings: DetectionCost, frame_rate: float
) -> tuple[BoolArray, BoolArray]:
    """Which detections are found again in the frame before, and which in the frame after.

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels, as if the camera stood still.
        settings: what counts as found again.
        frame_rate: frames a second.
    """
    before, after = np.zeros(len(frames), np.bool_), np.zeros(len(frames), np.bool_)
    if len(frames) == 0:
        return before, after
    every, centre, height = np.arange(len(frames)), centres(boxes), sizes(boxes).max(axis=1)[:, None]
    slack = settings.speed * max(0.0, 1 / frame_rate - 1 / 30) * height
    i, j = near_pairs(frames, centre, np.repeat(0.5 * height + slack, 2, axis=1), 1, every, every)
    move = centre[i] - centre[j]
    length = np.maximum(np.hypot(*move.T)[:, None], 1e-9)
    move *= np.minimum(1, slack[i] / length)
    again = iou_pairs(boxes[i], boxes[j] + np.concatenate([move, move], axis=1)) > settings.overlap
    after[i[again]] = True
    before[j[again]] = True
    return before, after


@dataclass
class ScoreCalibration:
    """The probability of every score, from the detections seen so far.

    Attributes:
        settings: of the fit.
    """

    settings: DetectionCost = field(default_factory=DetectionCost)
    _scores: FloatArray = field(default_factory=lambda: np.empty(0))
    _found: FloatArray = field(default_factory=lambda: np.empty(0))

    def add(self, scores: FloatArray, found: BoolArray) -> None:
        """Take ``(N,)`` scores, NaN where there is none, and whether each was found again."""
        self._scores = np.append(self._scores, scores)[-self.settings.memory :]
        self._found = np.append(self._found, found.astype(np.float64))[-self.settings.memory :]

    def __call__(self, scores: FloatArray) -> FloatArray:
        """``(N,)`` probabilities of ``(N,)`` scores; those without a score share one."""
        probability = np.full(len(scores), 0.9)
        for known in (True, False):
            ours, asked = np.isnan(self._scores) != known, np.isnan(scores) != known
            if ours.any() and asked.any():
                probability[asked] = self._fit(np.nan_to_num(self._scores[ours]), self._found[ours])(scores[asked])
        return np.asarray(np.clip(probability, self.settings.least, 1 - self.settings.least))

    def _fit(self, scores: FloatArray, found: FloatArray) -> Interpolation:
        level, which = np.unique(scores, return_inverse=True)
        weight = np.bincount(which).astype(np.float64)
        fit = isotonic_regression(np.bincount(which, found) / weight, weights=weight)
        return Interpolation(level, np.asarray(fit.x))


@dataclass(frozen=True)
class Interpolation:
    """Straight lines between points, constant beyond; a value that is not known counts as the lowest."""

    x: FloatArray
    y: FloatArray

    def __call__(self, values: FloatArray) -> FloatArray:
        """``(N,)`` at ``(N,)`` values."""
        return np.asarray(np.interp(np.nan_to_num(values, nan=self.x[0]), self.x, self.y))
