"""Where a track may have gone over to another person: the places, and how likely that is at each.

It may where two tracks overlap, and where a track was not detected for a while. Before and after such a place a
straight line is fitted to a second of detections. What the two ways differ by as they are, and with the people
exchanged, is a cost. Of a result of the flow its min-marginals come in: what the cheapest flow with another link there
costs more (`marginals`). A logistic function of these gives the probability.

The probabilities are fitted on generated streets; see `HandoverWeights`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from tsuiseki.tracking.association.marginals import Marginals
from tsuiseki.tracking.association.near_links import solved_on_near_links
from tsuiseki.tracking.association.nearby import near_pairs, ranges, sizes
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import BoolArray, Columns, FloatArray, IntArray, Track

# Share of the smaller of two boxes that the other covers where two people meet.
COVERED = 0.4
# Seconds for which two people may be apart within one meeting.
PARTED = 0.6
# Seconds without a detection from which on a gap is a place.
UNSEEN = 0.25
# Seconds around a place that belong to it.
AROUND = 0.5
# Costs from which on nothing is in doubt, nats.
CERTAIN = 30.0
# Margins of the flow that count, nats.
MARGIN = 6.0
# Margins of exchanges that are searched, nats.
EXCHANGE = 4.0
# Least probability of a place that is weighed.
WEIGHED = 0.02
# Least probability of a place that is marked.
MARKED = 0.08
FEATURES = ("gap", "stays", "changes", "gain", "others", "before", "after", "met", "apart", "link", "exchange")


@dataclass(frozen=True)
class HandoverWeights:
    """Weights of `FEATURES`, the constant last, fitted on generated streets of seeds below 120.

    Attributes:
        flow: of results that keep the network of their flow.
        tracks: of others.
    """

    flow: tuple[float, ...] = (0.35, 0.14, -0.06, -0.05, 0.58, 0.51, 0.41, 0.32, -0.36, -0.35, -0.31, -2.23)
    tracks: tuple[float, ...] = (0.48, 0.2, -0.1, -0.07, 0.98, 0.35, 0.21, 0.45, -0.61, 0.0, 0.0, -4.89)


WEIGHTS = HandoverWeights()


@dataclass(frozen=True)
class Handovers(Columns):
    """Places at which a track may have gone over to another person, the likeliest of each track and time first.

    Attributes:
        track: ``(E,)`` number of the track.
        other: ``(E,)`` number of the track that it meets there; -1 where it was only not detected.
        first: ``(E,)`` frame at which it begins, from 0.
        last: ``(E,)`` frame at which it ends.
        probability: ``(E,)`` that the person is another one afterwards.
    """

    track: IntArray
    other: IntArray
    first: IntArray
    last: IntArray
    probability: FloatArray

    @property
    def marked(self) -> IntArray:
        """Rows worth a mark, the likeliest first; of a meeting of two tracks one: an exchange concerns both."""
        kept, spans = list[int](), dict[int, list[tuple[int, int]]]()
        for row in np.flatnonzero(self.probability >= MARKED).tolist():
            track, first, last = int(self.track[row]), int(self.first[row]), int(self.last[row])
            if all(begin > last or end < first for begin, end in spans.get(track, ())):
                for concerned in (track, int(self.other[row])):
                    spans.setdefault(concerned, []).append((first, last))
                kept.append(row)
        return np.array(kept, dtype=np.int64)

    def chance(self, track: IntArray, first: FloatArray, last: FloatArray) -> FloatArray:
        """``(K,)`` that the person of a track ``(K,)`` is another one somewhere from a frame ``(K,)`` to another."""
        order = np.argsort(self.track, kind="stable")
        low, high = (np.searchsorted(self.track[order], track, side) for side in ("left", "right"))
        span, place = ranges(low, high - low)
        row = order[place]
        within = (self.last[row] > first[span]) & (self.first[row] < last[span])
        kept = np.log1p(-np.minimum(self.probability[row[within]], 1 - 1e-9))
        return np.asarray(1 - np.exp(np.bincount(span[within], kept, len(track))))


@dataclass(frozen=True)
class _Rows:
    """The detections of all tracks, one track after the other.

    Attributes:
        key: ``(D,)`` increasing: track and frame in one number.
        wide: of a track in the keys.
        starts: ``(N + 1,)`` first row of each track.
        frames: ``(D,)``.
        places: ``(D, 2)`` feet, pixels.
        heights: ``(D,)`` pixels.
    """

    key: IntArray
    wide: int
    starts: IntArray
    frames: IntArray
    places: FloatArray
    heights: FloatArray

    @classmethod
    def of(cls, tracks: Sequence[Track]) -> _Rows:
        numbers = np.repeat(np.arange(len(tracks)), [int(track.observed.sum()) for track in tracks])
        frames = np.concatenate([track.frames[track.observed] for track in tracks])
        boxes = np.concatenate([track.boxes[track.observed] for track in tracks])
        wide = int(max((track.frames[-1] for track in tracks), default=0)) + 2
        starts = np.searchsorted(numbers, np.arange(len(tracks) + 1))
        places = np.column_stack([boxes[:, [0, 2]].mean(axis=1), boxes[:, 3]])
        return cls(numbers * wide + frames, wide, starts, frames, places, sizes(boxes)[:, 1])


@dataclass(frozen=True)
class _Ways(Columns):
    """Straight ways of K sides of places, heights of the person where not said otherwise.

    Attributes:
        there: ``(K,)`` whether there is a detection on this side.
        row: ``(K,)`` of the detection next to the place.
        time: ``(K,)`` of it, seconds.
        place: ``(K, 2)`` pixels.
        speed: ``(K, 2)`` pixels a second.
        height: ``(K,)`` pixels.
    """

    there: BoolArray
    row: IntArray
    time: FloatArray
    place: FloatArray
    speed: FloatArray
    height: FloatArray


def handovers_of(tracks: Sequence[Track], rate: float, network: SolvedNetwork | None = None) -> Handovers:
    """The places of tracks at ``rate`` frames a second; ``network`` is what their flow was solved on, if any.

    Of places of one track at one time only the likeliest stays; none stays below `WEIGHED`.
    """
    empty = np.empty(0, np.int64)
    detected = [number for number, track in enumerate(tracks) if track.observed.any()]
    if not detected:
        return Handovers(empty, empty, empty, empty, np.empty(0))
    margins = None if network is None or network.given or not len(network) else _margins(network, tracks)
    track, other, first, last = _places(tracks, rate)
    features, usable = handover_features(tracks, rate, (track, other, first, last), margins)
    weights = np.array(WEIGHTS.tracks if margins is None else WEIGHTS.flow)
    probability = scipy.special.expit(features @ weights[:-1] + weights[-1])
    probability[~usable] = 0.0
    places = Handovers(track, other, first, last, probability)
    return places.select(_likeliest(places, AROUND * rate))


def _places(tracks: Sequence[Track], rate: float) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Track, track met or -1, first and last frame of all places; a meeting is one of each of both."""
    numbers = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    frames = np.concatenate([track.frames for track in tracks])
    boxes = np.concatenate([track.boxes for track in tracks])
    order = np.argsort(frames, kind="stable")
    numbers, frames, boxes = numbers[order], frames[order], boxes[order]
    i, j = near_pairs(frames, centres(boxes), sizes(boxes), 0)
    low, high = np.maximum(boxes[i, :2], boxes[j, :2]), np.minimum(boxes[i, 2:], boxes[j, 2:])
    shared, area = np.maximum(high - low, 0).prod(axis=1), sizes(boxes).prod(axis=1)
    meet = (numbers[i] != numbers[j]) & (shared >= COVERED * np.minimum(area[i], area[j]))
    i, j = np.append(i[meet], j[meet]), np.append(j[meet], i[meet])
    order = np.lexsort((frames[i], numbers[j], numbers[i]))
    a, b, when = numbers[i[order]], numbers[j[order]], frames[i[order]]
    new = np.append(True, (np.diff(a) != 0) | (np.diff(b) != 0) | (np.diff(when) > PARTED * rate))[: len(a)]
    starts = np.flatnonzero(new)
    ends = np.append(starts[1:], len(a))[: len(starts)] - 1
    rows = _Rows.of(tracks)
    steps, owner = np.diff(rows.frames), rows.key // rows.wide
    gaps = np.flatnonzero((np.diff(owner) == 0) & (steps > max(2, UNSEEN * rate)))
    columns = (
        (a[starts], owner[gaps]),
        (b[starts], np.full(len(gaps), -1)),
        (when[starts], rows.frames[gaps]),
        (when[ends], rows.frames[gaps + 1]),
    )
    track, other, first, last = (np.concatenate(parts) for parts in columns)
    return track, other, first, last


