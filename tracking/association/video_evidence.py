"""Which detections are repeated in neighbouring frames, and how fast they move: learnt from the video, without labels.

A person is detected a little earlier, now, and a little later, on one line: of boxes b₋, b, b₊ at equal intervals the
mean of the outer two lies on the middle one. A false positive mostly has no such neighbours. Nothing is assumed about
how fast targets move, so a fast car is confirmed as well as a person who stands.

The same triples give the speed of targets, (centre₊ − centre₋) / 2τ in longer sides a second. It scales the velocities
that the flow expects, their changes, and the reach of links.

A right detection is not repeated where the detector misses the person before or after, or misplaces the box. The b₋ of
a triple is probably right, and has a later neighbour. The share of those b₋ that have an earlier one, too, estimates
the rate of one side. The square of it estimates the share of right detections with both neighbours.

Triples also calibrate the detector's scores in this video. The share of detections of a score that are repeated
(`repeated_detections`) says how far it can be trusted, on whatever scale it is: the isotonic fit of
"repeated" on the score is the probability that `DetectionCost` takes.

`VideoEvidence` gathers all three: the worth of scores, speeds, and what is missed. Before anything is known the priors
below are taken, with the weight of `IN_ADVANCE` detections.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import scipy
from pydantic import Field
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.detection_tables import boxes_of_frames
from tsuiseki.tracking.association.nearby import dense_reach, near_pairs, nearest, ranges, sizes
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.geometry import centres, iou_pairs
from tsuiseki.tracking.types import BoolArray, Columns, Detections, FloatArray, IntArray

# Detections that scores and speeds are taken from, the latest.
MEMORY = 30_000
# Prior probability of a detection to be repeated.
EXPECTED = 0.9
# Number of detections that the priors weigh as much as.
IN_ADVANCE = 20
# Prior speed of targets, longer sides a second.
EXPECTED_SPEED = 0.75
# Least speed that is reported, longer sides a second.
LEAST_SPEED = 0.5
# Seconds to the earlier and to the later box, at least a frame.
INTERVAL = 0.1
# Intersection over union of a box with the mean of the two, from which it lies on a line with them.
ON_LINE = 0.6
# How far a box may move at any rate, longer sides.
REACH = 0.3
# What is added to that with time, longer sides a second.
SPEED = 6.0
# Largest difference of log widths and of log heights.
CHANGE = 0.7
# By how much probabilities may leave [0, 1] in half precision.
HALF_PRECISION = 1e-3


def interval_frames(frame_rate: float, stride: int = 1) -> int:
    """`INTERVAL` in frames, of which every ``stride``-th one has detections."""
    return stride * max(1, round(INTERVAL * frame_rate / stride))


@dataclass(frozen=True)
class RepeatedDetections:
    """Which of N detections lie between an earlier and a later one.

    Attributes:
        repeated: ``(N,)`` whether it does.
        speed: ``(N,)`` of the best triple in longer sides a second, NaN where there is none.
        earlier: ``(N,)`` index of the earlier detection of the best triple, -1 where there is none.
    """

    repeated: BoolArray
    speed: FloatArray
    earlier: IntArray


def repeated_detections(
    frames: IntArray, boxes: FloatArray, frame_rate: float, stride: int = 1, times: FloatArray | None = None
) -> RepeatedDetections:
    """Which detections lie between an earlier and a later one, and how fast those that do move.

    Args:
        frames: ``(N,)`` increasing.
        boxes: ``(N, 4)`` pixels, as if the camera stood still.
        frame_rate: frames a second.
        stride: detections are in every ``stride``-th frame, see `VideoEvidence.stride`.
        times: ``(N,)`` seconds, where frames do not follow each other at one interval.
    """
    speed, earlier = np.full(len(frames), np.nan), np.full(len(frames), -1)
    if len(frames) == 0:
        return RepeatedDetections(earlier >= 0, speed, earlier)
    centre, size = centres(boxes), sizes(boxes)
    gap = interval_frames(frame_rate, stride)
    side = size.max(axis=1)
    reach = np.repeat((REACH + SPEED * gap / frame_rate) * side[:, None], 2, axis=1)
    dense = dense_reach(frames, boxes)
    i, j = near_pairs(frames, centre, reach if dense is None else np.minimum(reach, dense), gap)
    if dense is not None:
        i, j = nearest(i, j, frames, centre.T)
    similar = (np.abs(np.log(size[j] / size[i])) < CHANGE).all(axis=1)
    previous, middle, following = _triples(i[similar], j[similar], len(frames))
    share, span = np.full((len(middle), 1), 0.5), np.full(len(middle), 2.0 * gap)
    if times is not None:
        span = np.maximum(times[following] - times[previous], 1e-6) * frame_rate
        share = ((times[middle] - times[previous]) * frame_rate / span)[:, None]
    fit = iou_pairs(boxes[previous] * (1 - share) + boxes[following] * share, boxes[middle])
    good = fit > ON_LINE
    previous, middle, following, fit, span = previous[good], middle[good], following[good], fit[good], span[good]
    # Ascending, so that the best triple of a box is written last.
    order = np.argsort(fit, kind="stable")
    previous, middle, following, span = previous[order], middle[order], following[order], span[order]
    earlier[middle] = previous
    speed[middle] = np.hypot(*(centre[following] - centre[previous]).T) * frame_rate / span / side[middle]
    return RepeatedDetections(earlier >= 0, speed, earlier)


def _triples(i: IntArray, j: IntArray, count: int) -> tuple[IntArray, IntArray, IntArray]:
    """Pairs that follow each other: the head of the first is the tail of the second."""
    order = np.argsort(i, kind="stable")
    start = np.searchsorted(i[order], np.arange(count + 1))
    first, second = ranges(start[j], np.diff(start)[j])
    return i[first], j[first], j[order[second]]


@pydantic_dataclass(frozen=True, config=SETTINGS)
class DetectionCost:
    """Cost of using a detection of probability p: -(offset + weight logit p) max(1, 30 / frame rate)^interval.

    Attributes:
        offset: what a detection of p = 0.5 is worth.
        weight: of the logit.
        least: p is kept within [least, 1 - least].
        interval: how much more a detection is worth where fewer are made in a second.
    """

    offset: float = 3.5
    weight: float = 1.0
    least: Annotated[float, Field(gt=0, lt=0.5)] = 0.1
    interval: float = 0.0

    def __call__(self, probability: FloatArray, frame_rate: float) -> FloatArray:
        """``(N,)`` costs of detections of ``(N,)`` probabilities in (0, 1)."""
        clipped = np.clip(probability, self.least, 1 - self.least)
        worth = self.offset + self.weight * np.log(clipped / (1 - clipped))
        return np.asarray(-worth * max(1.0, 30 / frame_rate) ** self.interval)


@dataclass(frozen=True)
class _RecentDetections(Columns):
    """The detections of the last frames; boxes ``(N, 4)`` as if the camera stood still, times in seconds."""

    frames: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    boxes: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    scores: FloatArray = field(default_factory=lambda: np.empty(0))
    times: FloatArray = field(default_factory=lambda: np.empty(0))


class VideoEvidence:
    """Scores, speeds and misses, learnt from detections as soon as the later ones have come.

    Args:
        settings: how the probability of scores is fitted.
        frame_rate: frames a second.
    """

    def __init__(self, settings: DetectionCost, frame_rate: float) -> None:
        self._settings, self._frame_rate = settings, frame_rate
        self._recent = _RecentDetections()
        # The frame from which on detections are not counted yet, the first with any, and the divisor of `stride`.
        self._counted_until, self._first, self._divisor = 0, -1, 0
        # Of the latest detections counted: scores, and whether each was repeated; and the speeds that are known.
        self._scores, self._repeated, self._speeds = np.empty(0), np.empty(0), np.empty(0)
        # Detections of which one side is known to be there, and those of them that were repeated.
        self._one_sided = self._two_sided = 0

    def copy(self) -> VideoEvidence:
        """A copy that goes on by itself."""
        return copy(self)

    def probability(self, scores: FloatArray) -> FloatArray:
        """``(N,)`` probabilities that detections of ``(N,)`` scores are repeated; those without a score share one."""
        probability = np.full(len(scores), EXPECTED)
        for scored in (True, False):
            learnt, rows = np.isnan(self._scores) != scored, np.isnan(scores) != scored
            if learnt.any() and rows.any():
                probability[rows] = _isotonic_fit(
                    np.nan_to_num(self._scores[learnt]), self._repeated[learnt], scores[rows]
                )
        count = len(self._scores)
        probability = (count * probability + IN_ADVANCE * EXPECTED) / (count + IN_ADVANCE)
        return np.asarray(np.clip(probability, self._settings.least, 1 - self._settings.least))

    def rate_of_right(self) -> float:
        """Share of the right detections that are repeated, in (0, 1]: the square of the share on one side."""
        return ((self._two_sided + IN_ADVANCE * EXPECTED) / (self._one_sided + IN_ADVANCE)) ** 2

    def right(self, scores: FloatArray) -> FloatArray:
        """``(N,)`` probabilities of ``(N,)`` scores being right: repeated, or missed before or after."""
        return np.minimum(self.probability(scores) / self.rate_of_right(), 1)

    def speed(self) -> float:
        """The speed that nine of ten detections stay below, longer sides a second."""
        speeds = np.append(self._speeds, np.full(IN_ADVANCE, EXPECTED_SPEED))
        return max(LEAST_SPEED, float(np.quantile(speeds, 0.9)))

    def stride(self) -> int:
        """Every how many frames there are detections: the greatest common divisor of the gaps between frames with any.

        A detector that runs on every third frame repeats no box a frame later, however right it is.
        Where times between detections have no common divisor of up to a second, there is no rhythm.
        """
        return self._divisor if 1 < self._divisor <= self._frame_rate else 1

    def add(
        self, frames: IntArray, boxes: FloatArray, scores: FloatArray, last: int, times: FloatArray | None = None
    ) -> None:
        """Take the detections of the next frames, and count those before them.

        Args:
            frames: ``(N,)`` increasing.
            boxes: ``(N, 4)`` pixels, as if the camera stood still.
            scores: ``(N,)``, NaN where there is none.
            last: the newest frame, with detections or without.
            times: ``(N,)`` seconds, where frames do not follow each other at one interval.
        """
        if len(frames) and self._divisor != 1:
            self._first = int(frames.min()) if self._first < 0 else self._first
            self._divisor = int(np.gcd.reduce(np.append(np.unique(frames) - self._first, self._divisor)))
        rate, stride = self._frame_rate, self.stride()
        gap = interval_frames(rate, stride)
        new = _RecentDetections(frames, boxes, scores, frames / rate if times is None else times)
        recent = self._recent.and_then(new)
        uneven = None if times is None else recent.times
        triples = repeated_detections(recent.frames, recent.boxes, rate, stride, uneven)
        repeated = triples.repeated
        counted = (recent.frames >= max(self._counted_until, gap)) & (recent.frames <= last - gap)
        speeds = triples.speed[counted]
        self._scores = np.append(self._scores, recent.scores[counted])[-MEMORY:]
        self._repeated = np.append(self._repeated, repeated[counted].astype(np.float64))[-MEMORY:]
        self._speeds = np.append(self._speeds, speeds[~np.isnan(speeds)])[-MEMORY:]
        # The earlier neighbours of those on a line; the first ones of the video have no neighbour before them.
        earlier_repeated = repeated[triples.earlier[counted & repeated & (recent.frames >= 2 * gap)]]
        self._one_sided += len(earlier_repeated)
        self._two_sided += int(earlier_repeated.sum())
        self._counted_until = max(self._counted_until, last - gap + 1)
        self._recent = recent.select(recent.frames >= last - 3 * gap + 1)


def _isotonic_fit(scores: FloatArray, repeated: FloatArray, queries: FloatArray) -> FloatArray:
    """``(N,)`` the isotonic fit at the scores that are asked for, on straight lines between those that came."""
    level, which = np.unique(scores, return_inverse=True)
    weight = np.bincount(which).astype(np.float64)
    fit = scipy.optimize.isotonic_regression(np.bincount(which, repeated) / weight, weights=weight)
    return np.asarray(np.interp(np.nan_to_num(queries, nan=level[0]), level, np.asarray(fit.x)))


class ScoreScale:
    """Turns scores that are no probabilities, such as logits or percent, into that of being right in this video.

    Args:
        frame_rate: frames a second.
        start: score from which a tracker starts tracks.

    Attributes:
        used: scores were turned.
    """

    def __init__(self, frame_rate: float, start: float) -> None:
        self._evidence, self._start = VideoEvidence(DetectionCost(), frame_rate), start
        self._frame, self.used = 0, False

    def __str__(self) -> str:
        return "scores are on a scale of their own: taken instead is how often boxes of a score are found again"

    def every(self, detections: Sequence[Detections]) -> list[Detections]:
        """The detections of a whole video, an entry a frame; also turned where none could start a track."""
        frames, boxes, scores = boxes_of_frames(detections)
        self.used = _no_probabilities(scores) or bool(len(scores) and (scores < self._start).all())
        if self.used:
            self._evidence.add(frames, boxes, scores, len(detections) - 1)
        return [self._turned(frame) for frame in detections]

    def next(self, detections: Detections) -> Detections:
        """The detections of the next frame; scores are turned from the first on that is no probability."""
        self._evidence.add(np.full(len(detections), self._frame), detections.boxes, detections.scores, self._frame)
        self._frame, self.used = self._frame + 1, self.used or _no_probabilities(detections.scores)
        return self._turned(detections)

    def _turned(self, detections: Detections) -> Detections:
        return replace(detections, scores=self._evidence.right(detections.scores)) if self.used else detections


def _no_probabilities(scores: FloatArray) -> bool:
    return bool(((scores < -HALF_PRECISION) | (scores > 1 + HALF_PRECISION)).any())
