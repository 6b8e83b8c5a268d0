"""Links of a flow network that are priced again along the tracks found, in turn with the flow.

Two detections have a place each, and no velocity. Along the track that each belongs to there is one: so the flow is
solved, a Kalman filter runs along its tracks from both sides, and all links are priced again by what the two sides say
(see `link_cost`). This is the thesis's alternation of tracks and features (5.3) with motion for action. Prices go only
part of the way to their new values, since two explanations that are about as good would otherwise take turns.

Links over long gaps are needed only where a track ends or begins. In every round they are looked for near the ends of
the tracks found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.association.costs import TransitionCost, cosine_distances, inner_products, pair_features
from tsuiseki.tracking.association.flow.along_tracks import Along, Changed
from tsuiseki.tracking.association.flow.link_cost import MOST_WORTH, LinkCost
from tsuiseki.tracking.association.flow.links import Links, joined_links
from tsuiseki.tracking.association.flow.mismatch import Mismatch
from tsuiseki.tracking.association.flow.seen import Seen
from tsuiseki.tracking.association.nearby import (
    BOXES_AT_ONCE,
    Pairs,
    Strips,
    centres,
    gaps,
    joined,
    near_places,
    sizes,
)
from tsuiseki.tracking.association.occlusion import Hiding
from tsuiseki.tracking.association.tracklets.chain_motion import Beliefs
from tsuiseki.tracking.association.tracklets.window_means import window_means
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Pairs that are priced together: as many as the processor holds close by.
PAIRS_AT_ONCE = 16_384


@dataclass(frozen=True)
class RoundSettings:
    """Which links of detections there are, and how often they are priced.

    Attributes:
        window: longest gap of a link, seconds.
        near: gaps up to this many seconds are linked everywhere, longer ones only near the ends of tracks.
        ends: seconds from the end of a track that count as near it.
        rounds: how often links are priced again; 0 keeps the prices of pairs.
        keep: share of the old price in the new one.
        dearest: links that cost more are left out; above entry + exit, for they may become cheaper.
        averaged: seconds over which features are averaged along tracks.
    """

    window: float = 1.3
    near: float = 0.6
    ends: float = 0.3
    rounds: int = 5
    keep: float = 0.5
    dearest: float = 14.0
    averaged: float = 0.7

    def __post_init__(self) -> None:
        if not (self.near > 0 and self.window > 0 and self.ends >= 0 and self.rounds >= 0 and 0 <= self.keep < 1):
            raise ValueError("expected window and near above 0, ends and rounds from 0 and keep in [0, 1)")


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
LinkChange = Callable[[Seen, LinkParts], FloatArray]


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


def candidates(seen: Seen, tails: IntArray, heads: IntArray, shortest: int, longest: int, cost: LinkCost) -> Pairs:
    """``(P,)`` indices of the detections of all plausible links over ``shortest`` to ``longest`` frames."""
    if len(tails) == 0 or len(heads) == 0:
        return joined([])
    x, y = centres(seen.boxes).T.copy()
    # In the order of their places, so that what is looked up lies together.
    tails = tails[np.lexsort((x[tails], seen.frames[tails]))]
    side = sizes(seen.boxes).max(axis=1)
    furthest = _reach(seen, tails, side[tails], np.array([longest]), cost)[:, 0].max()
    strips = Strips.of(seen.frames, x, heads, tails, float(furthest))
    log_height = seen.measured.places[:, 3].copy()
    pairs: list[Pairs] = []
    count = len(tails)
    for start in range(0, count * (longest - shortest + 1), BOXES_AT_ONCE):
        which = np.arange(start, min(start + BOXES_AT_ONCE, count * (longest - shortest + 1)))
        tail, gap = tails[which % count], shortest + which // count
        reach = _reach(seen, tail, side[tail], gap, cost)
        i, j = near_places(strips, x, y, tail, seen.frames[tail] + gap, reach[:, 0], reach[:, 1])
        alike = np.flatnonzero(np.abs(log_height[j] - log_height[i]) < cost.size)
        pairs.append((i[alike], j[alike]))
    return joined(pairs)


def _reach(seen: Seen, tails: IntArray, side: FloatArray, gap: IntArray, cost: LinkCost) -> FloatArray:
    """``(T, 2)`` largest differences of centres, pixels, for T boxes of ``(T,)`` longer sides.

    The gaps, one for all or ``(T,)``, are in frames. Reaches grow by how far the camera's motion over them may be off.
    """
    reach = cost.limits(side, gap / seen.frame_rate)
    wander = seen.measured.wander
    if wander[-1] > wander[0]:
        later = wander[np.searchsorted(seen.frames, gap + seen.frames[tails], side="right") - 1]
        doubt = np.sqrt(np.maximum(later - wander[tails], 0))
        reach += (side * cost.doubt * doubt)[:, None]
    return reach


def priced(
    seen: Seen,
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
        seen: the N detections.
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
        mismatch = cost.mismatch_along(seen.measured, past, future, 1 / seen.frame_rate)
    doing = None
    if cost.action is not None and seen.actions is not None:
        doing = (seen.actions, seen.actions)
        if labels is not None:
            doing = cost.action.means(seen.frames, labels, seen.actions, seen.frame_rate)
    hiding = Hiding.of(seen.frames, seen.image, seen.size)
    prices = _Prices(seen, by, mismatch, hiding, means, doing, labels is not None)
    if hidden is None:
        # A view of one number.
        hidden = np.broadcast_to(np.nan, len(i))
    if change is not None:
        # Learnt changes compare links with each other.
        of = prices(i, j, hidden)
        kept = of.kept
        seconds = (seen.frames[j[kept]] - seen.frames[i[kept]]) / seen.frame_rate
        parts = LinkParts(
            i[kept], j[kept], past, future, seconds, of.distance, of.motion, of.hidden, of.price, of.action
        )
        return kept, np.maximum(of.price + change(seen, parts), -MOST_WORTH), of.hidden
    found = []
    for start in range(0, max(len(i), 1), PAIRS_AT_ONCE):
        part = slice(start, start + PAIRS_AT_ONCE)
        of = prices(i[part], j[part], hidden[part])
        found.append((of.kept + start, of.price, of.hidden))
    kept, price, covered = (np.concatenate(column) for column in zip(*found, strict=True))
    return kept, price, covered


@dataclass(frozen=True)
class _Priced:
    """Of P links the K that are kept.

    Attributes:
        kept: ``(K,)`` indices of P.
        distance: ``(K,)`` of appearance, NaN where not known.
        motion: ``(K,)`` cost of how ill the motions go together.
        action: ``(K,)`` cost of how unlike the two act, NaN where not known.
        price: ``(K,)``.
        hidden: ``(K,)`` share of the person hidden in between.
    """

    kept: IntArray
    distance: FloatArray
    motion: FloatArray
    action: FloatArray
    price: FloatArray
    hidden: FloatArray


@dataclass(frozen=True)
class _Prices:
    """What is needed to price links, see `priced`; ``doing`` are actions of the earlier and of the later ones."""

    seen: Seen
    by: Pricing
    mismatch: Mismatch
    hiding: Hiding
    means: tuple[FloatArray, FloatArray] | None
    doing: tuple[FloatArray, FloatArray] | None
    along: bool

    def __call__(self, i: IntArray, j: IntArray, hidden: FloatArray) -> _Priced:
        """Those of P links that are kept."""
        seen, cost, one_frame = self.seen, self.by.cost, 1 / self.seen.frame_rate
        gap = seen.frames[j] - seen.frames[i]
        seconds = np.asarray(gap * one_frame, dtype=np.float64)
        motion = self.mismatch(i, j, seconds, seen.measured.wander[j] - seen.measured.wander[i])
        total, distance, action = motion.copy(), np.full(len(i), np.nan), np.full(len(i), np.nan)
        if seen.features is not None:
            averaged = self.means is not None
            distance = (
                cosine_distances(seen.features, i, j)
                if self.means is None
                else np.clip(1 - inner_products(*self.means, i, j), 0, 2)
            )
            # Learnt costs are right about the gaps that they were learnt on.
            unlearnt = True if self.by.transition is None else gap > self._learnt_up_to()
            total += np.where(unlearnt, cost.appearance_cost(distance, averaged=averaged), 0)
        if self.by.transition is not None:
            learnt = np.flatnonzero(gap <= self._learnt_up_to())
            pairs = pair_features(seen.boxes, seen.features, i[learnt], j[learnt], gap[learnt])
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
        return _Priced(kept, distance[kept], motion[kept], action[kept], price, covered)

    def _learnt_up_to(self) -> float:
        """Longest gap that the learnt costs speak of, frames."""
        return float(getattr(self.by.transition, "window", np.inf))


def near_ends(seen: Seen, labels: IntArray, seconds: float) -> tuple[IntArray, IntArray]:
    """Detections near the last, and near the first detection of their tracks; those of no track are near both."""
    frames = gaps(seconds, seen.frame_rate)
    count = int(labels.max(initial=-1)) + 1
    first, last = np.full(count + 1, np.iinfo(np.int64).max // 4), np.full(count + 1, -1)
    np.minimum.at(first, labels, seen.frames)
    np.maximum.at(last, labels, seen.frames)
    alone = labels < 0
    ending = alone | (last[labels] - seen.frames <= frames)
    beginning = alone | (seen.frames - first[labels] <= frames)
    return np.flatnonzero(ending), np.flatnonzero(beginning)


def mean_features(seen: Seen, labels: IntArray, features: FloatArray, seconds: float) -> tuple[FloatArray, FloatArray]:
    """``(N, D)`` mean features over the last seconds of each detection's track, and over the next: eq. 5.3 one-sided.

    Args:
        seen: the detections.
        labels: ``(N,)`` track of each, -1 for none, which keeps its own features.
        features: ``(N, D)``, NaN where not known.
        seconds: length of the windows.

    Returns:
        Both of unit length, NaN where nothing is known.
    """
    known = np.asarray(~np.isnan(features).any(axis=1))
    counted = np.concatenate([np.where(known[:, None], features, 0), known[:, None]], axis=1)
    reach = gaps(seconds, seen.frame_rate)
    both = []
    for window in ((reach, 0), (0, reach)):
        mean = window_means(seen.frames, labels, counted, seen.frames, labels, window)
        length = np.linalg.norm(mean[:, :-1], axis=1, keepdims=True)
        both.append(np.divide(mean[:, :-1], length, out=np.full_like(features, np.nan), where=length > 0))
    return both[0], both[1]


def repriced(
    links: Links,
    seen: Seen,
    labels: IntArray,
    known: Along,
    changed: Changed,
    settings: RoundSettings,
    free: BoolArray,
    by: Pricing,
) -> tuple[Links, Along]:
    """The links with those that the ends of the tracks ask for, at the prices of what is known along the tracks.

    Only links are priced of which an end is known anew, unless learnt changes compare links with each other.

    Args:
        links: as they were.
        seen: the detections.
        labels: ``(N,)`` track of each detection, -1 for none.
        known: what is known along the tracks.
        changed: where that is new.
        settings: which links there are.
        free: ``(N,)`` detections that are not decided yet.
        by: what links are priced by.

    Returns:
        The links, and what is known, with the ends from and to which links were looked for.
    """
    means = None if seen.features is None else mean_features(seen, labels, seen.features, settings.averaged)
    tail, head = seen.rows(links.tail), seen.rows(links.head)
    again = changed.past[tail] | changed.future[head] | np.isnan(links.price)
    if by.change is not None:
        again[:] = True
    ending, beginning = (_mask(ends, len(seen)) & free for ends in near_ends(seen, labels, settings.ends))
    fresh = ending & (changed.past | ~known.ending), beginning & (changed.future | ~known.beginning)
    more = _fresh_candidates(seen, (ending, beginning), fresh, settings, by.cost)
    more = _without(more, tail, head, len(seen))
    i, j = np.append(tail[again], more[0]), np.append(head[again], more[1])
    hidden = np.append(links.hidden[again], np.full(len(more[0]), np.nan))
    kept, price, hidden = priced(
        seen, (i, j), (known.past, known.future), by, means=means, hidden=hidden, labels=labels
    )
    old = links.select(~again)
    old.cost[:] += (1 - settings.keep) * (old.price - old.cost)
    # Prices of pairs are no prices along tracks, and new links have none.
    before = np.append(np.where(np.isnan(links.price[again]), np.nan, links.cost[again]), np.full(len(more[0]), np.nan))
    before = before[kept]
    near = price + np.where(np.isnan(before), 0.0, settings.keep * (before - price))
    new = Links(seen.numbers[i[kept]], seen.numbers[j[kept]], near, price, hidden)
    return joined_links(old, new), replace(known, ending=ending, beginning=beginning)


def _fresh_candidates(
    seen: Seen,
    ends: tuple[BoolArray, BoolArray],
    fresh: tuple[BoolArray, BoolArray],
    settings: RoundSettings,
    cost: LinkCost,
) -> Pairs:
    """Links over all gaps from and to ends of tracks, of which one end at least is fresh."""
    longest = gaps(settings.window, seen.frame_rate)
    tails, heads = np.flatnonzero(fresh[0]), np.flatnonzero(ends[1])
    one = candidates(seen, tails, heads, 1, longest, cost)
    tails, heads = np.flatnonzero(ends[0] & ~fresh[0]), np.flatnonzero(fresh[1])
    return joined([one, candidates(seen, tails, heads, 1, longest, cost)])


def _without(pairs: Pairs, tails: IntArray, heads: IntArray, count: int) -> Pairs:
    """The pairs that are not among others of ``count`` detections."""
    asked = _mask(pairs[0], count)[tails] & _mask(pairs[1], count)[heads]
    new = ~np.isin(pairs[0] * count + pairs[1], tails[asked] * count + heads[asked])
    return pairs[0][new], pairs[1][new]


def _mask(which: IntArray, count: int) -> BoolArray:
    mask = np.zeros(count, dtype=np.bool_)
    mask[which] = True
    return mask
