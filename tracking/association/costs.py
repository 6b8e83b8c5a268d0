"""Costs of the flow network: what a detection and what a link of two detections is worth.

A learnt affinity and the hand-set costs share one interface, ``TransitionCost``: describe the candidate pairs once
(``pair_features``), then price them all in one call.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from tsuiseki.tracking.association.gating import GateSettings, pairs_by_gap
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class PairFeatures:
    """How the later detection of each of P pairs differs from the earlier one.

    Attributes:
        gap: ``(P,)`` int64 frames between the two, at least 1.
        iou: ``(P,)`` intersection over union of the boxes where they stand, in [0, 1].
        appearance: ``(P,)`` cosine distance of the features in [0, 2], NaN where one of them is not known.
        dx: ``(P,)`` change of the centre's x in mean heights of the two boxes.
        dy: ``(P,)`` change of the centre's y in mean heights of the two boxes.
        dw: ``(P,)`` logarithm of the ratio of the widths.
        dh: ``(P,)`` logarithm of the ratio of the heights.
        action: ``(P,)`` cosine distance of the action features in [0, 1], NaN where one is not known; None where
            nothing recognises actions.
    """

    gap: IntArray
    iou: FloatArray
    appearance: FloatArray
    dx: FloatArray
    dy: FloatArray
    dw: FloatArray
    dh: FloatArray
    action: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.gap)

    def select(self, which: BoolArray | IntArray) -> PairFeatures:
        """The pairs at a mask or at indices."""
        action = None if self.action is None else self.action[which]
        return PairFeatures(
            self.gap[which],
            self.iou[which],
            self.appearance[which],
            self.dx[which],
            self.dy[which],
            self.dw[which],
            self.dh[which],
            action,
        )


class TransitionCost(Protocol):
    """Anything that prices pairs of detections: c_tran of thesis eq. 2.14, without the cost of missed frames."""

    def __call__(self, pairs: PairFeatures) -> FloatArray:
        """``(P,)`` finite costs, at least 0; -log of the probability that the two are the same person."""
        ...


def pair_features(
    boxes: FloatArray, features: FloatArray | None, i: IntArray, j: IntArray, gap: IntArray
) -> PairFeatures:
    """Describe the pairs ``(i, j)`` of detections.

    Args:
        boxes: ``(N, 4)`` pixels.
        features: ``(N, D)`` unit length; a row with a NaN, or None, means that the appearance is not known.
        i: ``(P,)`` indices of the earlier detections.
        j: ``(P,)`` indices of the later detections.
        gap: ``(P,)`` frames between the two.
    """
    size = boxes[:, 2:] - boxes[:, :2]
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    log_size = np.log(size)
    move = (centre[j] - centre[i]) / ((size[i, 1] + size[j, 1]) / 2)[:, None]
    change = log_size[j] - log_size[i]
    return PairFeatures(
        gap=np.asarray(gap, dtype=np.int64),
        iou=iou_pairs(boxes[i], boxes[j]),
        appearance=cosine_distances(features, i, j),
        dx=move[:, 0],
        dy=move[:, 1],
        dw=change[:, 0],
        dh=change[:, 1],
    )


def priced_pairs(
    frames: IntArray,
    boxes: FloatArray,
    features: FloatArray | None,
    gate: GateSettings,
    transition: TransitionCost,
    miss: float,
    first_head: int = 0,
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Tails, heads and costs of all plausible transitions, one gap at a time.

    Args:
        frames: ``(N,)`` frame numbers.
        boxes: ``(N, 4)`` pixels.
        features: ``(N, D)`` unit length, or None.
        gate: which pairs are plausible.
        transition: prices them.
        miss: added for every frame in between.
        first_head: only pairs whose later detection has at least this index.
    """
    for tail, head, gap in pairs_by_gap(frames, boxes, gate):
        if first_head:
            wanted = head >= first_head
            tail, head = tail[wanted], head[wanted]
        if len(tail):
            pairs = pair_features(boxes, features, tail, head, np.full(len(tail), gap))
            yield tail, head, transition(pairs) + miss * (gap - 1)


def cosine_distances(features: FloatArray | None, i: IntArray, j: IntArray) -> FloatArray:
    """``(P,)`` cosine distances in [0, 2] of the unit-length rows ``i`` and ``j``; NaN where one has a NaN."""
    if features is None:
        return np.full(len(i), np.nan)
    return np.clip(1 - inner_products(features, features, i, j), 0, 2)


