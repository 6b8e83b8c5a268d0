"""Tracklets: chains of detections that the flow decides, joined over longer gaps, without those that straddle people.

Joining takes the same evidence as links of detections (`link_cost`), at the ends of tracklets: the filter's state
there, the time between, what hides the place, and the distance of their mean appearance. Ends and starts are matched
for the least total cost, no pair above `MOST_FOR_JOIN`. Ends of longer chains are known better, so it is done again
until nothing joins.

Between two people who walk side by side a detector also finds a third box, half on either, often enough for a track.
What lies on the boxes of surer tracks is no further person. The surer track has the larger sum of scores: a
straddling track is seldom detected, and most of its boxes are filled in.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from tsuiseki.tracking.association.chain_motion import RUN_UP, Beliefs, MotionNoise, beliefs_along
from tsuiseki.tracking.association.costs import cosine_distances, unit_means
from tsuiseki.tracking.association.detection_tables import DetectionTable, Measurements
from tsuiseki.tracking.association.evidence import LinkParts, link_evidence
from tsuiseki.tracking.association.learnt_costs import CostNetwork
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.association.nearby import Occluders, Pairs, ranges
from tsuiseki.tracking.association.network_flow import Ends, FlowSolution, track_labels
from tsuiseki.tracking.geometry import shared_with_all
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track


class Tracklets:
    """The tracklets as decisions of the flow come in, numbered from 0 on, and their mean appearance."""

    def __init__(self) -> None:
        self._labels = np.empty(0, dtype=np.int64)
        self._count = 0
        self._sums = np.empty((0, 0))

    def copy(self) -> Tracklets:
        """A copy that can grow by itself."""
        clone = Tracklets()
        clone._labels, clone._count, clone._sums = self._labels.copy(), self._count, self._sums.copy()
        return clone

    def add(self, numbers: IntArray, follower: IntArray, features: FloatArray | None) -> None:
        """Take further detections: those that no earlier one has named as its follower start tracklets.

        Args:
            numbers: ``(K,)`` increasing, counted over the whole video.
            follower: ``(K,)`` number of the next detection of the chain, -1 where there is none.
            features: ``(K, D)`` of unit length, NaN where not known; None where nothing was described.
        """
        if len(numbers) == 0:
            return
        self._grow(int(max(numbers[-1], follower.max())) + 1)
        place = np.searchsorted(numbers, follower).clip(max=len(numbers) - 1)
        within = (follower >= 0) & (numbers[place] == follower)
        chain = track_labels(FlowSolution(np.ones(len(numbers), np.bool_), np.where(within, place, -1)))
        label = self._labels[numbers[np.unique(chain, return_index=True)[1]]]
        fresh = label < 0
        label[fresh] = self._count + np.arange(fresh.sum())
        self._count += int(fresh.sum())
        self._labels[numbers] = label[chain]
        leaving = (follower >= 0) & ~within
        self._labels[follower[leaving]] = label[chain[leaving]]
        if features is None:
            return
        described = np.flatnonzero(~np.isnan(features).any(axis=1))
        sums = np.zeros((self._count, features.shape[1]))
        sums[: len(self._sums), : self._sums.shape[1]] = self._sums
        member = np.ones(len(described)), (self._labels[numbers[described]], np.arange(len(described)))
        self._sums = sums + scipy.sparse.csr_array(member, shape=(self._count, len(described))) @ features[described]

    def merge(self, numbers: IntArray, joined: IntArray) -> None:
        """Take detections of ``numbers`` ``(K,)`` for those of one tracklet where they have one number in ``joined``.

        Detections that are not among them belong to none of these tracklets; -1 leaves a detection as it is.
        """
        labels = self._labels[numbers]
        counted = (joined >= 0) & (labels >= 0)
        old, at = np.unique(labels[counted], return_index=True)
        group = joined[counted][at]
        first = np.full(int(joined.max(initial=-1)) + 1, self._count)
        np.minimum.at(first, group, old)
        new = first[group]
        into = np.arange(self._count)
        into[old] = new
        self._labels[numbers[counted]] = into[labels[counted]]
        for source, target in zip(old[old != new].tolist(), new[old != new].tolist(), strict=True):
            if source < len(self._sums):
                self._sums[target] += self._sums[source]

    def labels(self, count: int) -> IntArray:
        """``(count,)`` tracklet of each detection, -1 for one that belongs to none."""
        self._grow(count)
        return self._labels

    def appearance(self) -> FloatArray | None:
        """``(M, D)`` unit-length mean features of the tracklets, NaN where not known; None if nothing was described."""
        if self._sums.shape[1] == 0:
            return None
        missing = np.zeros((self._count - len(self._sums), self._sums.shape[1]))
        return unit_means(np.concatenate([self._sums, missing]))

    def _grow(self, count: int) -> None:
        missing = count - len(self._labels)
        if missing > 0:
            self._labels = np.append(self._labels, np.full(missing, -1))


# Longest gap that is joined, seconds.
JOIN_WINDOW = 2.0
# Longest gap that is joined where the appearance of both sides is known, seconds.
APPEARANCE_WINDOW = 5.0
# A link that costs more joins nothing, nats.
MOST_FOR_JOIN = 12.0
# Cost of a second without a detection, nats.
MISS_OF_JOIN = 0.6
# How often all ends are matched, at most.
JOIN_PASSES = 4


def join(
    table: DetectionTable,
    labels: IntArray,
    appearance: FloatArray | None,
    link: LinkCost,
    changes: CostNetwork | None = None,
    started: BoolArray | None = None,
    places: tuple[FloatArray, FloatArray] | None = None,
    weighed: list[tuple[IntArray, IntArray, FloatArray]] | None = None,
) -> IntArray:
    """``(N,)`` track of each detection, -1 for none; tracks are numbered by their first tracklet.

    Args:
        table: the detections; their own features are not used.
        labels: ``(N,)`` tracklet of each from 0 on, -1 for none.
        appearance: ``(M, D)`` mean features of the tracklets, NaN where not known; None where not described.
        link: what links cost.
        changes: by how much learnt costs differ from these.
        started: ``(M,)`` tracklets that are known to start a track, so that none is joined to their starts; by default
            none is.
        places: ``(N,)`` changes of the costs of a start at each detection, and of an end, by which a join may cost
            more; by default none.
        weighed: gets the indices of the detections of all joins that were weighed, and their costs less the most.
    """
    link = replace(link, miss=MISS_OF_JOIN)
    for _ in range(JOIN_PASSES):
        if not (labels >= 0).any():
            break
        parts = join_parts(table, labels, appearance, link)
        i, j, cost = labels[parts.i], labels[parts.j], parts.cost
        if changes is not None:
            cost = cost + changes.joins(evidence_of_joins(table, labels, parts, link))
        if started is not None:
            cost = np.where(started[j], np.inf, cost)
        if places is not None:
            cost = cost - places[0][parts.j] - places[1][parts.i]
        if weighed is not None:
            weighed.append((parts.i, parts.j, cost - MOST_FOR_JOIN))
        earlier, later = cheapest_matching(i, j, cost - MOST_FOR_JOIN)
        if len(earlier) == 0:
            break
        into = np.arange(max(int(labels.max(initial=-1)) + 1, 0 if appearance is None else len(appearance)))
        into[later] = earlier
        while (into != into[into]).any():
            into = into[into]
        if appearance is not None:
            appearance = _means(appearance, into, np.bincount(labels[labels >= 0], minlength=len(into)))
        labels = np.append(into, -1)[labels]
    return labels


def join_parts(table: DetectionTable, labels: IntArray, appearance: FloatArray | None, link: LinkCost) -> LinkParts:
    """What it costs to join the ends of all tracks that may follow each other."""
    ends = Ends.of(labels)
    i, j = _in_time(table, ends, APPEARANCE_WINDOW if appearance is not None else JOIN_WINDOW)
    past, future = _beliefs_at_ends(labels, table.measured, link.motion)
    tails, heads = ends.last[i], ends.first[j]
    one_frame = 1 / table.frame_rate
    seconds = np.asarray((table.frames[heads] - table.frames[tails]) * one_frame, dtype=np.float64)
    wander = table.measured.wander[heads] - table.measured.wander[tails]
    mismatch = link.mismatch(past, future)(tails, heads, table.seconds(tails, heads), wander)
    hidden = Occluders.of(table.frames, table.image, table.size).between(tails, heads)
    cost = mismatch + link.waiting(seconds, one_frame, hidden)
    action = np.full(len(i), np.nan)
    if link.action is not None and table.actions is not None:
        doing = link.action.means(table.frames, labels, table.actions, table.frame_rate)
        action = link.action(*doing, tails, heads, seconds, averaged=link.action.averaged)
        cost = cost + action
    distance = np.full(len(i), np.nan)
    if appearance is not None:
        distance = cosine_distances(appearance, ends.track[i], ends.track[j])
        unlike = link.appearance_cost(distance, averaged=True)
        cost = np.where(np.isnan(distance) & (seconds > JOIN_WINDOW), np.inf, cost + unlike)
    return LinkParts(tails, heads, past, future, seconds, distance, mismatch, hidden, cost, action)


def _beliefs_at_ends(labels: IntArray, measured: Measurements, noise: MotionNoise) -> tuple[Beliefs, Beliefs]:
    """`beliefs_along` within `RUN_UP` of the ends of tracks, and zeros elsewhere: all of a long video fill memory."""
    used = np.flatnonzero(labels >= 0)
    order = used[np.argsort(labels[used], kind="stable")]
    track, place = labels[order], np.arange(len(order))
    first, last = np.searchsorted(track, track), np.searchsorted(track, track, side="right") - 1
    near = np.sort(order[np.minimum(place - first, last - place) <= RUN_UP])
    count = len(labels)
    past, future = (Beliefs(np.zeros((count, 4)), np.zeros((count, 4)), np.zeros((count, 3, 3))) for _ in range(2))
    for beliefs, part in zip((past, future), beliefs_along(labels[near], measured.select(near), noise), strict=True):
        beliefs.place[near], beliefs.velocity[near] = part.place, part.velocity
        beliefs.covariance[near] = part.covariance
    return past, future


def evidence_of_joins(table: DetectionTable, labels: IntArray, parts: LinkParts, link: LinkCost) -> FloatArray:
    """``(P, 29)`` features of joins of tracklets: `JOIN_FEATURES`."""
    ends = Ends.of(labels)
    counts = np.bincount(labels[labels >= 0], minlength=int(labels.max(initial=-1)) + 1)
    spans = np.zeros(len(counts), dtype=np.int64)
    spans[ends.track] = table.frames[ends.last] - table.frames[ends.first]
    sides = labels[parts.i], labels[parts.j]
    columns = [*(np.log(counts[side]) for side in sides), *(np.log1p(spans[side] / table.frame_rate) for side in sides)]
    return np.concatenate([link_evidence(table, parts, link.motion), np.stack(columns, axis=1)], axis=1)


def _in_time(table: DetectionTable, ends: Ends, window: float) -> Pairs:
    """All pairs of tracks of which the second starts within a window after the first ends."""
    order = np.argsort(table.frames[ends.first], kind="stable")
    starts, ending = table.frames[ends.first][order], table.frames[ends.last]
    first = np.searchsorted(starts, ending, side="right")
    count = np.searchsorted(starts, ending + window * table.frame_rate + 1e-9, side="right") - first
    i, place = ranges(first, count)
    return i, order[place]


def cheapest_matching(i: IntArray, j: IntArray, cost: FloatArray) -> Pairs:
    """The one-to-one matching of ``(P,)`` pairs of the least total cost, without pairs that cost 0 or more."""
    worth = cost < 0
    i, j, cost = i[worth], j[worth], cost[worth]
    if len(i) == 0:
        return i, j
    rows, columns = int(i.max()) + 1, int(j.max()) + 1
    links = scipy.sparse.coo_array((np.ones(len(i)), (i, rows + j)), shape=(rows + columns,) * 2)
    part = scipy.sparse.csgraph.connected_components(links, directed=False)[1][i]
    order = np.argsort(part, kind="stable")
    earlier, later = [], []
    for group in np.split(order, np.flatnonzero(np.diff(part[order])) + 1):
        left, a = np.unique(i[group], return_inverse=True)
        right, b = np.unique(j[group], return_inverse=True)
        table = np.zeros((len(left), len(right)))
        table[a, b] = cost[group]
        chosen = scipy.optimize.linear_sum_assignment(table)
        worthwhile = table[chosen] < 0
        earlier.append(left[chosen[0][worthwhile]])
        later.append(right[chosen[1][worthwhile]])
    return np.concatenate(earlier), np.concatenate(later)


def _means(appearance: FloatArray, into: IntArray, weight: IntArray) -> FloatArray:
    """Mean features of the tracks that tracklets were joined to, as rows of their first tracklets."""
    described = ~np.isnan(appearance).any(axis=1)
    sums = np.zeros_like(appearance)
    np.add.at(sums, into[described], appearance[described] * weight[described, None])
    return unit_means(sums)


# Share of a box that others cover together, from which on they explain it.
EXPLAINED = 0.8


def explained_boxes(tracks: Sequence[Track], people: Sequence[bool]) -> list[BoolArray]:
    """``(len(track),)`` for each track: which of its boxes those of surer tracks cover together.

    The surer track is the one whose detections have the larger sum of scores.

    Args:
        tracks: of one video.
        people: which of them may explain others.
    """
    sureness = np.array([float(track.scores[track.observed].sum()) for track in tracks])
    rows = np.concatenate([np.empty(0, np.int64), *(np.full(len(t), n) for n, t in enumerate(tracks))])
    frames = np.concatenate([np.empty(0, np.int64), *(t.frames for t in tracks)])
    boxes = np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)])
    counted = np.asarray(people, dtype=np.bool_)
    explained = np.zeros(len(rows), dtype=np.bool_)
    order = np.argsort(frames, kind="stable")
    for at_once in np.split(order, np.flatnonzero(np.diff(frames[order])) + 1):
        who = rows[at_once]
        surer = counted[who][None] & (sureness[who][None] > sureness[who][:, None])
        explained[at_once] = shared_with_all(boxes[at_once], boxes[at_once], surer) >= EXPLAINED
    ends = np.cumsum([0, *map(len, tracks)])
    return [explained[first:end] for first, end in itertools.pairwise(ends)]


def is_straddling(track: Track, explained: BoolArray) -> bool:
    """Whether most detections of a track are ``explained`` ``(len(track),)`` by others."""
    detected = explained[track.observed]
    return len(detected) > 0 and 2 * int(detected.sum()) > len(detected)


def straddling_tracks(tracks: Sequence[Track]) -> BoolArray:
    """``(N,)`` which tracks of a video have most of their detections on the boxes of surer ones that stay."""
    straddles = np.zeros(len(tracks), dtype=np.bool_)
    # A dropped track explains none. Only surer tracks explain others, so this ends after as many rounds at most.
    for _ in tracks:
        explained = explained_boxes(tracks, (~straddles).tolist())
        pairs = zip(tracks, explained, strict=True)
        now = np.array([is_straddling(track, boxes) for track, boxes in pairs], dtype=np.bool_)
        if (now == straddles).all():
            break
        straddles = now
    return straddles
