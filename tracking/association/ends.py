"""Place and motion of tracks at their ends, from the detections next to them, for many ends at once."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.costs import surprise
from tsuiseki.tracking.filters.kalman import (
    BoxBelief,
    BoxMotion,
    predict_boxes,
    select_boxes,
    start_boxes,
    update_boxes,
)
from tsuiseki.tracking.types import FloatArray, IntArray

MEMORY = 15


def trail(start: IntArray, neighbour: IntArray, frames: IntArray) -> IntArray:
    """The detections of the last frames of a track up to a detection, or of the first from one on.

    Args:
        start: ``(M,)`` indices of detections.
        neighbour: ``(N,)`` index of the previous detection of the track, or of the next; -1 where there is none.
        frames: ``(N,)``.

    Returns:
        ``(MEMORY, M)`` the detection so many frames away, from 0 frames on; -1 where there is none.
    """
    found = np.full((MEMORY, len(start)), -1, dtype=np.int64)
    columns, current = np.arange(len(start)), start
    while len(columns):
        away = np.abs(frames[current] - frames[start[columns]])
        near = away < MEMORY
        columns, current = columns[near], current[near]
        found[away[near], columns] = current
        current = neighbour[current]
        columns, current = columns[current >= 0], current[current >= 0]
    return found


def motion_at_end(detections: IntArray, boxes: FloatArray, motion: BoxMotion) -> BoxBelief:
    """Box and velocity of M tracks at their last detection, time running towards it.

    Args:
        detections: ``(MEMORY, M)`` as `trail` gives them.
        boxes: ``(N, 4)`` pixels.
        motion: noise of the filter.
    """
    belief = start_boxes(np.zeros((detections.shape[1], 4)), motion)
    begun = np.zeros(detections.shape[1], dtype=np.bool_)
    for row in detections[::-1]:
        belief = predict_boxes(belief, motion)
        seen = row >= 0
        going, fresh = np.flatnonzero(seen & begun), np.flatnonzero(seen & ~begun)
        _put(belief, going, update_boxes(select_boxes(belief, going), boxes[row[going]], motion))
        _put(belief, fresh, start_boxes(boxes[row[fresh]], motion))
        begun |= seen
    return belief


def _put(belief: BoxBelief, rows: IntArray, part: BoxBelief) -> None:
    belief.boxes[rows], belief.velocities[rows], belief.variance[rows] = part.boxes, part.velocities, part.variance


def backwards(belief: BoxBelief) -> BoxBelief:
    """The same places and motions with time running the other way."""
    return BoxBelief(belief.boxes, -belief.velocities, belief.variance)


def mean_looks(detections: IntArray, features: FloatArray) -> tuple[FloatArray, IntArray]:
    """Mean features of the detections of M trails.

    Args:
        detections: ``(MEMORY, M)`` as `trail` gives them.
        features: ``(N, D)`` of unit length, NaN where not known.

    Returns:
        ``(M, D)`` of unit length, 0 where none is known, and ``(M,)`` how many are known.
    """
    known = np.asarray(~np.isnan(features).any(axis=1))
    total = np.zeros((detections.shape[1], features.shape[1]))
    count = np.zeros(detections.shape[1], dtype=np.int64)
    for row in detections:
        usable = np.flatnonzero((row >= 0) & known[row])
        total[usable] += features[row[usable]]
        count[usable] += 1
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0), count


def meeting(
    end: BoxBelief, start: BoxBelief, gap: IntArray, motion: BoxMotion, size: float, tails: float
) -> tuple[FloatArray, FloatArray]:
    """How ill the motion at P ends and that at the P starts after them go together.

    Both motions are followed to the middle of the gap, where their errors are least, and compared there in place and
    velocity, and the heights with each other.

    Args:
        end: before the gap.
        start: after it.
        gap: ``(P,)`` frames between the two.
        motion: noise of the filter that gave them.
        size: scale of the log ratio of the heights.
        tails: degrees of freedom of the distributions, as in `HandSetCost`.

    Returns:
        ``(P,)`` -log p / p(no difference) of all that differs, and ``(P,)`` the variance of the place, squared heights.
    """
    half = gap / 2
    heights = [belief.boxes[:, 3] - belief.boxes[:, 1] for belief in (end, start)]
    unit = ((heights[0] + heights[1]) / 2)[:, None]
    forward, backward = end.boxes + half[:, None] * end.velocities, start.boxes - half[:, None] * start.velocities
    apart = _centre(forward - backward) / unit
    turn = _centre(end.velocities - start.velocities) / unit
    place = _later_variance(end.variance, half, motion) + _later_variance(start.variance, half, motion)
    speed = end.variance[:, 2] + start.variance[:, 2] + motion.acceleration**2 * gap
    total = surprise((apart**2).sum(axis=1) / place, 2, tails)
    total += surprise((turn**2).sum(axis=1) / speed, 2, tails)
    total += surprise((np.log(heights[1] / heights[0]) / size) ** 2, 1, tails)
    return total, place


def _centre(corners: FloatArray) -> FloatArray:
    return (corners[:, :2] + corners[:, 2:]) / 2


def _later_variance(variance: FloatArray, frames: FloatArray, motion: BoxMotion) -> FloatArray:
    """Variance of a place so many frames on, in squared heights."""
    spread = variance[:, 0] + 2 * frames * variance[:, 1] + frames**2 * variance[:, 2]
    return np.asarray(spread + motion.acceleration**2 * frames**3 / 3)
