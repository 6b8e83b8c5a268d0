"""What speaks for and against the links, detections and joins of a flow network.

`LinkWeigher` adds up the default cost of a link: motion, appearance, actions, occlusion. A `CostNetwork` changes costs
by what it reads off rows of features: one row a detection, a link or a join. The default cost is one of the features,
so a network that adds nothing leaves the tracker as it is. All features are bounded and of the order of 1 to 10;
lengths are in heights of the box, times in seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.association.chain_motion import Beliefs, MotionNoise
from tsuiseki.tracking.association.costs import TransitionCost, cosine_distances, inner_products, pair_features
from tsuiseki.tracking.association.detection_tables import DetectionTable
from tsuiseki.tracking.association.link_cost import MOST_WORTH, LinkCost, Mismatch
from tsuiseki.tracking.association.nearby import Occluders, Pairs, near_pairs, sizes
from tsuiseki.tracking.geometry import centres, iou_pairs
from tsuiseki.tracking.types import FloatArray, IntArray

# Pairs of one call: as many as the processor holds close by.
PAIRS_AT_ONCE = 8192


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


class LinkWeigher:
    """Gives links between the N detections of a table their costs.

    Args:
        table: the detections.
        cost: costs from motion, appearance and actions.
        beliefs: estimates at each detection from the past of its track, and from the future.
        transition: learnt costs of pairs, in place of the appearance; None for none.
        means: ``(N, D)`` mean features of the past, and of the future of each detection along its track; without them
            single detections are compared.
        labels: ``(N,)`` tracks along which actions are averaged; without them those of single detections count.
        mismatch: cost of the difference of motions; by default along tracks.
    """

    def __init__(
        self,
        table: DetectionTable,
        cost: LinkCost,
        beliefs: tuple[Beliefs, Beliefs],
        transition: TransitionCost | None = None,
        means: tuple[FloatArray, FloatArray] | None = None,
        labels: IntArray | None = None,
        mismatch: Mismatch | None = None,
    ) -> None:
        self.table, self.cost, self._past, self._future = table, cost, *beliefs
        self._mismatch = mismatch or cost.mismatch_along(table.measured, *beliefs, 1 / table.frame_rate)
        self._hiding = Occluders.of(table.frames, table.image, table.size)
        self._transition, self._means, self._along = transition, means, labels is not None
        # Longest gap of the learnt costs, frames: they hold for the gaps that they were learnt on.
        self._learnt_up_to = 0.0 if transition is None else float(getattr(transition, "window", np.inf))
        # Actions of detections as the earlier and as the later one of a link.
        self._actions = None if table.actions is None else (table.actions, table.actions)
        if cost.action is not None and table.actions is not None and labels is not None:
            self._actions = cost.action.means(table.frames, labels, table.actions, table.frame_rate)

    def costs(
        self,
        pairs: Pairs,
        dearest: float,
        hidden: FloatArray | None = None,
        changes: Callable[[FloatArray], FloatArray] | None = None,
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """The links that are kept, their costs, and how much of the person is hidden in between.

        Args:
            pairs: ``(P,)`` indices of the earlier, and of the later detections of the links.
            dearest: largest cost of a link that is kept, nats.
            hidden: ``(P,)`` share of the person hidden in between, NaN where not known; by default none is.
            changes: learnt changes of the costs of links by their features (`link_evidence`); None for none.

        Returns:
            ``(K,)`` indices of links, their ``(K,)`` costs, and ``(K,)`` share hidden.
        """
        i, j = pairs
        # Learnt changes compare links with each other.
        step = PAIRS_AT_ONCE if changes is None else max(len(i), 1)
        blocks = []
        for start in range(0, max(len(i), 1), step):
            block = slice(start, start + step)
            chosen, parts = self.parts((i[block], j[block]), dearest, None if hidden is None else hidden[block])
            cost = parts.cost
            if changes is not None:
                cost = np.maximum(cost + changes(link_evidence(self.table, parts, self.cost.motion)), -MOST_WORTH)
            blocks.append((chosen + start, cost, parts.hidden))
        chosen, costs, covered = (np.concatenate(column) for column in zip(*blocks, strict=True))
        return chosen, costs, covered

    def parts(self, pairs: Pairs, dearest: float, hidden: FloatArray | None = None) -> tuple[IntArray, LinkParts]:
        """``(K,)`` indices of those of P links that are kept, and the parts of their costs; arguments as of `costs`."""
        (i, j), table, cost, one_frame = pairs, self.table, self.cost, 1 / self.table.frame_rate
        gap = table.frames[j] - table.frames[i]
        seconds = np.asarray(gap * one_frame, dtype=np.float64)
        motion = self._mismatch(i, j, table.seconds(i, j), table.measured.wander[j] - table.measured.wander[i])
        total, distance, action = motion.copy(), np.full(len(i), np.nan), np.full(len(i), np.nan)
        if table.features is not None:
            if self._means is None:
                distance = cosine_distances(table.features, i, j)
            else:
                distance = np.clip(1 - inner_products(*self._means, i, j), 0, 2)
            appearance = cost.appearance_cost(distance, averaged=self._means is not None)
            total += np.where(gap > self._learnt_up_to, appearance, 0)
        if self._transition is not None:
            learnt = np.flatnonzero(gap <= self._learnt_up_to)
            described = pair_features(table.boxes, table.features, i[learnt], j[learnt], gap[learnt])
            total[learnt] += cost.learnt(self._transition(replace(described, appearance=distance[learnt])))
        if cost.action is not None and self._actions is not None:
            averaged = self._along and cost.action.averaged
            action = cost.action(*self._actions, i, j, seconds, averaged=averaged)
            total += action
        # Occlusion is computed only where it matters.
        chosen = np.flatnonzero(total + cost.waiting(seconds, one_frame, np.ones(len(i))) < dearest)
        covered = np.full(len(chosen), np.nan) if hidden is None else hidden[chosen]
        unknown = np.flatnonzero(np.isnan(covered))
        covered[unknown] = self._hiding.between(i[chosen[unknown]], j[chosen[unknown]])
        i, j, seconds = i[chosen], j[chosen], seconds[chosen]
        total = total[chosen] + cost.waiting(seconds, one_frame, covered)
        return chosen, LinkParts(
            i, j, self._past, self._future, seconds, distance[chosen], motion[chosen], covered, total, action[chosen]
        )


DETECTION_FEATURES = (
    "cost", "logit", "noise", "size", "aspect", "left", "right", "top", "bottom", "overlap_before", "overlap_after",
    "overlap_now", "neighbours", "interval", "since_start",
)  # fmt: skip
LINK_FEATURES = (
    "cost", "mismatch", "seconds", "gap", "hidden", "appearance", "appearance_known", "noise_tail", "noise_head",
    "ahead_x", "ahead_y", "back_x", "back_y", "width", "height", "overlap", "known_past", "known_future", "speed",
    "turn", "above_tail", "above_head", "interval", "action", "action_known",
)  # fmt: skip
JOIN_FEATURES = (*LINK_FEATURES, "detections_before", "detections_after", "seconds_before", "seconds_after")
# Largest distance from the image's border that a feature tells, heights.
FARTHEST = 2.0
# Bound of costs among the features, nats.
DEAREST = 12.0


def detection_evidence(table: DetectionTable, cost: FloatArray, logit: FloatArray) -> FloatArray:
    """``(N, 15)`` features of N detections: `DETECTION_FEATURES`.

    Args:
        table: the detections.
        cost: ``(N,)`` default c_obsv, nats.
        logit: ``(N,)`` of the probability that each is right.
    """
    count = len(table)
    if count == 0:
        return np.empty((0, len(DETECTION_FEATURES)))
    size = sizes(table.image)
    log_height = np.log(size[:, 1])
    overlap_before, overlap_after, _ = _overlaps(table, table.boxes, 1)
    # Of two boxes of a frame only the larger may reach the other's centre.
    overlap_as_head, overlap_as_tail, neighbours = _overlaps(table, table.image, 0)
    # How far each box lies from the image's borders, heights; far where the size of the image is not known.
    away = {name: np.full(count, FARTHEST) for name in ("left", "right", "top", "bottom")}
    if table.size is not None:
        (width, height), (x1, y1, x2, y2) = table.size, table.image.T
        beyond = {"left": x1, "right": width - x2, "top": y1, "bottom": height - y2}
        away = {name: (value / size[:, 1]).clip(-1.0, FARTHEST) for name, value in beyond.items()}
    columns = {
        "cost": cost,
        "logit": logit,
        "noise": table.measured.noise,
        "size": log_height - np.median(log_height),
        "aspect": np.log(size[:, 0]) - log_height,
        **away,
        "overlap_before": overlap_before,
        "overlap_after": overlap_after,
        "overlap_now": np.maximum(overlap_as_head, overlap_as_tail),
        "neighbours": np.log1p(neighbours),
        "interval": np.full(count, np.log(30 / table.frame_rate)),
        "since_start": np.minimum(table.frames / table.frame_rate, 1.0),
    }
    return np.stack([columns[name] for name in DETECTION_FEATURES], axis=1)


def link_evidence(table: DetectionTable, parts: LinkParts, motion: MotionNoise) -> FloatArray:
    """``(P, 25)`` features of P links: `LINK_FEATURES`."""
    if len(parts.i) == 0:
        return np.empty((0, len(LINK_FEATURES)))
    i, j = parts.i, parts.j
    ahead, back, speed, turn = _errors(parts, motion)
    change = table.measured.places[j, 2:] - table.measured.places[i, 2:]
    described, acting = ~np.isnan(parts.distance), ~np.isnan(parts.action)
    columns = {
        "cost": parts.cost.clip(-DEAREST, 2 * DEAREST),
        "mismatch": parts.mismatch.clip(-DEAREST, 2 * DEAREST),
        "seconds": parts.seconds,
        "gap": np.log(np.maximum(parts.seconds * table.frame_rate, 1.0)),
        "hidden": parts.hidden,
        "appearance": np.where(described, parts.distance, 0.25),
        "appearance_known": described.astype(np.float64),
        "noise_tail": table.measured.noise[i],
        "noise_head": table.measured.noise[j],
        "ahead_x": ahead[:, 0],
        "ahead_y": ahead[:, 1],
        "back_x": back[:, 0],
        "back_y": back[:, 1],
        "width": change[:, 0].clip(-1, 1),
        "height": change[:, 1].clip(-1, 1),
        "overlap": iou_pairs(table.boxes[i], table.boxes[j]),
        "known_past": np.log(parts.past.covariance[i, 0, 2]),
        "known_future": np.log(parts.future.covariance[j, 0, 2]),
        "speed": np.log1p(speed),
        "turn": np.log1p(turn),
        "above_tail": _above_rivals(parts.cost, i, len(table)),
        "above_head": _above_rivals(parts.cost, j, len(table)),
        "interval": np.full(len(i), np.log(30 / table.frame_rate)),
        "action": np.where(acting, parts.action, 0.0).clip(-DEAREST, DEAREST),
        "action_known": acting.astype(np.float64),
    }
    return np.stack([columns[name] for name in LINK_FEATURES], axis=1)


def _errors(parts: LinkParts, motion: MotionNoise) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Errors of the two predictions, of the later and of the earlier detection, in deviations, as logarithms.

    Also the speed and its change, heights a second.
    """
    i, j, seconds = parts.i, parts.j, parts.seconds[:, None]
    side = np.exp((parts.past.place[i, 3] + parts.future.place[j, 3]) / 2)[:, None]
    off = (parts.future.place[j, :2] - parts.past.place[i, :2]) / side
    past_velocity, future_velocity = parts.past.velocity[i, :2] / side, parts.future.velocity[j, :2] / side
    ahead = np.abs(off - past_velocity * seconds) / _deviation(parts.past, i, parts.seconds, 1.0, motion)
    back = np.abs(off - future_velocity * seconds) / _deviation(parts.future, j, parts.seconds, -1.0, motion)
    speed = (np.linalg.norm(past_velocity, axis=1) + np.linalg.norm(future_velocity, axis=1)) / 2
    return np.log1p(ahead), np.log1p(back), speed, np.linalg.norm(future_velocity - past_velocity, axis=1)


