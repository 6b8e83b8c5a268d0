"""How a camera moved, from boxes alone.

People move in many directions, but the motion of the camera shifts all boxes alike. Each pair of neighbouring frames is
explained by a similarity (shift, rotation, scale) that most of its pairs of boxes agree on. Pairs of boxes within one
height of each other take part. Each has a weight w, larger for boxes of more similar size, and a height h, the mean of
its two boxes. The first guess is the shift that most pairs are near to. A similarity is then fitted by reweighted least
squares with the weights

    (w / h²) / (1 + |d − s|² / (k h)²)².

Here d is the difference of the two centres, s the difference that the similarity predicts, and k the tolerance, in
heights: how far people move by themselves between two frames, and how far their boxes are off. A ridge penalty keeps
rotation and scale small. All pairs of frames are estimated at once.

Fewer than four pairs that agree are too few: one person who walks looks like a camera that turns. The camera is then
taken to stand still. If it was moving just before, the motion of these few pairs is taken. Either way the step
is uncertain: links over it reach further.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.association.nearby import near_pairs, sizes
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import FloatArray, IntArray

# How far a box moves between two frames at most, heights.
REACH = 1.0
# Width of the kernel that votes for the first shift, heights a second.
MODE = 1.5
# k: how far people move by themselves, heights a second.
TOLERANCE = 0.45
# Rounds of the reweighted least squares.
ROUNDS = 8
# Weight of the ridge penalty on rotation and scale, over the spread of the boxes.
RIDGE = 0.5
# Weighted number of pairs that must agree: one person who walks looks like a camera that turns.
LEAST = 4.0
# Shift a second, in heights, from which the camera counts as moving.
MOVING = 0.3


def doubt_of(support: float, frame_rate: float, noise: float = 0.0) -> float:
    """Standard deviation of a step that fewer pairs than `LEAST` agree with, in heights of a box.

    The tolerance, divided by the root of the number of pairs that agree.
    """
    return (TOLERANCE / frame_rate + math.sqrt(2) * noise) / math.sqrt(max(support, 0.25))


@dataclass(frozen=True)
class CameraSteps:
    """How the camera moved into each of T frames.

    Attributes:
        similarity: ``(T, 2, 3)`` transform from pixels of the frame before to pixels of each frame.
        support: ``(T,)`` weighted number of pairs that agree with it.
        shift: ``(T,)`` length of the shift in the middle of the boxes, in heights of a box.
    """

    similarity: FloatArray
    support: FloatArray
    shift: FloatArray


def steps_from_boxes(
    frames: IntArray, boxes: FloatArray, count: int, rate: FloatArray, noise: float = 0.0
) -> CameraSteps:
    """The steps into the frames 0 to ``count - 1``; into the first there is none.

    Args:
        frames: ``(N,)`` in [0, count).
        boxes: ``(N, 4)`` pixels.
        count: T.
        rate: ``(count,)`` one over the seconds since the frame before each.
        noise: standard deviation of the centre of a box, heights, as far as it exceeds what `TOLERANCE` covers.
    """
    steps = CameraSteps(np.tile(np.eye(3)[:2], (count, 1, 1)), np.zeros(count), np.zeros(count))
    centre, size = centres(boxes), sizes(boxes)
    reach = np.repeat(REACH * size.max(axis=1)[:, None], 2, axis=1)
    i, j = near_pairs(frames, centre, reach, 1)
    change = np.log(size[j] / size[i])
    similar = np.abs(change[:, 1]) < 0.5
    i, j, change = i[similar], j[similar], change[similar]
    if len(i) == 0:
        return steps
    time, height = frames[j], (size[i].max(axis=1) + size[j].max(axis=1)) / 2
    weight = np.exp(-((change[:, 1] / 0.1) ** 2) - (change[:, 0] / 0.2) ** 2)
    move = centre[j] - centre[i]

    def total(values: FloatArray) -> FloatArray:
        return np.bincount(time, values, count).astype(np.float64)

    present = np.maximum(total(weight), 1e-12)
    middle = np.stack([total(weight * centre[i, k]) for k in (0, 1)], axis=1) / present[:, None]
    place = centre[i] - middle[time]
    ridge = RIDGE * total(weight * np.square(place).sum(axis=1)) / present
    # Centres of two boxes of one person differ by the noise of both.
    off_by = math.sqrt(2) * noise
    kernel, tolerance = (MODE / rate[time] + off_by) * height, (TOLERANCE / rate[time] + off_by) * height
    scale, turn, shift = np.zeros(count), np.zeros(count), _common_shift(time, move, kernel, weight, count)
    for _ in range(ROUNDS):
        off = move - _moves(place, time, scale, turn, shift)
        squared = np.square(off).sum(axis=1)
        agree = weight / (1 + squared / np.square(tolerance)) ** 2
        share = agree / np.square(height)
        mass = total(share) + 1e-12
        mean_place = np.stack([total(share * place[:, k]) for k in (0, 1)], axis=1) / mass[:, None]
        mean_move = np.stack([total(share * move[:, k]) for k in (0, 1)], axis=1) / mass[:, None]
        p, m = place - mean_place[time], move - mean_move[time]
        spread = total(share * np.square(p).sum(axis=1)) + ridge * mass + 1e-9
        scale = total(share * (p * m).sum(axis=1)) / spread
        turn = total(share * (p[:, 0] * m[:, 1] - p[:, 1] * m[:, 0])) / spread
        # What is subtracted is the move of the mean place under scale and turn.
        shift = mean_move - _moves(mean_place, np.arange(count), scale, turn, np.zeros((count, 2)))
    has = total(np.ones(len(time))) > 0
    matrix = np.stack([np.stack([1 + scale, -turn], 1), np.stack([turn, 1 + scale], 1)], 1)
    steps.similarity[has, :, :2] = matrix[has]
    steps.similarity[has, :, 2] = (middle + shift - np.einsum("tij,tj->ti", matrix, middle))[has]
    steps.support[:] = total(agree)
    mean_height = total(weight * height) / present
    steps.shift[has] = (np.hypot(*shift.T) / np.maximum(mean_height, 1e-12))[has]
    return steps


def _moves(place: FloatArray, time: IntArray, scale: FloatArray, turn: FloatArray, shift: FloatArray) -> FloatArray:
    """``(P, 2)`` how far similarities move places, given relative to the middle of the boxes."""
    s, r = scale[time], turn[time]
    return np.asarray(
        np.stack([s * place[:, 0] - r * place[:, 1], r * place[:, 0] + s * place[:, 1]], axis=1) + shift[time]
    )


def _common_shift(time: IntArray, move: FloatArray, kernel: FloatArray, weight: FloatArray, count: int) -> FloatArray:
    """``(T, 2)`` of the moves of each frame the one that most others are near to, by their weights."""
    order = np.argsort(time, kind="stable")
    bounds = np.searchsorted(time[order], np.arange(count + 1))
    shift = np.zeros((count, 2))
    for frame in np.flatnonzero(np.diff(bounds)).tolist():
        # With very many boxes a sample is enough.
        rows = order[bounds[frame] : bounds[frame + 1]]
        rows = rows[:: max(1, len(rows) // 500)]
        x, y = move[rows].T
        width = np.square(kernel[rows])
        votes = np.exp(-(np.square(x[:, None] - x) + np.square(y[:, None] - y)) / width) @ weight[rows]
        shift[frame] = move[rows[np.argmax(votes)]]
    return shift