def inner_products(earlier: FloatArray, later: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """``(P,)`` inner products of the rows ``i`` of ``earlier`` and ``j`` of ``later``, both ``(N, D)``."""
    products = np.empty(len(i))
    # In blocks that fit into the cache; both gathered (P, D) sides at once would dwarf everything else in memory.
    step = max(1, 250_000 // max(1, earlier.shape[1]))
    for start in range(0, len(i), step):
        block = slice(start, start + step)
        products[block] = np.einsum("pd,pd->p", earlier.take(i[block], axis=0), later.take(j[block], axis=0))
    return products


@dataclass(frozen=True)
class ObservationCost:
    """Cost of using a detection (thesis eq. 2.12-2.13).

    With p = 1 / (1 + exp(alpha + beta * score)) the logit of p is -(alpha + beta * score), so the cost
    b - log(p / (1 - p)) is ``b + alpha + beta * score``: negative for a detection worth explaining.

    Attributes:
        alpha: offset of the logistic function.
        beta: slope of the logistic function, negative where a higher score means a likelier person.
        b: bias; lower it to use more detections.

    >>> ObservationCost(alpha=2.0, beta=-4.0, b=0.0)(np.array([0.5, 1.0])).tolist()
    [0.0, -2.0]
    """

    alpha: float = 7.65
    beta: float = -9.0
    b: float = 0.0

    def __call__(self, scores: FloatArray) -> FloatArray:
        """``(N,)`` costs of ``(N,)`` detector scores."""
        return self.b + self.alpha + self.beta * np.asarray(scores, dtype=np.float64)


@dataclass(frozen=True)
class ProbabilityCost:
    """Cost of using a detection whose score is the probability p that it is right: ``b - log(p / (1 - p))``.

    Attributes:
        b: bias; lower it to use more detections.
        least: p is kept within [least, 1 - least].

    >>> ProbabilityCost()(np.array([0.5])).tolist()
    [0.0]
    """

    b: float = 0.0
    least: float = 1e-3

    def __call__(self, scores: FloatArray) -> FloatArray:
        """``(N,)`` costs of ``(N,)`` scores in [0, 1]."""
        p = np.clip(np.asarray(scores, dtype=np.float64), self.least, 1 - self.least)
        return np.asarray(self.b - np.log(p / (1 - p)))


# What a score costs: fitted to labels, or as the detector says itself.
ScoreCost: TypeAlias = ObservationCost | ProbabilityCost


@dataclass(frozen=True)
class HandSetCost:
    """Transition cost set by hand on position, size and appearance: nothing is learnt.

    The exponent q of thesis eq. 2.14 is the logarithm of how much likelier two different people are than one, under
    simple assumptions in place of boosted trees (eq. 2.15); the cost is log(1 + exp(q)). Differences of place and size
    follow Student's t distribution: now and then a detector is far off, and no single difference rules a link out.

    Attributes:
        bias: q of two detections one frame apart that do not differ, of neutral appearance.
        noise: scale of the difference of two detected centres, in heights.
        speed_x: scale of a person's horizontal velocity, in heights a frame.
        speed_y: scale of the vertical velocity, in heights a frame.
        spread: how much longer gaps count against a link, as their region of likely positions grows; 1 is by its area.
        size: scale of the log ratio of two detected heights of one person.
        tails: degrees of freedom of the distributions; the fewer, the less a large difference counts.
        appearance: weight of the cosine distance.
        neutral: cosine distance that speaks neither for nor against, taken also where the distance is not known.
        action: weight of the cosine distance of the action features, where there are any.
        action_neutral: likewise, of the action features.
    """

    bias: float = -5.0
    noise: float = 0.06
    speed_x: float = 0.04
    speed_y: float = 0.02
    spread: float = 1.0
    size: float = 0.09
    tails: float = 5.0
    appearance: float = 14.0
    neutral: float = 0.27
    action: float = 4.0
    action_neutral: float = 0.15

    def __call__(self, pairs: PairFeatures) -> FloatArray:
        """``(P,)`` costs, above 0."""
        gap = pairs.gap.astype(np.float64)
        noise = self.noise**2
        variance_x, variance_y = noise + (self.speed_x * gap) ** 2, noise + (self.speed_y * gap) ** 2
        nearest = (noise + self.speed_x**2) * (noise + self.speed_y**2)
        q = np.log(variance_x * variance_y / nearest) * (self.spread / 2) + self.bias
        q += surprise(pairs.dx**2 / variance_x + pairs.dy**2 / variance_y, 2, self.tails)
        q += surprise((pairs.dh / self.size) ** 2, 1, self.tails)
        known = ~np.isnan(pairs.appearance)
        q[known] += self.appearance * (pairs.appearance[known] - self.neutral)
        if pairs.action is not None:
            q += self.action * np.nan_to_num(pairs.action - self.action_neutral)
        return np.logaddexp(0, q)


def surprise(squared: FloatArray, dimensions: int, tails: float) -> FloatArray:
    """How much less likely a difference is than none, -log p(x) / p(0), under Student's t distribution.

    Args:
        squared: squared lengths of differences, in scales.
        dimensions: of the differences.
        tails: degrees of freedom.
    """
    return np.asarray(np.log1p(squared / tails) * ((tails + dimensions) / 2))