def _deviation(
    beliefs: Beliefs, which: IntArray, seconds: FloatArray, direction: float, motion: MotionNoise
) -> FloatArray:
    """``(P, 1)`` deviation of a predicted place, heights."""
    a, b, c = beliefs.covariance[which, 0].T
    variance = a + 2 * direction * b * seconds + c * seconds**2 + motion.acceleration[0] ** 2 * seconds**3 / 3
    return np.asarray(np.sqrt(variance + motion.measurement[0] ** 2)[:, None])


def _above_rivals(cost: FloatArray, end: IntArray, count: int) -> FloatArray:
    """``(P,)`` by how much each link costs more than the cheapest other one at the same end, within bounds."""
    order = np.lexsort([cost, end])
    ends, ordered = end[order], cost[order]
    first = np.searchsorted(ends, np.arange(count))
    cheapest, second = np.full(count, np.inf), np.full(count, np.inf)
    there = first < np.searchsorted(ends, np.arange(count), side="right")
    cheapest[there] = ordered[first[there]]
    follows = np.append(ends[1:] == ends[:-1], False)
    starts = first[there]
    second[ends[starts]] = np.where(follows[starts], ordered[np.minimum(starts + 1, len(ordered) - 1)], np.inf)
    best = np.zeros(len(cost), dtype=np.bool_)
    best[order[starts]] = True
    return np.asarray((cost - np.where(best, second[end], cheapest[end])).clip(-DEAREST, DEAREST))


def _overlaps(table: DetectionTable, boxes: FloatArray, gap: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``(N,)`` largest intersection over union with another box ``gap`` frames before, and after; how many overlap."""
    i, j = near_pairs(table.frames, centres(boxes), sizes(boxes), gap)
    distinct = i != j
    i, j = i[distinct], j[distinct]
    overlap = iou_pairs(boxes[i], boxes[j])
    overlap_before, overlap_after = np.zeros(len(table)), np.zeros(len(table))
    np.maximum.at(overlap_after, i, overlap)
    np.maximum.at(overlap_before, j, overlap)
    return overlap_before, overlap_after, np.bincount(i[overlap > 0], minlength=len(table)).astype(np.float64)
