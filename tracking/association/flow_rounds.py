"""Links of a flow network, and their costs along the tracks, in turn with the flow.

Two detections have a place each, and no velocity. Along the track that each belongs to there is one. So the flow is
solved, and a Kalman filter runs along its tracks from both sides. All links then cost anew, by the two estimates (see
`link_cost`). This is the thesis's alternation of tracks and features (5.3), with motion in place of actions.
Costs go only part of the way to their new values. Two explanations that are about as good would otherwise take turns.
Links over long gaps are needed only where a track ends or begins. Every round adds them near the ends of the tracks.

First costs may be too high. Where targets move fast, frames are few or boxes inexact, the cost of the unknown velocity
of two detections exceeds their value. Then no track forms, no track has a velocity, and no round mends it.
`FirstCosts` recognises this: detections that are right are left out, and lower costs add these and few others.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tsuiseki.tracking.association.chain_motion import TrackMotion
from tsuiseki.tracking.association.costs import unit_means, window_means
from tsuiseki.tracking.association.detection_tables import DetectionTable
from tsuiseki.tracking.association.evidence import LinkWeigher
from tsuiseki.tracking.association.learnt_costs import CostNetwork
from tsuiseki.tracking.association.link_cost import DOUBT, MOST_WORTH, LinkCost
from tsuiseki.tracking.association.nearby import (
    BOXES_AT_ONCE,
    Pairs,
    Strips,
    dense_reach,
    gaps,
    joined,
    near_places,
    nearest,
    sizes,
)
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import BoolArray, Columns, FloatArray, IntArray


@dataclass(frozen=True)
class Links(Columns):
    """Links between detections of a window.

    Attributes:
        tail: ``(P,)`` numbers of the earlier detections.
        head: ``(P,)`` numbers of the later detections.
        cost: ``(P,)`` cost in the flow, nats.
        track_cost: ``(P,)`` cost along the tracks of the last round, which ``cost`` approaches; NaN for links that have
            a cost as pairs only.
        hidden: ``(P,)`` share of the person hidden in the middle of the gap, which no round changes.
    """

    tail: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    head: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    cost: FloatArray = field(default_factory=lambda: np.empty(0))
    track_cost: FloatArray = field(default_factory=lambda: np.empty(0))
    hidden: FloatArray = field(default_factory=lambda: np.empty(0))


# Seconds from the end of a track that count as near it.
ENDS = 0.3
# Share of the old cost in the new one.
KEEP = 0.5
# Links that cost more are left out; above entry + exit, for they may become cheaper.
DEAREST = 14.0
# Seconds over which features are averaged along tracks.
AVERAGED = 0.7


# Longest gap of a link, seconds.
WINDOW = 1.3
# Longest gap, seconds, over which all detections are linked; longer links are added only near the ends of tracks.
NEAR = 0.6


def candidates(
    table: DetectionTable, tails: IntArray, heads: IntArray, shortest: int, longest: int, cost: LinkCost
) -> Pairs:
    """``(P,)`` indices of the detections of all plausible links over ``shortest`` to ``longest`` frames."""
    if len(tails) == 0 or len(heads) == 0:
        return joined([])
    places = centres(table.boxes).T.copy()
    # In the order of their places, so that neighbours lie together in memory.
    tails = tails[np.lexsort((places[0, tails], table.frames[tails]))]
    side = sizes(table.boxes).max(axis=1)
    furthest = _reach(table, tails, side[tails], np.array([longest]), cost)[:, 0].max()
    strips = Strips.of(table.frames, places[0], heads, tails, float(furthest))
    log_height = table.measured.places[:, 3].copy()
    dense = dense_reach(table.frames[heads], table.boxes[heads])
    pairs: list[Pairs] = []
    count = len(tails)
    for start in range(0, count * (longest - shortest + 1), BOXES_AT_ONCE):
        which = np.arange(start, min(start + BOXES_AT_ONCE, count * (longest - shortest + 1)))
        tail, gap = tails[which % count], shortest + which // count
        reach = _reach(table, tail, side[tail], gap, cost)
        if dense is not None:
            reach = np.minimum(reach, dense)
        i, j = near_places(strips, places, tail, table.frames[tail] + gap, reach)
        similar = np.flatnonzero(np.abs(log_height[j] - log_height[i]) < cost.size)
        i, j = i[similar], j[similar]
        pairs.append((i, j) if dense is None else nearest(i, j, table.frames, places))
    return joined(pairs)


def _reach(table: DetectionTable, tails: IntArray, side: FloatArray, gap: IntArray, cost: LinkCost) -> FloatArray:
    """``(T, 2)`` largest differences of centres, pixels, for T boxes of ``(T,)`` longer sides.

    The gaps, one for all or ``(T,)``, are in frames. Reaches grow by how far the camera's motion over them may be off.
    """
    wander, seconds = table.measured.wander, gap / table.frame_rate
    wandered = bool(wander[-1] > wander[0])
    if wandered or not table.even:
        later = np.searchsorted(table.frames, gap + table.frames[tails], side="right") - 1
    if not table.even:
        seconds = table.seconds(tails, later)
    reach = cost.limits(side, seconds)
    if wandered:
        doubt = np.sqrt(np.maximum(wander[later] - wander[tails], 0))
        reach += (side * DOUBT * doubt)[:, None]
    return reach


def _near_ends(table: DetectionTable, labels: IntArray) -> tuple[BoolArray, BoolArray]:
    """``(N,)`` detections near the last, and near the first one of their tracks; those of no track are near both."""
    frames = gaps(ENDS, table.frame_rate)
    count = int(labels.max(initial=-1)) + 1
    first, last = np.full(count + 1, np.iinfo(np.int64).max // 4), np.full(count + 1, -1)
    np.minimum.at(first, labels, table.frames)
    np.maximum.at(last, labels, table.frames)
    alone = labels < 0
    return alone | (last[labels] - table.frames <= frames), alone | (table.frames - first[labels] <= frames)


def mean_features(
    table: DetectionTable, labels: IntArray, features: FloatArray, seconds: float
) -> tuple[FloatArray, FloatArray]:
    """``(N, D)`` mean features over the last seconds of each detection's track, and over the next: eq. 5.3 one-sided.

    Args:
        table: the detections.
        labels: ``(N,)`` track of each, -1 for none, which keeps its own features.
        features: ``(N, D)``, NaN where not known; so are the means, which are of unit length.
        seconds: length of the windows.
    """
    described = np.asarray(~np.isnan(features).any(axis=1))
    counted = np.concatenate([np.where(described[:, None], features, 0), described[:, None]], axis=1)
    reach = gaps(seconds, table.frame_rate)
    past, future = (
        unit_means(window_means(table.frames, labels, counted, table.frames, labels, window)[:, :-1])
        for window in ((reach, 0), (0, reach))
    )
    return past, future


def with_new_costs(
    links: Links,
    weigher: LinkWeigher,
    labels: IntArray,
    motion: TrackMotion,
    changed: tuple[BoolArray, BoolArray],
    free: BoolArray,
    changes: CostNetwork | None,
) -> tuple[Links, TrackMotion]:
    """The links, and more at the ends of the tracks, with costs from the motion along the tracks.

    Only links with a changed end cost anew, unless learnt changes compare links with each other.

    Args:
        links: as they were.
        weigher: along the tracks.
        labels: ``(N,)`` track of each detection, -1 for none.
        motion: along the tracks.
        changed: ``(N,)`` where the past, and where the future is known anew.
        free: ``(N,)`` detections that are not decided yet.
        changes: learnt ones of the costs; None for none.

    Returns:
        The links, and the motion, with the ends that have links over long gaps.
    """
    table = weigher.table
    tail, head = table.rows(links.tail), table.rows(links.head)
    again = changed[0][tail] | changed[1][head] | np.isnan(links.track_cost)
    if changes is not None:
        again[:] = True
    ending, beginning = (near & free for near in _near_ends(table, labels))
    # Links over all gaps from and to ends of tracks, of which one end at least is fresh.
    from_fresh, to_fresh = ending & (changed[0] | ~motion.ending), beginning & (changed[1] | ~motion.beginning)
    longest, added = gaps(WINDOW, table.frame_rate), list[Pairs]()
    for tails, heads in ((from_fresh, beginning), (ending & ~from_fresh, to_fresh)):
        added.append(candidates(table, np.flatnonzero(tails), np.flatnonzero(heads), 1, longest, weigher.cost))
    fresh = _without(joined(added), tail, head, len(table))
    unknown = np.full(len(fresh[0]), np.nan)
    i, j = np.append(tail[again], fresh[0]), np.append(head[again], fresh[1])
    hidden = np.append(links.hidden[again], unknown)
    chosen, track_cost, hidden = weigher.costs((i, j), DEAREST, hidden, None if changes is None else changes.links)
    old = links.select(~again)
    old.cost[:] += (1 - KEEP) * (old.track_cost - old.cost)
    # Costs of pairs are no costs along tracks, and new links have none.
    old_cost = np.where(np.isnan(links.track_cost[again]), np.nan, links.cost[again])
    old_cost = np.append(old_cost, unknown)[chosen]
    near = track_cost + np.where(np.isnan(old_cost), 0.0, KEEP * (old_cost - track_cost))
    new = Links(table.numbers[i[chosen]], table.numbers[j[chosen]], near, track_cost, hidden)
    return old.and_then(new), replace(motion, ending=ending, beginning=beginning)


def _without(pairs: Pairs, tails: IntArray, heads: IntArray, count: int) -> Pairs:
    """The pairs that are not among others of ``count`` detections."""
    possible = _mask(pairs[0], count)[tails] & _mask(pairs[1], count)[heads]
    # No pair stands twice among either.
    new = ~np.isin(pairs[0] * count + pairs[1], tails[possible] * count + heads[possible], assume_unique=True)
    return pairs[0][new], pairs[1][new]


def _mask(which: IntArray, count: int) -> BoolArray:
    mask = np.zeros(count, dtype=np.bool_)
    mask[which] = True
    return mask


# Probability from which a detection counts as right.
RIGHT = 0.7
# Fewer right detections are no evidence.
FEWEST = 10
# Right detections are left out if no more than this share of them is in tracks.
USED = 0.8
# Lower costs are taken where no more than this share of the right detections was in tracks,
HARDLY = 0.2
# or where at least this share of what they add is right.
MOST = 2 / 3


@dataclass(frozen=True)
class FirstCosts:
    """U detections as the video would have them if those that it does not bear out were missed by chance.

    Attributes:
        probability: ``(U,)`` of being right.
        change: ``(U,)`` of the cost of using them, then.
    """

    probability: FloatArray
    change: FloatArray

    def left_out(self, used: BoolArray) -> bool:
        """Whether those that are right are left out, of which ``(U,)`` are in tracks."""
        right = self.probability >= RIGHT
        return bool(right.sum() >= FEWEST and used[right].mean() <= USED)

    def adds_right(self, used: BoolArray, used_at_lower: BoolArray) -> bool:
        """Whether to take lower costs, with which ``(U,)`` others are in tracks."""
        right = self.probability >= RIGHT
        added = used_at_lower & ~used
        return bool(used[right].mean() <= HARDLY or right[added].sum() >= MOST * added.sum() > 0)


def with_known_velocity(links: Links, cost: LinkCost, frame_rate: float) -> Links:
    """Links, of which those without a cost along tracks cost as much as with `LinkCost.velocity_confidence` = 1."""
    less = (1 - cost.velocity_confidence) * cost.room(1 / frame_rate)
    lower_cost = np.maximum(links.cost - less, -MOST_WORTH)
    return replace(links, cost=np.where(np.isnan(links.track_cost), lower_cost, links.cost))
