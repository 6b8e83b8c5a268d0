"""Pieces of tracks: their bookkeeping, the motion at their ends, and how they are joined."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.pieces import Links, Pieces
from tsuiseki.tracking.association.tracklets import JoinSettings, Tracklets, join, make_tracklets
from tsuiseki.tracking.filters.kalman import BoxMotion, predict_boxes, start_boxes, update_boxes

MOTION = BoxMotion()


def _links(numbers: list[int], follower: list[int], features: np.ndarray | None = None) -> Links:
    return Links(np.array(numbers), np.array(follower), np.full(len(numbers), -1.0), features)


def test_links_in_parts_are_the_links_at_once() -> None:
    looks = np.eye(8)[[0, 1, 0, 2, 1, 3, 0, 4]]
    numbers, follower = [0, 1, 2, 4, 5, 6, 7], [2, 4, 6, 7, -1, -1, -1]
    whole, parts = Pieces(), Pieces()
    whole.add(_links(numbers, follower, looks[numbers]))
    for part in ([0, 1], [2], [4, 5, 6], [7]):
        parts.add(_links(part, [follower[numbers.index(n)] for n in part], looks[part]))
    assert whole.labels(8).tolist() == [0, 1, 0, -1, 1, 2, 0, 1]
    assert parts.labels(8).tolist() == whole.labels(8).tolist()
    np.testing.assert_array_equal(parts.costs, whole.costs)
    a, b = parts.looks(), whole.looks()
    assert a is not None
    assert b is not None
    np.testing.assert_allclose(a, b)
    np.testing.assert_allclose(b[1], (looks[1] + looks[4] + looks[7]) / np.sqrt(5))


def test_a_copy_grows_by_itself() -> None:
    pieces = Pieces()
    pieces.add(_links([0], [1], np.eye(2)[[0]]))
    copied = pieces.copy()
    copied.add(_links([1], [-1], np.eye(2)[[1]]))
    looks = pieces.looks()
    assert looks is not None
    np.testing.assert_array_equal(looks, [[1, 0]])
    np.testing.assert_array_equal(pieces.costs, [-1, 0])


def test_unknown_looks_stay_unknown() -> None:
    pieces = Pieces()
    pieces.add(_links([0, 1, 2], [-1, 2, -1], np.array([[np.nan, np.nan], [np.nan, np.nan], [0, 1]])))
    looks = pieces.looks()
    assert looks is not None
    np.testing.assert_array_equal(looks, [[np.nan, np.nan], [0, 1]])
    nothing = Pieces()
    nothing.add(_links([0], [-1]))
    assert nothing.looks() is None


def _boxes(frames: np.ndarray, start: tuple[float, float], step: tuple[float, float]) -> np.ndarray:
    corner = np.array(start) + (frames - frames[0])[:, None] * np.array(step)
    return np.hstack([corner, corner + np.array([20, 50])])


def _tracklets(*parts: tuple[np.ndarray, np.ndarray], looks: np.ndarray | None = None) -> Tracklets:
    frames = np.concatenate([frames for frames, _ in parts])
    labels = np.repeat(np.arange(len(parts)), [len(frames) for frames, _ in parts])
    return make_tracklets(
        frames, np.vstack([boxes for _, boxes in parts]), np.full(len(frames), -2.0), labels, looks, MOTION
    )


def test_motion_at_the_ends_is_that_of_the_filter() -> None:
    frames = np.array([3, 4, 6, 7])
    boxes = _boxes(frames, (0, 0), (4, 1)) + np.random.default_rng(0).normal(size=(4, 4))
    pieces = _tracklets((frames, boxes))
    belief = start_boxes(boxes[:1], MOTION)
    for row in (1, None, 2, 3):
        belief = predict_boxes(belief, MOTION)
        belief = belief if row is None else update_boxes(belief, boxes[row : row + 1], MOTION)
    np.testing.assert_allclose(pieces.end.boxes, belief.boxes)
    np.testing.assert_allclose(pieces.end.velocities, belief.velocities)
    np.testing.assert_allclose(pieces.end.variance, belief.variance)
    backwards = _tracklets((10 - frames[::-1], boxes[::-1]))
    np.testing.assert_allclose(pieces.start.boxes, backwards.end.boxes)
    np.testing.assert_allclose(pieces.start.velocities, -backwards.end.velocities)
    assert (pieces.first.tolist(), pieces.last.tolist(), pieces.cost.tolist()) == ([3], [7], [-8])


def test_straight_motion_joins_across_a_gap_and_keeps_crossing_people_apart() -> None:
    """Two people cross while neither is seen; each goes on as he went."""
    first, second = np.arange(12), np.arange(20, 32)
    right = _boxes(first, (0, 0), (5, 0)), _boxes(second, (100, 0), (5, 0))
    left = _boxes(first, (155, 0), (-5, 0)), _boxes(second, (55, 0), (-5, 0))
    pieces = _tracklets((first, right[0]), (first, left[0]), (second, right[1]), (second, left[1]))
    assert join(pieces, JoinSettings()).tolist() == [0, 1, 0, 1]


def test_looks_decide_where_motion_does_not() -> None:
    """Two people stop at one place and go on from there: only their looks tell who is who."""
    first, second = np.arange(12), np.arange(20, 32)
    here = _boxes(first, (0, 0), (0, 0)), _boxes(second, (0, 0), (0, 0))
    beside = _boxes(first, (12, 0), (0, 0)), _boxes(second, (12, 0), (0, 0))
    looks = np.eye(2)[[0, 1, 1, 0]]
    pieces = _tracklets((first, here[0]), (first, beside[0]), (second, here[1]), (second, beside[1]), looks=looks)
    number = join(pieces, JoinSettings())
    assert number[0] == number[3] != number[1] == number[2]


def test_pieces_too_weak_for_a_track_are_none_alone_and_part_of_one_together() -> None:
    first, second = np.arange(3), np.arange(5, 8)
    settings = JoinSettings(entry=5, exit=5)
    one, two = _boxes(first, (0, 0), (4, 0)), _boxes(second, (20, 0), (4, 0))
    assert join(_tracklets((first, one)), settings).tolist() == [-1]
    assert join(_tracklets((first, one), (second, two)), settings).tolist() == [0, 0]


def test_no_piece_at_all() -> None:
    none = make_tracklets(np.empty(0, int), np.empty((0, 4)), np.empty(0), np.empty(0, int), None, MOTION)
    assert len(join(none, JoinSettings())) == 0
