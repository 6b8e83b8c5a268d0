"""How high people are in the picture where they stand on one ground, learnt from the people detected so far.

Under a camera that is not rolled, people of one height who stand on one plane are the higher in the picture the
lower their feet are: h = a (y - y0) for feet in row y below the horizon y0, where a is the height of a person over that
of the camera (Hoiem, Efros, Hebert, "Putting Objects in Perspective", IJCV 80, 2008). Here the line is found from the
detections themselves, by a Hough transform: each confident box votes for all lines that go through it, and votes fade,
so that a moving camera is followed. What a detector sees high up on a facade, or in a box of the wrong size, does not
lie on the line and loses score; none gains any. Who lies is as long as who stands is high: a box that is wider than
high may be on the line by its width, and does not vote.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf, log, sqrt, tau
from typing import Any

import cv2
import numpy as np

from tsuiseki.tracking.types import BoolArray, Detections, FloatArray

# Horizons that are voted for, in heights of the frame from its upper border down.
_HORIZONS = np.arange(-1.0, 0.96, 0.01)
# Least slope, height of a person over that of the camera.
_LEAST_SLOPE = 0.05
# Largest slope.
_LARGEST_SLOPE = 3.5
# Step in the logarithm of a height; a tenth of what people differ by would cost more and tell no more.
_STEP = 0.05
# Logarithms of the slopes that are voted for.
_SLOPES = np.arange(log(_LEAST_SLOPE), log(_LARGEST_SLOPE), _STEP)
# Logarithms of the heights that are voted for where all rows have one, heights of the frame.
_HEIGHTS = np.arange(log(0.01), _STEP, _STEP)
# Boxes of no person are from a tenth of the largest height upwards, all alike.
_RANGE = log(10.0)
# A box this close to the upper or lower border, in heights of the frame, may be cut off there.
_BORDER = 0.003
# Neighbouring horizons fit as well, and no ground is quite flat: far away this is half of a person's height or more.
_SLACK = 0.02
# Rows below the horizon are at least this, whose logarithm is taken.
_LEAST_HEIGHT = 1e-9
# Scores are kept this far from 0 and 1, where they have no logit.
_LEAST_SCORE = 1e-9
# Seconds after which a vote counts 1/e.
MEMORY = 5.0
# Sum of the scores that are remembered from which the line is used.
ENOUGH = 5.0
# Standard deviation of the logarithm of people's heights, with that of their boxes.
SPREAD = 0.5
# Score from which a box votes, by its score.
_CERTAIN = 0.3
# Standard deviation of the logarithm of a height within which a vote counts for a line.
_TOLERANCE = 0.2
# What a vote counts in its own bin, the middle, 1, and in those up to six deviations beside it.
_KERNEL = np.exp(-0.5 * (_STEP * np.arange(-25, 26) / _TOLERANCE) ** 2)
# Share of the votes that the line must explain.
_EXPLAINED = 0.5
# By how much this must exceed the share that people of one height in all rows would explain, as under a ceiling or
# where all stand in one row.
_GAIN = 0.05


@dataclass(frozen=True)
class HeightLine:
    """Heights of people by the row of their feet, ``slope * (row - horizon)``.

    Attributes:
        horizon: row where people would have no height, in heights of the frame from its upper border.
        slope: height of a person over the camera's height above the ground.
        explained: share of the votes near the line, in [0, 1].
        gain: by how much more than people of one height in all rows explain.
    """

    horizon: float
    slope: float
    explained: float
    gain: float

    def log_ratios(self, boxes: FloatArray, height: int, cut_off: BoolArray) -> FloatArray:
        """``(N,)`` log of the height of ``(N, 4)`` boxes over the line's, in a frame ``height`` pixels high.

        Of a box that is wider than high it is that of the width, where this is nearer to the line. It is 0 for heights
        that a horizon `_SLACK` higher or lower would give. It is infinite above such horizons, and at least 0 for
        boxes that the frame cuts off.
        """
        below = boxes[:, 3] / height - self.horizon
        low, high = (self.slope * np.maximum(below + slack, _LEAST_HEIGHT) for slack in (-_SLACK, _SLACK))
        sides = np.stack([boxes[:, 3] - boxes[:, 1], (boxes[:, 2:] - boxes[:, :2]).max(axis=1)]) / height
        both = np.log(sides / np.clip(sides, low, high))
        both[:, cut_off] = np.maximum(both[:, cut_off], 0)
        ratios: FloatArray = np.take_along_axis(both, np.abs(both).argmin(axis=0)[None], axis=0)[0]
        ratios[below + _SLACK <= 0] = np.inf
        return ratios


class GroundPlane:
    """The line of a video's people, learnt frame by frame, and the scores of boxes by it.

    Nothing is changed before enough detections and unless one line explains most of them. A box cut off at the upper or
    lower border neither votes nor loses score for being short. One that is wider than high does not vote.

    Args:
        frame_rate: frames a second.
        score_threshold: boxes are dropped whose scores fall below it.

    Attributes:
        line: that explains most by now; None before the first vote.
        frames: so far.
        used: frames whose scores went by a line.
        dropped: boxes whose scores fell below the threshold.

    >>> ground = GroundPlane(frame_rate=1.0)
    >>> rows = np.array([120.0, 160, 200, 280, 400])
    >>> boxes = np.stack([rows, rows / 2, rows + 20, rows], axis=1)  # half as high as their feet are below the top
    >>> boxes[-1, 1] = 40.0
    >>> detections = Detections(boxes, np.full(5, 0.9))
    >>> for _ in range(3):
    ...     weighed = ground.weighed(detections, 480)
    >>> weighed.scores.round(2).tolist()
    [0.9, 0.9, 0.9, 0.9, 0.85]
    """

    def __init__(self, frame_rate: float = 25.0, score_threshold: float = 0.0) -> None:
        if not 0 < frame_rate < inf:
            raise ValueError(f"expected a frame rate above 0, got {frame_rate}")
        self.score_threshold = score_threshold
        self.line: HeightLine | None = None
        self.frames = self.used = self.dropped = 0
        self._fade = exp(-1 / (frame_rate * MEMORY))
        self._votes = np.zeros((len(_HORIZONS), len(_SLOPES)))
        self._level = np.zeros(len(_HEIGHTS))
        self._weight = 0.0

    @property
    def holds(self) -> bool:
        """Whether the line explains enough of enough people to go by."""
        line = self.line
        if line is None or self._weight < ENOUGH:
            return False
        return line.explained >= _EXPLAINED and line.gain >= _GAIN

    def weighed(self, detections: Detections, height: int) -> Detections:
        """The next frame's detections with their scores by the line, this frame's votes included.

        With r the logarithm of a box's height, or width, over the line's height and p the share that the line explains,
        the logit of the score gets log((p g(r) + 1 - p) / (p g(0) + 1 - p)), at most 0. g is the normal density of
        `SPREAD` over the density of boxes of no person: a box on the line keeps its score, and one far from it loses
        the more the more boxes of this video lie on the line. Ratios within the bins of the votes count as none.

        Args:
            detections: scores in [0, 1].
            height: of the frame, pixels.
        """
        boxes, old, margin = detections.boxes, detections.scores, _BORDER * height
        # The frame may cut head or feet off.
        cut_off = (boxes[:, 1] <= margin) | (boxes[:, 3] >= height - margin)
        upright = boxes[:, 3] - boxes[:, 1] >= boxes[:, 2] - boxes[:, 0]
        voting = (old >= _CERTAIN) & upright & ~cut_off
        self._learn(boxes[voting] / height, old[voting, None])
        self.frames += 1
        if not self.holds or not len(detections):
            return detections
        assert self.line is not None
        self.used += 1
        ratios = self.line.log_ratios(boxes, height, cut_off)
        ratios = np.maximum(np.abs(ratios) - _STEP, 0)
        peak = _RANGE / (SPREAD * sqrt(tau))
        odds = self.line.explained * peak / max(1 - self.line.explained, _LEAST_SCORE)
        shifts = np.log1p(odds * np.exp(-0.5 * (ratios / SPREAD) ** 2)) - np.log1p(odds)
        inner = np.clip(old, _LEAST_SCORE, 1 - _LEAST_SCORE)
        moved = 1 / (1 + np.exp(np.log(1 / inner - 1) - shifts))
        scores = np.where(shifts == 0, old, np.minimum(moved, old))
        chosen = (scores >= self.score_threshold) | (old < self.score_threshold)
        self.dropped += int((~chosen).sum())
        return replace(detections, scores=scores).select(chosen)

    def _learn(self, boxes: FloatArray, weights: FloatArray) -> None:
        """Let all votes fade, add this frame's, and find the line that most of them support.

        Args:
            boxes: ``(N, 4)`` that vote, in heights of the frame.
            weights: ``(N, 1)``.
        """
        for votes in (self._votes, self._level):
            votes *= self._fade
        self._weight *= self._fade
        if len(boxes):
            heights = np.log(boxes[:, 3:] - boxes[:, 1:2])
            slopes = heights - np.log(np.maximum(boxes[:, 3:] - _HORIZONS, _LEAST_HEIGHT))
            _add(self._votes, slopes, weights, _SLOPES[0])
            _add(self._level[None], heights, weights, _HEIGHTS[0])
            self._weight += float(weights.sum())
        if self._weight > 0:
            # Not by a product of matrices: its threads would wait, and take the cores, where networks work beside.
            near = _smoothed(self._votes)
            horizon, slope = np.unravel_index(int(near.argmax()), near.shape)
            explained = float(near[horizon, slope]) / self._weight
            gain = explained - float(_smoothed(self._level[None]).max()) / self._weight
            self.line = HeightLine(float(_HORIZONS[horizon]), exp(_SLOPES[slope]), min(explained, 1.0), gain)

    def __str__(self) -> str:
        explained = 0.0 if self.line is None else self.line.explained
        boxes = "1 box" if self.dropped == 1 else f"{self.dropped} boxes"
        return (
            f"people's heights by row: one ground explains {100 * explained:.0f} % of them, used in {self.used} of "
            f"{self.frames} frames, {boxes} of other heights left out"
        )

    def facts(self) -> dict[str, Any]:
        """The last line and how often one was used, for ``run.json``."""
        line = self.line
        facts: dict[str, Any] = {"frames": self.frames, "used": self.used, "dropped": self.dropped}
        if line is not None:
            facts |= {name: round(getattr(line, name), 3) for name in ("horizon", "slope", "explained")}
        return facts


def _smoothed(table: FloatArray) -> FloatArray:
    """Each row of a ``(R, B)`` table under the kernel, zero outside."""
    return np.asarray(cv2.sepFilter2D(table, -1, _KERNEL, np.ones(1), borderType=cv2.BORDER_CONSTANT))


def _add(table: FloatArray, values: FloatArray, weights: FloatArray, first: float) -> None:
    """Add ``(N, 1)`` weights at ``(N, R)`` values to a ``(R, B)`` table, each shared by the two nearest bins."""
    rows, bins = table.shape
    position = (values - first) / _STEP
    inside = (position >= 0) & (position < bins - 1)
    lower = np.where(inside, position, 0).astype(np.int64)
    upper_share = position - lower
    place = (np.arange(rows) * bins + lower)[inside]
    for where, share in ((place, 1 - upper_share), (place + 1, upper_share)):
        table += np.bincount(where, (weights * share)[inside], table.size).reshape(table.shape)
