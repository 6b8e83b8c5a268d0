"""What lies on the boxes of surer tracks is no further person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsuiseki.tracking.association.tracklets import explained_boxes, straddling_tracks
from tsuiseki.tracking.geometry import intersections, shared_with_all
from tsuiseki.tracking.types import Track

FRAMES = np.arange(20)


def walking(number: int, left: float, frames: np.ndarray = FRAMES, score: float = 0.9) -> Track:
    """A person 20 wide who walks to the right."""
    boxes = np.stack([[left + f, 10.0, left + f + 20, 60.0] for f in frames])
    return Track(number, frames, boxes, np.full(len(frames), score))


def test_the_share_on_others_is_that_of_the_pixels() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(0, 50, (30, 2))
    boxes = np.concatenate([corners, corners + rng.uniform(5, 40, (30, 2))], axis=1)
    others = boxes[:3] + 7
    x, y = np.meshgrid(np.arange(0, 120, 0.25), np.arange(0, 120, 0.25))
    painted = np.zeros(x.shape, dtype=bool)
    for x1, y1, x2, y2 in others:
        painted |= (x >= x1) & (x < x2) & (y >= y1) & (y < y2)
    for box, share in zip(boxes, shared_with_all(boxes, others), strict=True):
        inside = (x >= box[0]) & (x < box[2]) & (y >= box[1]) & (y < box[3])
        # The grid has 10 x 20 points, and a border may pass half of a row or column of them by, on each side.
        assert abs(share - painted[inside].mean()) < 0.15


def test_the_share_on_one_other_is_the_intersection() -> None:
    box, other = np.array([[0.0, 0.0, 10.0, 20.0]]), np.array([[5.0, 0.0, 30.0, 15.0]])
    np.testing.assert_allclose(shared_with_all(box, other), intersections(box, other) / 200)
    assert shared_with_all(box, np.empty((0, 4))).tolist() == [0.0]


def test_a_box_between_two_people_is_explained_and_theirs_are_not() -> None:
    pair = [walking(1, 0.0), walking(2, 18.0)]
    between = walking(3, 9.0, FRAMES[::2], 0.7)
    explained = explained_boxes([*pair, between], [True, True, True])
    assert [e.all() for e in explained] == [False, False, True]
    assert not explained[0].any()
    assert not explained[1].any()


def test_only_surer_people_explain() -> None:
    """A poster explains nobody, and a brief track does not explain a long one."""
    pair, between = [walking(1, 0.0), walking(2, 18.0)], walking(3, 9.0)
    assert not explained_boxes([*pair, replace(between, scores=0.5 * between.scores)], [False, True, True])[2].any()
    brief = [Track(t.id, t.frames[:5], t.boxes[:5], t.scores[:5], t.observed[:5]) for t in pair]
    assert not explained_boxes([*brief, between], [True, True, True])[2].any()


def test_who_walks_apart_is_not_explained() -> None:
    explained = explained_boxes([walking(1, 0.0), walking(2, 60.0, score=0.5)], [True, True])
    assert not np.concatenate(explained).any()


def test_a_track_straddles_where_most_of_its_detections_do() -> None:
    """What was filled in behind others says nothing: a hidden person is a person."""
    pair, between = [walking(1, 0.0), walking(2, 18.0)], walking(3, 9.0, score=0.7)
    assert straddling_tracks([*pair, between]).tolist() == [False, False, True]
    apart = np.where((FRAMES < 8)[:, None], [[100.0, 0, 100, 0]], 0.0)
    passes = replace(between, boxes=between.boxes + apart, observed=FRAMES < 10)
    assert straddling_tracks([*pair, passes]).tolist() == [False] * 3
    assert straddling_tracks([*pair, replace(passes, observed=FRAMES >= 0)]).tolist() == [False, False, True]
    assert straddling_tracks([]).tolist() == []


def test_who_is_dropped_explains_nobody() -> None:
    pair, between = [walking(1, 0.0), walking(2, 24.0, score=0.85)], walking(3, 10.0, score=0.6)
    narrow = walking(4, 17.0, score=0.4)
    narrow = replace(narrow, boxes=narrow.boxes - [0, 0, 10, 0])
    # Six tenths of it lie on the pair, and all of it on the one between them.
    assert straddling_tracks([*pair, between, narrow]).tolist() == [False, False, True, False]
