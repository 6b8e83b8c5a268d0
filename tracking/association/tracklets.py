"""Joining the pieces of tracks across longer gaps, by the motion and the looks of whole pieces.

The flow over detections sees pairs only: a pair has no velocity, and the looks of a single box are noisy. A piece of a
track has both. So the same network is solved once more with pieces for detections: the observation cost of a piece is
what its detections and links cost in the first solution, and a transition is priced by how well the motion at the end
of one piece meets the motion at the start of the next, and how alike the two look on average.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from tsuiseki.tracking.association.network_flow import FlowSolution, build_graph, solve, track_labels
from tsuiseki.tracking.association.windows import Decision
from tsuiseki.tracking.filters.kalman import BoxBelief, BoxMotion, predict_boxes, start_boxes, update_boxes
from tsuiseki.tracking.types import FloatArray, IntArray

MEMORY = 15


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
        size: standard deviation of the log ratio of the heights.
        appearance: weight of the cosine distance of the mean features.
        neutral: cosine distance that speaks neither for nor against, taken also where the distance is not known.
        miss: cost of every frame between two pieces.
        entry: cost of a track's start; a track must be worth its start and its end to be believed.
        exit: cost of a track's end.
        motion: noise of the filter that estimates the motion at the ends.
    """

    window: int = 55
    bias: float = -1.0
    spread: float = 0.5
    size: float = 0.15
    appearance: float = 10.0
    neutral: float = 0.2
    miss: float = 0.04
    entry: float = 4.5
    exit: float = 4.5
    motion: BoxMotion = field(default_factory=lambda: BoxMotion(0.08, 0.017, 0.056))


class Pieces:
    """The pieces of tracks as decisions of the flow come in, and what is needed of them later.

    Pieces are numbered from 0 on in the order of their first detections. A detection has a cost (its own and that of
    the link to the next) and features, of which only the sum over the piece is kept.
    """

    def __init__(self) -> None:
        self._labels = np.empty(0, dtype=np.int64)
        self._costs = np.empty(0)
        self._count = 0
        self._looks = np.empty((0, 0))

    def copy(self) -> Pieces:
        """A copy that can grow by itself."""
        other = Pieces()
        other._labels, other._costs = self._labels.copy(), self._costs.copy()
        other._count, other._looks = self._count, self._looks.copy()
        return other

    def add(self, decision: Decision, features: FloatArray | None) -> None:
        """Take decided detections.

        Args:
            decision: with increasing numbers.
            features: ``(K, D)`` of unit length, or NaN where not known; None where nothing was described.
        """
        numbers, follower = decision.numbers, decision.follower
        if len(numbers) == 0:
            return
        self._grow(int(max(numbers.max(), follower.max())) + 1)
        self._costs[numbers] = decision.cost
        place = np.searchsorted(numbers, follower).clip(max=len(numbers) - 1)
        within = (follower >= 0) & (numbers[place] == follower)
        chain = track_labels(FlowSolution(decision.used, np.where(within, place, -1), np.zeros(len(numbers)), 0.0))
        used = decision.used
        heads = np.unique(chain[used], return_index=True)[1]
        label = self._labels[numbers[used][heads]]
        fresh = label < 0
        label[fresh] = self._count + np.arange(fresh.sum())
        self._count += int(fresh.sum())
        self._labels[numbers[used]] = label[chain[used]]
        leaving = (follower >= 0) & ~within
        self._labels[follower[leaving]] = label[chain[leaving]]
        if features is not None:
            self._add_looks(self._labels[numbers[used]], features[used])

    def labels(self, count: int) -> IntArray:
        """``(count,)`` piece of each detection, -1 for one that belongs to none."""
        self._grow(count)
        return self._labels

    @property
    def costs(self) -> FloatArray:
        """``(N,)`` costs of the detections."""
        return self._costs

    def looks(self) -> FloatArray | None:
        """``(M, D)`` unit-length mean features of the pieces, NaN where not known; None if nothing was described."""
        if self._looks.shape[1] == 0:
            return None
        missing = self._count - len(self._looks)
        sums = np.concatenate([self._looks, np.zeros((missing, self._looks.shape[1]))])
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.asarray(np.divide(sums, length, out=np.full_like(sums, np.nan), where=length > 0))

    def _grow(self, count: int) -> None:
        more = count - len(self._labels)
        if more > 0:
            self._labels = np.append(self._labels, np.full(more, -1))
            self._costs = np.append(self._costs, np.zeros(more))

    def _add_looks(self, labels: IntArray, features: FloatArray) -> None:
        known = ~np.isnan(features).any(axis=1)
        labels, features = labels[known], features[known]
        sums = np.zeros((self._count, features.shape[1]))
        sums[: len(self._looks), : self._looks.shape[1]] = self._looks
        member = csr_array((np.ones(len(labels)), (labels, np.arange(len(labels)))), shape=(self._count, len(labels)))
        self._looks = sums + member @ features


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
        frames: ``(N,)`` of the detections, sorted within each piece.
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
    first, last = frames[order[bounds[:-1]]], frames[order[bounds[1:] - 1]]
    start = _filtered(-frames, boxes, order[::-1], labels, -first, motion)
    return Tracklets(
        first,
        last,
        np.bincount(labels[order], weights=costs[order], minlength=count).astype(np.float64),
        BoxBelief(start.boxes, -start.velocities, start.variance),
        _filtered(frames, boxes, order, labels, last, motion),
        looks,
    )


