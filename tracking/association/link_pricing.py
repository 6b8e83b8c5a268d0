"""What links of a flow network cost: by motion, appearance and actions, by what hides people, by what was learnt."""

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

# Pairs that are priced together: as many as the processor holds close by.
PAIRS_AT_ONCE = 16_384


@dataclass(frozen=True)
class LinkParts:
    """Links and what their costs are made of.

    Attributes:
        i: ``(P,)`` indices of the earlier detections.
        j: ``(P,)`` of the later ones.
        past: what the past of its track says at each detection.
        future: likewise of the future.
        seconds: ``(P,)`` between the two.
        distance: ``(P,)`` of their appearance, NaN where not known.
        mismatch: ``(P,)`` cost of how ill the motion of the two goes together.
        hidden: ``(P,)`` share of the person hidden in between.
        cost: ``(P,)`` by default.
        action: ``(P,)`` cost of how unlike the two act, a part of the cost; NaN where nothing recognised actions.
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
class Pricing:
    """What the links of a video are priced by.

    Attributes:
        cost: of links by motion, appearance and actions.
        dearest: links that cost more are left out.
        transition: learnt costs of pairs, which speak in place of the appearance; None for none.
        change: by how much learnt costs of links differ from the default; None for not at all.
    """

    cost: LinkCost
    dearest: float
    transition: TransitionCost | None = None
    change: LinkChange | None = None


def priced(
    table: DetectionTable,
    pairs: Pairs,
    beliefs: tuple[Beliefs, Beliefs],
    by: Pricing,
    *,
    means: tuple[FloatArray, FloatArray] | None = None,
    hidden: FloatArray | None = None,
    mismatch: Mismatch | None = None,
    labels: IntArray | None = None,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Which links do not cost too much, what they cost, and how much of the person is hidden in between.

    Args:
        table: the N detections.
        pairs: ``(P,)`` indices of the earlier, and of the later detections of the links.
        beliefs: what the past of its track says at each detection, and what the future says.
        by: what they are priced by.
        means: ``(N, D)`` mean features of the past, and of the future of each detection along its track; without them
            single detections are compared.
        hidden: ``(P,)`` share of the person hidden in between, NaN where not known; by default none is.
        mismatch: how ill the motions go together; by default as along tracks.
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
    prices = _Prices(table, by, (past, future), mismatch, hiding, means, doing, labels is not None)
    if hidden is None:
        # A view of one number.
        hidden = np.broadcast_to(np.nan, len(i))
    if change is not None:
        # Learnt changes compare links with each other.
        kept, parts = prices(i, j, hidden)
        return kept, np.maximum(parts.cost + change(table, parts), -MOST_WORTH), parts.hidden
    found = []
    for start in range(0, max(len(i), 1), PAIRS_AT_ONCE):
        some = slice(start, start + PAIRS_AT_ONCE)
        kept, parts = prices(i[some], j[some], hidden[some])
        found.append((kept + start, parts.cost, parts.hidden))
    kept, cost_of_kept, covered = (np.concatenate(column) for column in zip(*found, strict=True))
    return kept, cost_of_kept, covered


@dataclass(frozen=True)
class _Prices:
    """What is needed to price links, see `priced`; ``doing`` are actions of the earlier and of the later ones."""

    table: DetectionTable
    by: Pricing
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
            # Learnt costs are right about the gaps that they were learnt on.
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
        # What hides a person is looked at only where it matters.
        kept = np.flatnonzero(total + cost.waiting(seconds, one_frame, np.ones(len(i))) < self.by.dearest)
        covered = hidden[kept]
        asked = np.flatnonzero(np.isnan(covered))
        covered[asked] = self.hiding.between(i[kept[asked]], j[kept[asked]])
        price = total[kept] + cost.waiting(seconds[kept], one_frame, covered)
        past, future = self.beliefs
        parts = LinkParts(
            i[kept], j[kept], past, future, seconds[kept], distance[kept], motion[kept], covered, price, action[kept]
        )
        return kept, parts

    def _learnt_up_to(self) -> float:
        """Longest gap that the learnt costs speak of, frames."""
        return float(getattr(self.by.transition, "window", np.inf))
