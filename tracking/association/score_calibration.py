"""What a detector's scores are worth in this very video, learnt without labels.

A detection of a person is found again before and after, on one line (`recurrence`); a false one mostly is not. So the
share of detections of a score that are says how far it can be trusted, on whatever scale it is: the isotonic fit of
"found again" on the score is the probability that `DetectionCost` takes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy

from tsuiseki.tracking.association.recurrence import Recurrence
from tsuiseki.tracking.types import BoolArray, FloatArray

# What a detection is taken to be before the video has told, and how many detections that counts as much as.
EXPECTED, IN_ADVANCE = 0.9, 20


@dataclass(frozen=True)
class DetectionCost:
    """Cost of using a detection of probability p: -(offset + weight logit p) max(1, 30 / frame rate)^interval.

    Attributes:
        offset: what a detection of p = 0.5 is worth.
        weight: of the logit.
        least: p is kept within [least, 1 - least].
        interval: how much more a detection is worth where fewer are made in a second.
        again: what counts as found again.
        memory: detections that the fit, and the speed of targets, is taken from, the latest.
    """

    offset: float = 3.5
    weight: float = 1.0
    least: float = 0.1
    interval: float = 0.0
    again: Recurrence = field(default_factory=Recurrence)
    memory: int = 30_000

    def __post_init__(self) -> None:
        if not (0 < self.least < 0.5 and self.memory > 0):
            raise ValueError("expected least in (0, 0.5) and memory from 1")

    def __call__(self, probability: FloatArray, frame_rate: float) -> FloatArray:
        """``(N,)`` costs of detections of ``(N,)`` probabilities in (0, 1)."""
        kept = np.clip(probability, self.least, 1 - self.least)
        worth = self.offset + self.weight * np.log(kept / (1 - kept))
        return np.asarray(-worth * max(1.0, 30 / frame_rate) ** self.interval)


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
        probability = np.full(len(scores), EXPECTED)
        for known in (True, False):
            ours, asked = np.isnan(self._scores) != known, np.isnan(scores) != known
            if ours.any() and asked.any():
                probability[asked] = self._fit(np.nan_to_num(self._scores[ours]), self._found[ours])(scores[asked])
        count = len(self._scores)
        probability = (count * probability + IN_ADVANCE * EXPECTED) / (count + IN_ADVANCE)
        return np.asarray(np.clip(probability, self.settings.least, 1 - self.settings.least))

    def _fit(self, scores: FloatArray, found: FloatArray) -> Interpolation:
        level, which = np.unique(scores, return_inverse=True)
        weight = np.bincount(which).astype(np.float64)
        fit = scipy.optimize.isotonic_regression(np.bincount(which, found) / weight, weights=weight)
        return Interpolation(level, np.asarray(fit.x))


@dataclass(frozen=True)
class Interpolation:
    """Straight lines between points, constant beyond; a value that is not known counts as the lowest."""

    x: FloatArray
    y: FloatArray

    def __call__(self, values: FloatArray) -> FloatArray:
        """``(N,)`` at ``(N,)`` values."""
        return np.asarray(np.interp(np.nan_to_num(values, nan=self.x[0]), self.x, self.y))