def _filtered(
    times: IntArray, boxes: FloatArray, order: IntArray, labels: IntArray, until: IntArray, motion: BoxMotion
) -> BoxBelief:
    """Box and velocity of each piece at its last time ``until``, from the detections of the frames before.

    All pieces are filtered together, in as many steps as the filter remembers frames.
    """
    age = until[labels[order]] - times[order]
    recent = order[age < MEMORY]
    detection = np.full((MEMORY, len(until)), -1, dtype=np.int64)
    detection[MEMORY - 1 - age[age < MEMORY], labels[recent]] = recent
    belief = start_boxes(np.zeros((len(until), 4)), motion)
    begun = np.zeros(len(until), dtype=np.bool_)
    for row in detection:
        belief = predict_boxes(belief, motion)
        seen = np.flatnonzero(row >= 0)
        updated = update_boxes(belief, boxes[row.clip(0)], motion)
        new = start_boxes(boxes[row.clip(0)], motion)
        going, fresh = seen[begun[seen]], seen[~begun[seen]]
        for part, source in ((going, updated), (fresh, new)):
            belief.boxes[part] = source.boxes[part]
            belief.velocities[part] = source.velocities[part]
            belief.variance[part] = source.variance[part]
        begun[seen] = True
    return belief


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
    end, start, motion = tracklets.end, tracklets.start, settings.motion
    half = (gap / 2)[:, None]
    height = (end.boxes[before, 3] - end.boxes[before, 1] + start.boxes[after, 3] - start.boxes[after, 1]) / 2
    # Both motions are followed to the middle of the gap, where the errors are least.
    forward = end.boxes[before] + half * end.velocities[before]
    backward = start.boxes[after] - half * start.velocities[after]
    apart = _centre(forward - backward) / height[:, None]
    turn = _centre(end.velocities[before] - start.velocities[after]) / height[:, None]
    place = _spread_of_place(end.variance[before], half[:, 0], motion)
    place += _spread_of_place(start.variance[after], half[:, 0], motion)
    speed = end.variance[before, 2] + start.variance[after, 2] + motion.acceleration**2 * gap
    sizes = np.log(start.boxes[after, 3] - start.boxes[after, 1]) - np.log(end.boxes[before, 3] - end.boxes[before, 1])
    q = (apart**2).sum(axis=1) / place + (turn**2).sum(axis=1) / speed + (sizes / settings.size) ** 2
    q = settings.bias + q / 2 + settings.spread * np.log(place / motion.measurement**2)
    if tracklets.looks is not None:
        distance = 1 - np.einsum("pd,pd->p", tracklets.looks[before], tracklets.looks[after])
        q += settings.appearance * np.nan_to_num(distance - settings.neutral)
    return np.asarray(np.logaddexp(0, q))


def _centre(corners: FloatArray) -> FloatArray:
    return (corners[:, :2] + corners[:, 2:]) / 2


def _spread_of_place(variance: FloatArray, frames: FloatArray, motion: BoxMotion) -> FloatArray:
    """Variance of a position so many frames on, in squared heights."""
    spread = variance[:, 0] + 2 * frames * variance[:, 1] + frames**2 * variance[:, 2]
    return np.asarray(spread + motion.acceleration**2 * frames**3 / 3)
