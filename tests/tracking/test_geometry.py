"""Boxes: conversions, overlap, suppression."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.geometry import (
    areas,
    clip_boxes,
    corners_from_xywh,
    iou_matrix,
    iou_pairs,
    rotated_iou,
    straddling,
    suppress,
    suppress_rotated,
    xywh_from_corners,
)
from tsuiseki.tracking.types import Detections, Estimate, Frame, Track


def random_boxes(rng, count):
    corner = rng.uniform(0, 50, (count, 2))
    return np.concatenate([corner, corner + rng.uniform(1, 30, (count, 2))], axis=1)


def test_conversions_are_inverse():
    boxes = random_boxes(np.random.default_rng(0), 20)
    np.testing.assert_allclose(corners_from_xywh(xywh_from_corners(boxes)), boxes)


def test_overlap_is_that_of_counted_cells():
    a, b = np.array([[0, 0, 4, 3.0]]), np.array([[2, 1, 6, 5.0]])
    grid = np.zeros((2, 8, 8), dtype=bool)
    grid[0, 0:3, 0:4] = grid[1, 1:5, 2:6] = True
    assert iou_matrix(a, b)[0, 0] == grid.all(axis=0).sum() / grid.any(axis=0).sum()
    assert iou_pairs(a, np.array([[4, 0, 5, 3.0]]))[0] == 0


def test_clipping_empties_what_lies_outside():
    clipped = clip_boxes(np.array([[-5, -5, 5, 5], [20, 0, 30, 5.0]]), 10, 10)
    assert areas(clipped).tolist() == [25, 0]


def greedy(boxes, scores, iou):
    kept = []
    for i in np.argsort(-scores, kind="stable"):
        if all(iou_pairs(boxes[i], boxes[j]) <= iou for j in kept):
            kept.append(int(i))
    return kept


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("iou", [0.0, 0.3, 0.7, 1.0])
def test_suppression_is_the_greedy_one(seed, iou):
    rng = np.random.default_rng(seed)
    boxes, scores = random_boxes(rng, 40), rng.normal(size=40)
    assert suppress(boxes, scores, iou).tolist() == greedy(boxes, scores, iou)


def test_suppressing_nothing_keeps_nothing():
    assert suppress(np.empty((0, 4)), np.empty(0), 0.5).tolist() == []


@pytest.mark.parametrize(
    "make",
    [
        lambda: Detections(np.array([[0, 0, 0, 5.0]]), np.ones(1)),
        lambda: Detections(np.array([[0, 0, np.nan, 5.0]]), np.ones(1)),
        lambda: Detections(np.array([[0, 0, 5, 5.0]]), np.ones(2)),
        lambda: Detections(np.array([[0, 0, 5, 5.0]]), np.array([np.inf])),
        lambda: Detections(np.array([[0, 0, 5, 5.0]]), np.ones(1), np.ones(3)),
        lambda: Track(0, np.array([1]), np.array([[0, 0, 5, 5.0]]), np.ones(1)),
        lambda: Track(1, np.array([1, 1]), np.array([[0, 0, 5, 5.0]] * 2), np.ones(2)),
        lambda: Track(1, np.array([1, 2]), np.array([[0, 0, 5, 5.0]]), np.ones(2)),
        lambda: Estimate(0, np.array([0, 0, 5, 5.0]), 0.5, "found"),
        lambda: Frame(0, 0.0, np.zeros((4, 4, 3))),
        lambda: Frame(0, 0.0, np.zeros((4, 4), dtype=np.uint8)),
    ],
)
def test_impossible_values_are_refused_where_they_are_made(make):
    with pytest.raises(ValueError, match="expected"):
        make()


def test_a_box_between_two_better_ones_straddles_them() -> None:
    boxes = np.array([[0.0, 0, 20, 60], [18, 0, 38, 60], [9, 2, 29, 58], [60, 0, 80, 60]])
    assert straddling(boxes, np.array([0.9, 0.8, 0.6, 0.5]), 0.85).tolist() == [False, False, True, False]
    # It stays where it is the best, or only one is better.
    assert not straddling(boxes, np.array([0.5, 0.4, 0.6, 0.5]), 0.85).any()
    assert not straddling(boxes[[0, 2]], np.array([0.9, 0.6]), 0.4).any()
    assert straddling(np.empty((0, 4)), np.empty(0), 0.85).tolist() == []


def test_of_turned_boxes_the_best_of_each_heap_stays():
    """OpenCV's function drops one of these that shares less than a fifth with any other."""
    random = np.random.default_rng(3)
    boxes = np.column_stack([
        random.uniform(0, 60, (40, 2)), random.uniform(5, 30, (40, 2)), random.uniform(-1.6, 1.6, 40)
    ])  # fmt: skip
    kept = suppress_rotated(boxes, scores := random.uniform(0.1, 1, 40), 0.3)
    assert (np.diff(scores[kept]) <= 0).all()
    overlap = rotated_iou(boxes, boxes)
    assert np.triu(overlap[np.ix_(kept, kept)], 1).max() <= 0.3
    for k in np.setdiff1d(np.arange(40), kept):
        assert (overlap[k, kept][scores[kept] > scores[k]] > 0.3).any()
    assert suppress_rotated(boxes[:0], scores[:0], 0.3).tolist() == []
