"""Joining the pieces of tracks across longer gaps, by the motion and the looks of whole pieces.

The flow over detections sees pairs only: a pair has no velocity, and the looks of a single box are noisy. A piece of a
track has both. So the same network is solved once more with pieces for detections: the observation cost of a piece is
what its detections and links cost in the first solution, and a transition is priced by how well the motion at the end
of one piece meets the motion at the start of the next, and how alike the two look on average.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.association.ends import backwards, meeting, motion_at_end, trail
from tsuiseki.tracking.association.network_flow import build_graph, solve, track_labels
from tsuiseki.tracking.filters.kalman import BoxBelief, BoxMotion, select_boxes
from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class Tracklets:
    """M pieces of tracks.

    Attributes:
        first: ``(M,)`` frame of the first detection of each.
        last: ``(M,)`` frame of the last one.
        cost: ``(M,)`` sum of the observation and transition costs within the piece.
        start: box and velocity at the first frame, velocity as time runs.
        end: box and velocity at the last frame.
        looks: ``(M, D)`` mean features of unit length, NaN where not known; None where nothing was described.
    """

    first: IntArray
    last: IntArray
    cost: FloatArray
    start: BoxBelief
    end: BoxBelief
    looks: FloatArray | None

    def __len__(self) -> int:
        return len(self.first)


@dataclass(frozen=True)
class JoinSettings:
    """What two pieces of one person may differ in.

    Attributes:
        window: largest gap between two pieces, in frames.
        bias: exponent of the cost of two pieces that fit perfectly, of neutral looks.
        spread: how much longer gaps count against a link, as their region of likely positions grows.
        size: scale of the log ratio of the heights.
        tails: degrees of freedom of the distributions of place, velocity and size, as in `HandSetCost`.
        appearance: weight of the cosine distance of the mean features.
        neutral: cosine distance that speaks neither for nor against, taken also where the distance is not known.
        miss: cost of every frame between two pieces.
        entry: cost of a track's start; a track must be worth its start and its end to be believed.
        exit: cost of a track's end.
        motion: noise of the filter that estimates the motion at the ends.
    """

    window: int = 50
    bias: float = -4.0
    spread: float = 1.0
    size: float = 0.1
    tails: float = 5.0
    appearance: float = 18.0
    neutral: float = 0.24
    miss: float = 0.05
    entry: float = 4.5
    exit: float = 4.5
    motion: BoxMotion = field(default_factory=lambda: BoxMotion(0.08, 0.01, 0.05))


def make_tracklets(
    frames: IntArray,
    boxes: FloatArray,
    costs: FloatArray,
    labels: IntArray,
    looks: FloatArray | None,
    motion: BoxMotion,
) -> Tracklets:
    """Summarise the pieces of tracks.

    Args:
        frames: ``(N,)`` of the detections.
        boxes: ``(N, 4)`` pixels.
        costs: ``(N,)`` of each detection and of its link to the next.
        labels: ``(N,)`` number of the piece from 0 on, -1 where a detection belongs to none.
        looks: ``(M, D)`` unit-length mean features of the pieces, NaN where not known; None where not described.
        motion: noise of the filter that estimates the motion at the ends.
    """
    used = np.flatnonzero(labels >= 0)
    order = used[np.lexsort((frames[used], labels[used]))]
    count = int(labels.max(initial=-1)) + 1
    bounds = np.searchsorted(labels[order], np.arange(count + 1))
    first, last = order[bounds[:-1]], order[bounds[1:] - 1]
    following, previous = np.full(len(labels), -1), np.full(len(labels), -1)
    same = labels[order[1:]] == labels[order[:-1]]
    following[order[:-1][same]], previous[order[1:][same]] = order[1:][same], order[:-1][same]
    return Tracklets(
        frames[first],
        frames[last],
        np.bincount(labels[order], weights=costs[order], minlength=count).astype(np.float64),
        backwards(motion_at_end(trail(first, following, frames), boxes, motion)),
        motion_at_end(trail(last, previous, frames), boxes, motion),
        looks,
    )


def join(tracklets: Tracklets, settings: JoinSettings) -> IntArray:
    """``(M,)`` number of the track that each piece belongs to, from 0 on; -1 for a piece that is not worth its cost.

    Args:
        tracklets: the pieces.
        settings: what the links between them cost.
    """
    before, after = _in_reach(tracklets, settings.window)
    gap = tracklets.first[after] - tracklets.last[before]
    cost = _join_cost(tracklets, before, after, gap, settings) + settings.miss * (gap - 1)
    graph = build_graph(tracklets.cost, [(before, after, cost)], settings.entry, settings.exit)
    return track_labels(solve(graph))


def _in_reach(tracklets: Tracklets, window: int) -> tuple[IntArray, IntArray]:
    """All pairs of pieces of which the second starts 1 to ``window`` frames after the first ends."""
    order = np.argsort(tracklets.first, kind="stable")
    starts = tracklets.first[order]
    first = np.searchsorted(starts, tracklets.last, side="right")
    count = np.searchsorted(starts, tracklets.last + window, side="right") - first
    before = np.repeat(np.arange(len(tracklets)), count)
    return before, order[np.arange(len(before)) + np.repeat(first - np.cumsum(count) + count, count)]


def _join_cost(
    tracklets: Tracklets, before: IntArray, after: IntArray, gap: IntArray, settings: JoinSettings
) -> FloatArray:
    """Costs of the links, above 0: log(1 + exp(q)) as for detections, with the motion of both sides."""
    end, start = select_boxes(tracklets.end, before), select_boxes(tracklets.start, after)
    q, place = meeting(end, start, gap, settings.motion, settings.size, settings.tails)
    q += settings.bias + settings.spread * np.log(place / settings.motion.measurement**2)
    if tracklets.looks is not None:
        distance = 1 - np.einsum("pd,pd->p", tracklets.looks[before], tracklets.looks[after])
        q += settings.appearance * np.nan_to_num(distance - settings.neutral)
    return np.asarray(np.logaddexp(0, q))