def handover_features(
    tracks: Sequence[Track],
    rate: float,
    places: tuple[IntArray, IntArray, IntArray, IntArray],
    margins: tuple[IntArray, FloatArray, FloatArray] | None,
) -> tuple[FloatArray, BoolArray]:
    """``(E, 11)`` `FEATURES` of places, and ``(E,)`` which have detections on both sides.

    Args:
        tracks: of one video.
        rate: frames a second.
        places: ``(E,)`` track, track met or -1, first and last frame.
        margins: of the flow, see `_margins`; None for none.
    """
    track, other, first, last = places
    rows = _Rows.of(tracks)
    before, after = _ways(rows, track, first, rate, True), _ways(rows, track, last, rate, False)
    met = other >= 0
    partner = np.maximum(other, 0)
    their_before, their_after = _ways(rows, partner, first, rate, True), _ways(rows, partner, last, rate, False)
    come, go = met & their_before.there, met & their_after.there
    stays = _mismatch(before, after) + np.where(come & go, _mismatch(their_before, their_after), 0)
    crossed = np.where(come, _mismatch(their_before, after), 0) + np.where(go, _mismatch(before, their_after), 0)
    changes = np.where(come | go, crossed, CERTAIN)
    changes[~met] = _nearest_ends(rows, track[~met], before.select(~met), after.select(~met), rate)
    apart = np.where(come, np.linalg.norm(their_before.speed - before.speed, axis=1) / before.height, 0)
    start, end = (rows.frames[rows.starts[track + k] - k] / rate for k in (0, 1))
    link, exchange = _least_margins(rows, places, rate, margins)
    columns = (
        np.log(_longest_gap(rows, before.row, after.row) / rate), np.minimum(stays, 20), np.minimum(changes, 20),
        np.clip(stays - changes, -15, 15), np.log(_together(track, first, last, AROUND * rate)),
        np.log(np.maximum(before.time - start, 0.1)), np.log(np.maximum(end - after.time, 0.1)),
        met.astype(np.float64), np.log(0.1 + apart), link, exchange,
    )  # fmt: skip
    return np.column_stack(columns), before.there & after.there


