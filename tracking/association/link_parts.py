"""Costs of links of a flow network, from motion, appearance, actions, occlusion and learnt costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.association.chain_motion import Beliefs
from tsuiseki.tracking.association.costs import TransitionCost, cosine_distances, inner_products, pair_features
from tsuiseki.tracking.association.detection_tables import DetectionTable
from tsuiseki.tracking.association.link_cost import MOST_WORTH, LinkCost, Mismatch
from tsuiseki.tracking.association.nearby import Occluders, Pairs
from tsuiseki.tracking.types import FloatArray, IntArray

# Pairs of one call: as many as the processor holds close by.
PAIRS_AT_ONCE = 16_384


@dataclass(frozen=True)
class LinkParts:
    """Links and the parts of their costs, nats.

    Attributes:
        i: ``(P,)`` indices of the earlier detections.
        j: ``(P,)`` indices of the later detections.
        past: estimates at each detection from the past of its track.
        future: estimates at each detection from the future of its track.
        seconds: ``(P,)`` time between the two detections, seconds.
        distance: ``(P,)`` cosine distance of the appearance in [0, 2], NaN where not known.
        mismatch: ``(P,)`` cost of the difference of the two motions.
        hidden: ``(P,)`` share of the person hidden in between, in [0, 1].
        cost: ``(P,)`` default cost of the link.
        action: ``(P,)`` cost of the difference of actions, a part of the cost; NaN without actions.
    """

    i: IntArray
    j: IntArray
    past: Beliefs
    future: Beliefs
    seconds: FloatArray
    distance: FloatArray
    mismatch: FloatArray
    hidden: FloatArray
    cost: FloatArray
    action: FloatArray


# Changes of the costs of links, ``(P,)``.
LinkChange = Callable[[DetectionTable, LinkParts], FloatArray]


@dataclass(frozen=True)
class LinkModel:
    """The parts of a link's cost, for a video.

    Attributes:
        cost: costs from motion, appearance and actions.
        dearest: largest cost of a link that is kept, nats.
        transition: learnt costs of pairs, in place of the appearance; None for none.
        change: differences of learnt costs from the default costs; None for none.
    """

    cost: LinkCost
    dearest: float
    transition: TransitionCost | None = None
    change: LinkChange | None = None


def link_costs(
    table: DetectionTable,
    pairs: Pairs,
    beliefs: tuple[Beliefs, Beliefs],
    by: LinkModel,
    *,
    means: tuple[FloatArray, FloatArray] | None = None,
    hidden: FloatArray | None = None,
    mismatch: Mismatch | None = None,
    labels: IntArray | None = None,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """The links that are kept, their costs, and how much of the person is hidden in between.

    Args:
        table: the N detections.
        pairs: ``(P,)`` indices of the earlier, and of the later detections of the links.
        beliefs: estimates at each detection from the past of its track, and from the future.
        by: the parts of a cost.
        means: ``(N, D)`` mean features of the past, and of the future of each detection along its track; without them
            single detections are compared.
        hidden: ``(P,)`` share of the person hidden in between, NaN where not known; by default none is.
        mismatch: cost of the difference of motions; by default along tracks.
        labels: ``(N,)`` tracks along which actions are averaged; without them those of single detections count.

    Returns:
        ``(K,)`` indices of links, their ``(K,)`` costs, and ``(K,)`` share hidden.
    """
    (i, j), (past, future), cost, change = pairs, beliefs, by.cost, by.change
    if mismatch is None:
        mismatch = cost.mismatch_along(table.measured, past, future, 1 / table.frame_rate)
    doing = None
    if cost.action is not None and table.actions is not None:
        doing = (table.actions, table.actions)
        if labels is not None:
            doing = cost.action.means(table.frames, labels, table.actions, table.frame_rate)
    hiding = Occluders.of(table.frames, table.image, table.size)
    parts_of = _PartsOf(table, by, (past, future), mismatch, hiding, means, doing, labels is not None)
    if hidden is None:
        # A view of one number.
        hidden = np.broadcast_to(np.nan, len(i))
    if change is not None:
        # Learnt changes compare links with each other.
        kept, parts = parts_of(i, j, hidden)
        return kept, np.maximum(parts.cost + change(table, parts), -MOST_WORTH), parts.hidden
    found = []
    for start in range(0, max(len(i), 1), PAIRS_AT_ONCE):
        some = slice(start, start + PAIRS_AT_ONCE)
        kept, parts = parts_of(i[some], j[some], hidden[some])
        found.append((kept + start, parts.cost, parts.hidden))
    kept, cost_of_kept, covered = (np.concatenate(column) for column in zip(*found, strict=True))
    return kept, cost_of_kept, covered


@dataclass(frozen=True)
class _PartsOf:
    """The inputs of `link_costs`, for all links; ``doing`` are actions of the earlier and of the later ones."""

    table: DetectionTable
    by: LinkModel
    beliefs: tuple[Beliefs, Beliefs]
    mismatch: Mismatch
    hiding: Occluders
    means: tuple[FloatArray, FloatArray] | None
    doing: tuple[FloatArray, FloatArray] | None
    along: bool

    def __call__(self, i: IntArray, j: IntArray, hidden: FloatArray) -> tuple[IntArray, LinkParts]:
        """``(K,)`` indices of those of P links that are kept, and these."""
        table, cost, one_frame = self.table, self.by.cost, 1 / self.table.frame_rate
        gap = table.frames[j] - table.frames[i]
        seconds = np.asarray(gap * one_frame, dtype=np.float64)
        motion = self.mismatch(i, j, table.seconds(i, j), table.measured.wander[j] - table.measured.wander[i])
        total, distance, action = motion.copy(), np.full(len(i), np.nan), np.full(len(i), np.nan)
        if table.features is not None:
            averaged = self.means is not None
            distance = (
                cosine_distances(table.features, i, j)
                if self.means is None
                else np.clip(1 - inner_products(*self.means, i, j), 0, 2)
            )
            # Learnt costs hold for the gaps that they were learnt on.
            unlearnt = True if self.by.transition is None else gap > self._learnt_up_to()
            total += np.where(unlearnt, cost.appearance_cost(distance, averaged=averaged), 0)
        if self.by.transition is not None:
            learnt = np.flatnonzero(gap <= self._learnt_up_to())
            pairs = pair_features(table.boxes, table.features, i[learnt], j[learnt], gap[learnt])
            total[learnt] += cost.learnt(self.by.transition(replace(pairs, appearance=distance[learnt])))
        if cost.action is not None and self.doing is not None:
            averaged = self.along and cost.action.averaged
            action = cost.action(*self.doing, i, j, seconds, averaged=averaged)
            total += action
        # Occlusion is computed only where it matters.
        kept = np.flatnonzero(total + cost.waiting(seconds, one_frame, np.ones(len(i))) < self.by.dearest)
        covered = hidden[kept]
        asked = np.flatnonzero(np.isnan(covered))
        covered[asked] = self.hiding.between(i[kept[asked]], j[kept[asked]])
        total = total[kept] + cost.waiting(seconds[kept], one_frame, covered)
        past, future = self.beliefs
        parts = LinkParts(
            i[kept], j[kept], past, future, seconds[kept], distance[kept], motion[kept], covered, total, action[kept]
        )
        return kept, parts

    def _learnt_up_to(self) -> float:
        """Longest gap of the learnt costs, frames."""
        return float(getattr(self.by.transition, "window", np.inf))
