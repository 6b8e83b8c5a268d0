"""The flow with costs of pairs alone, over a whole video at once: for few frames a second, and for comparison.

The gate says which detections of different frames can be the same person at all. It is deliberately wide: it only keeps
the number of pairs linear in the length of the video. The costs decide what a pair is worth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.costs import PairFeatures, TransitionCost, pair_features
from tsuiseki.tracking.association.detection_tables import DetectionRows
from tsuiseki.tracking.association.nearby import near_pairs, sizes
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import FloatArray, IntArray


@pydantic_dataclass(frozen=True, config=SETTINGS)
class GateSettings:
    """Limits of a plausible move between two detections.

    Attributes:
        window: largest gap in frames, at least 1; 1 links consecutive frames only.
        reach: distance of centres allowed at gap 1, in heights of the earlier box.
        speed: additional distance allowed for every further frame, in heights of the earlier box.
        size_ratio: the larger height over the smaller at most, at least 1.
    """

    window: Annotated[int, Field(ge=1, le=10_000)] = 30
    reach: PositiveFloat = 0.5
    speed: NonNegativeFloat = 0.1
    size_ratio: Annotated[float, Field(ge=1)] = 1.6


# Of the thesis's flow as printed, which names no gate: as far as a drone's camera jumps from one frame to the next.
PRINTED_GATE = GateSettings(window=10, reach=5.0, speed=0.5, size_ratio=2.0)


def candidate_pairs(frames: IntArray, boxes: FloatArray, settings: GateSettings) -> tuple[IntArray, IntArray, IntArray]:
    """Indices of all pairs of detections that lie within the gate.

    Args:
        frames: ``(N,)`` frame numbers, in any order.
        boxes: ``(N, 4)`` pixels.
        settings: the gate.

    Returns:
        ``(P,)`` arrays ``i``, ``j`` and ``gap`` with ``frames[j] - frames[i] == gap`` and ``1 <= gap <= window``,
        sorted by i, then by j's frame.
    """
    parts = list(pairs_by_gap(frames, boxes, settings))
    if not parts:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.int64)
    gap = np.repeat([gap for _, _, gap in parts], [len(i) for i, _, _ in parts])
    i, j = np.concatenate([i for i, _, _ in parts]), np.concatenate([j for _, j, _ in parts])
    by_detection = np.lexsort((j, gap, i))
    return i[by_detection], j[by_detection], gap[by_detection]


def pairs_by_gap(
    frames: IntArray, boxes: FloatArray, settings: GateSettings
) -> Iterator[tuple[IntArray, IntArray, int]]:
    """The same pairs, one gap at a time, so that their costs are known, and most are dropped, before the next come.

    Yields:
        Arrays ``i`` and ``j`` of the pairs ``gap`` frames apart, and ``gap``, from 1 on.
    """
    if len(frames) == 0:
        return
    frames = np.asarray(frames, dtype=np.int64)
    centre, height = centres(boxes), sizes(boxes)[:, 1]
    for gap in range(1, min(settings.window, int(np.ptp(frames))) + 1):
        reach = height * (settings.reach + settings.speed * (gap - 1))
        i, j = near_pairs(frames, centre, np.column_stack([reach, reach]), gap)
        ratio = height[j] / height[i]
        near = np.square(centre[j] - centre[i]).sum(axis=1) <= reach[i] ** 2
        plausible = near & (ratio <= settings.size_ratio) & (ratio >= 1 / settings.size_ratio)
        yield i[plausible], j[plausible], gap


def pairs_with_costs(
    rows: DetectionRows, gate: GateSettings, transition: TransitionCost, miss: float = 0.0
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Tails, heads and costs of all plausible transitions, one gap at a time.

    Args:
        rows: the detections, with features and actions where they are compared.
        gate: which pairs are plausible.
        transition: their costs.
        miss: added for every frame in between.
    """
    for tail, head, gap in pairs_by_gap(rows.frames, rows.boxes, gate):
        if len(tail):
            gaps = np.full(len(tail), gap)
            pairs = pair_features(rows.boxes, rows.features, tail, head, gaps, rows.actions)
            yield tail, head, transition(pairs) + miss * (gap - 1)


# Scale of the log ratio of two detected heights of one person.
SIZE = 0.09
# Degrees of freedom of the differences; the fewer, the less a large one counts.
TAILS = 5.0


@dataclass(frozen=True)
class HandSetCost:
    """Transition cost set by hand on position, size and appearance: nothing is learnt.

    The exponent q of thesis eq. 2.14 is the logarithm of how much likelier two different people are than one, under
    simple assumptions in place of boosted trees (eq. 2.15); the cost is log(1 + exp(q)). Differences of place and size
    follow Student's t distribution: now and then a detector is far off, and no single difference rules a link out.

    Attributes:
        bias: q of two detections one frame apart that do not differ, of neutral appearance.
        noise: scale of the difference of two detected centres, in heights.
        speed: scale of a person's velocity along either axis, in heights a frame.
        appearance: weight of the cosine distance.
        neutral: cosine distance that speaks neither for nor against, taken also where the distance is not known.
    """

    bias: float
    noise: float
    speed: float
    appearance: float
    neutral: float

    def __call__(self, pairs: PairFeatures) -> FloatArray:
        """``(P,)`` costs, above 0."""
        gap = pairs.gap.astype(np.float64)
        noise = self.noise**2
        variance = noise + (self.speed * gap) ** 2
        # Longer gaps count against a link by the area of their region of likely positions.
        q = np.log(variance / (noise + self.speed**2)) + self.bias
        q += _surprise(pairs.dx**2 / variance + pairs.dy**2 / variance, 2)
        q += _surprise((pairs.dh / SIZE) ** 2, 1)
        described = ~np.isnan(pairs.appearance)
        q[described] += self.appearance * (pairs.appearance[described] - self.neutral)
        return np.logaddexp(0, q)


def _surprise(squared: FloatArray, dimensions: int) -> FloatArray:
    """How much less likely a difference is than none, -log p(x) / p(0), under Student's t distribution.

    ``squared`` is its squared length, in scales, in so many dimensions.
    """
    return np.asarray(np.log1p(squared / TAILS) * ((TAILS + dimensions) / 2))