def _ways(rows: _Rows, track: IntArray, frame: IntArray, rate: float, before: bool) -> _Ways:
    """The ways of ``(K,)`` tracks over a second before frames ``(K,)``, or after them."""
    start, end, count = rows.starts[track], rows.starts[track + 1], int(np.ceil(rate))
    at = np.searchsorted(rows.key, track * rows.wide + frame, "right" if before else "left")
    low, high = (np.maximum(at - count, start), at) if before else (at, np.minimum(at + count, end))
    there = (high > low) & (high <= end) & (low >= start)
    low, high = np.where(there, low, start), np.where(there, high, start + 1)
    low, high = np.minimum(low, len(rows.key) - 1), np.minimum(high, len(rows.key))
    origin = rows.frames[rows.starts[np.minimum(rows.key // rows.wide, len(rows.starts) - 2)]]
    time = (rows.frames - origin) / rate
    values = np.column_stack(
        [np.ones(len(time)), time, time**2, rows.heights, rows.places, rows.places * time[:, None]]
    )
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    total = sums[high] - sums[low]
    number = np.maximum(total[:, 0], 1)
    mean, height = total[:, 1] / number, total[:, 3] / number
    spread = total[:, 2] - number * mean**2
    row = high - 1 if before else low
    straight = (number >= 4) & (rows.frames[high - 1] - rows.frames[low] > 0.2 * rate)
    covariance = total[:, 6:8] - mean[:, None] * total[:, 4:6]
    speed = np.where(straight[:, None], covariance / np.maximum(spread, 1e-9)[:, None], 0)
    fitted = total[:, 4:6] / number[:, None] + speed * (time[row] - mean)[:, None]
    place = np.where(straight[:, None], fitted, rows.places[row])
    return _Ways(there, row, rows.frames[row] / rate, place, speed, np.maximum(height, 1e-9))


def _mismatch(before: _Ways, after: _Ways) -> FloatArray:
    """``(K,)`` cost of going on from one way to the other, both thought on to the middle of the gap, nats."""
    gap = np.maximum(after.time - before.time, 0)
    tall, reach = np.sqrt(before.height * after.height), np.minimum(gap, 2)[:, None] / 2
    ends = before.place + before.speed * reach, after.place - after.speed * reach
    apart = np.linalg.norm(ends[0] - ends[1], axis=1) / tall / (0.12 + 0.25 * gap)
    turned = np.linalg.norm(before.speed - after.speed, axis=1) / tall / 0.6
    grown = np.log(before.height / after.height) / 0.12
    return np.asarray(np.minimum(0.5 * (apart**2 + turned**2 + grown**2), CERTAIN))


def _nearest_ends(rows: _Rows, track: IntArray, before: _Ways, after: _Ways, rate: float) -> FloatArray:
    """``(K,)`` least cost at which another track that ends or begins in a gap takes a part of the track."""
    least, slack = np.full(len(track), CERTAIN), 0.2 * rate
    whole = np.flatnonzero(np.diff(rows.starts))
    for ends in (True, False):
        edge = rows.frames[(rows.starts[1:] - 1 if ends else rows.starts[:-1])[whole]]
        order = np.argsort(edge, kind="stable")
        low = np.searchsorted(edge[order], before.time * rate - slack - 1e-6)
        high = np.searchsorted(edge[order], after.time * rate + slack + 1e-6, "right")
        gap, place = ranges(low, np.maximum(high - low, 0))
        other = whole[order[place]]
        apart = other != track[gap]
        gap, other = gap[apart], other[apart]
        theirs = _ways(rows, other, edge[order[place]][apart], rate, ends)
        ours = (after if ends else before).select(gap)
        np.minimum.at(least, gap, _mismatch(theirs, ours) if ends else _mismatch(ours, theirs))
    return least


def _longest_gap(rows: _Rows, low: IntArray, high: IntArray) -> FloatArray:
    """``(K,)`` frames of the longest step between the detections from a row to another of the same track."""
    steps = np.append(np.diff(rows.frames), 1).astype(np.float64)
    return _least_within(-steps, low, np.maximum(high, low), -1.0) * -1


def _least_within(values: FloatArray, low: IntArray, high: IntArray, default: float) -> FloatArray:
    """``(K,)`` least of ``values`` from ``low`` to before ``high``; the default where there is none."""
    ends = np.column_stack([low, np.maximum(high, low)]).ravel()
    least = np.minimum.reduceat(np.append(values, default), np.minimum(ends, len(values)))[::2]
    return np.where(high > low, least, default)


def _together(track: IntArray, first: IntArray, last: IntArray, slack: float) -> IntArray:
    """``(E,)`` how many places of a track there are at the time of each, itself included."""
    wide = int(last.max(initial=0)) + 2 * int(np.ceil(slack)) + 4
    begins, ends = np.sort(track * wide + first), np.sort(track * wide + last)
    begun = np.searchsorted(begins, track * wide + last + slack, "right")
    return np.asarray(np.maximum(begun - np.searchsorted(ends, track * wide + first - slack), 1))


def _margins(network: SolvedNetwork, tracks: Sequence[Track]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Track and frame in one number ``(K,)``, increasing, and the margins of a link there, and of an exchange."""
    flow = solved_on_near_links(network.graph)[1]
    ids, first, graph = network.track, 3 * flow.count, flow.graph
    used, both = flow.used[first:], (ids[graph.tail] > 0) & (ids[graph.head] > 0)
    which = np.append(np.zeros(first, np.bool_), both & ~used)
    found = Marginals(flow, EXCHANGE, which)
    through, cost = np.minimum(found.through[first:], MARGIN), found.cost[first:]
    linked, others = np.flatnonzero(used & both), np.flatnonzero(both & ~used & (cost < EXCHANGE))
    rows = np.concatenate([graph.head[linked], graph.head[others], graph.tail[others]])
    link = np.append(through[linked], np.full(2 * len(others), MARGIN))
    exchange = np.concatenate([np.full(len(linked), MARGIN), cost[others], cost[others]])
    wide = int(max((track.frames[-1] for track in tracks), default=0)) + 2
    numbers = {track.id: number for number, track in enumerate(tracks)}
    number = np.array([numbers.get(int(name), len(tracks)) for name in ids[rows]], dtype=np.int64)
    key = number * wide + network.frames[rows]
    order = np.argsort(key, kind="stable")
    return key[order], link[order], exchange[order]


def _least_margins(
    rows: _Rows,
    places: tuple[IntArray, IntArray, IntArray, IntArray],
    rate: float,
    margins: tuple[IntArray, FloatArray, FloatArray] | None,
) -> tuple[FloatArray, FloatArray]:
    """``(E,)`` least margin of a link at each place, and of an exchange."""
    track, _, first, last = places
    if margins is None:
        return np.full(len(track), MARGIN), np.full(len(track), MARGIN)
    key, link, exchange = margins
    low = np.searchsorted(key, track * rows.wide + np.maximum(first - 0.2 * rate, 0))
    high = np.searchsorted(key, track * rows.wide + np.minimum(last + 0.2 * rate, rows.wide - 1), "right")
    return _least_within(link, low, high, MARGIN), _least_within(exchange, low, high, MARGIN)


def _likeliest(places: Handovers, slack: float) -> IntArray:
    """Rows of the likeliest place of each track at each time, the likeliest first; none below `WEIGHED`."""
    order = np.argsort(-places.probability, kind="stable")
    order, taken, kept = order[places.probability[order] >= WEIGHED], dict[int, list[tuple[int, int]]](), list[int]()
    for row in order.tolist():
        first, last = int(places.first[row]), int(places.last[row])
        spans = taken.setdefault(int(places.track[row]), [])
        if all(begin > last + slack or end < first - slack for begin, end in spans):
            spans.append((first, last))
            kept.append(row)
    return np.array(kept, dtype=np.int64)
