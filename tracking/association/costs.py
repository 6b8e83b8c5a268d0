"""Costs of the flow network: of a detection, of a link, and of what people do (thesis eq. 2.12-2.14, 5.2, 5.3).

A learnt affinity and hand-set costs share one interface, `TransitionCost`. The candidate pairs are described once
(`pair_features`), and one call gives all costs.

Action features compare what people do. A network gives the probability of each action at every detection. Two
detections of one person have similar probabilities, so their cosine distance is a cost of the link (eq. 5.2). Along the
tracks of the flow before, probabilities are averaged over a window (eq. 5.3), and the links cost anew. The
printed sum of eq. 5.3 runs over 17 frames and divides by 15; here it runs over the window and divides by the number of
frames in which the person was detected.

A window centred on a link's detections reaches over the link on both sides. Where the flow has handed a track from one
person to another, both ends then average the same mixture of the two. So windows are one-sided by default (not in the
thesis): the earlier detection is compared by what its track did until then, the later one by what its track does from
there on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from pydantic import NonNegativeFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.nearby import gaps, sizes
from tsuiseki.tracking.bounds import SETTINGS, Seconds
from tsuiseki.tracking.geometry import centres, iou_pairs
from tsuiseki.tracking.types import Columns, FloatArray, IntArray


@dataclass(frozen=True)
class PairFeatures(Columns):
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


# c_tran of thesis eq. 2.14, without the cost of missed frames: ``(P,)`` finite costs of P pairs, at least 0; -log of
# the probability that the two detections are the same person.
TransitionCost: TypeAlias = Callable[[PairFeatures], FloatArray]


def pair_features(
    boxes: FloatArray,
    features: FloatArray | None,
    i: IntArray,
    j: IntArray,
    gap: IntArray,
    actions: FloatArray | None = None,
) -> PairFeatures:
    """Describe the pairs ``(i, j)`` of detections.

    Args:
        boxes: ``(N, 4)`` pixels.
        features: ``(N, D)`` unit length; a row with a NaN, or None, means that the appearance is not known.
        i: ``(P,)`` indices of the earlier detections.
        j: ``(P,)`` indices of the later detections.
        gap: ``(P,)`` frames between the two.
        actions: ``(N, A)`` probabilities of actions; None where nothing recognises them.
    """
    size, centre = sizes(boxes), centres(boxes)
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
        action=None if actions is None else action_distances(actions, actions, i, j),
    )


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
    """Cost of using a detection, Eqs. (2.12)-(2.13) of the thesis.

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


# Cost of a score: fitted to labels, or from the detector's own probability.
ScoreCost: TypeAlias = ObservationCost | ProbabilityCost


def window_means(
    frames: IntArray,
    labels: IntArray,
    actions: FloatArray,
    at_frames: IntArray,
    at_labels: IntArray,
    reach: tuple[int, int],
) -> FloatArray:
    """``(M, A)`` means of a track's features over windows, Eq. (5.3), at frames in which it need not be detected.

    Args:
        frames: ``(N,)`` of the detections.
        labels: ``(N,)`` of their tracks, -1 for none.
        actions: ``(N, A)`` of the detections.
        at_frames: ``(M,)`` where the means are wanted.
        at_labels: ``(M,)`` of which tracks. Of an empty window, or of no track, the mean is that of the detection with
            the same index, if M is N, and NaN otherwise.
        reach: of the windows, frames back and frames ahead.
    """
    back, ahead = reach
    fallback = actions if len(at_frames) == len(frames) else np.full((len(at_frames), actions.shape[1]), np.nan)
    used = np.flatnonzero(labels >= 0)
    if len(used) == 0:
        return fallback.copy()
    first, span = frames[used].min() - back, int(frames[used].max() - frames[used].min()) + 2 * (back + ahead) + 1
    key = labels[used] * span + (frames[used] - first)
    order = np.argsort(key, kind="stable")
    key = key[order]
    sums = np.zeros((len(key) + 1, actions.shape[1]))
    np.cumsum(actions[used[order]], axis=0, out=sums[1:])
    target = at_labels * span + (at_frames - first)
    low, high = np.searchsorted(key, target - back), np.searchsorted(key, target + ahead, side="right")
    count = np.where(at_labels >= 0, high - low, 0)
    means = (sums[high] - sums[low]) / np.maximum(count, 1)[:, None]
    return np.where(count[:, None] > 0, means, fallback)


def unit_means(sums: FloatArray) -> FloatArray:
    """``(M, D)`` sums of features scaled to unit length, NaN where there are none."""
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray(np.divide(sums, length, out=np.full_like(sums, np.nan), where=length > 0))


ActionFeatures = Literal["single", "centred", "one-sided"]


@pydantic_dataclass(frozen=True, config=SETTINGS)
class ActionCost:
    """Cost of a link by the cosine distance d of the action probabilities at its ends: weight · (d − neutral).

    Attributes:
        features: ``single`` compares detections; ``centred`` means over windows about them along their tracks, as the
            thesis does; ``one-sided`` the half of the window up to the earlier one with that from the later one on.
        window: λ, length of the window, seconds.
        weight: cost of a distance of 1, of two detections, and of two means.
        neutral: distance whose cost is 0, of two detections, and of two means, in [0, 1].
        least: duration of a link from which actions count, seconds; over less time place and motion weigh more.
    """

    features: ActionFeatures = "one-sided"
    window: Seconds = 0.5
    weight: tuple[NonNegativeFloat, NonNegativeFloat] = (10.0, 25.0)
    neutral: tuple[float, float] = (0.05, 0.04)
    least: float = 0.0

    @property
    def averaged(self) -> bool:
        """Whether features are averaged along tracks."""
        return self.features != "single"

    def means(
        self, frames: IntArray, labels: IntArray, actions: FloatArray, frame_rate: float
    ) -> tuple[FloatArray, FloatArray]:
        """``(N, A)`` features of detections as the earlier, and as the later one of a link, from those of single
        frames.

        ``labels`` ``(N,)`` are tracks, -1 for none, whose detections keep their own features.
        """
        if not self.averaged:
            return actions, actions
        half = gaps(self.window / 2, frame_rate)
        if self.features == "centred":
            both = window_means(frames, labels, actions, frames, labels, (half, half))
            return both, both
        earlier, later = (window_means(frames, labels, actions, frames, labels, r) for r in ((half, 0), (0, half)))
        return earlier, later

    def __call__(
        self,
        earlier: FloatArray,
        later: FloatArray,
        i: IntArray,
        j: IntArray,
        seconds: FloatArray,
        *,
        averaged: bool,
    ) -> FloatArray:
        """``(P,)`` costs of links from detections ``i`` to ``j``, so many seconds apart.

        ``earlier`` and ``later`` are features ``(N, A)`` of detections as the one and as the other, means along tracks
        if ``averaged``.
        """
        distance = action_distances(earlier, later, i, j)
        cost = self.weight[averaged] * (distance - self.neutral[averaged])
        return np.where(seconds >= self.least, cost, 0.0)


def action_distances(earlier: FloatArray, later: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """``(P,)`` cosine distances in [0, 1] of rows ``i`` and ``j`` of actions ``(N, A)``: c_saf of eq. 5.2."""
    unit = [actions / np.maximum(np.linalg.norm(actions, axis=1, keepdims=True), 1e-9) for actions in (earlier, later)]
    return np.clip(1 - inner_products(unit[0], unit[1], i, j), 0, 1)
