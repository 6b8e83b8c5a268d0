"""Boxes near each other, and what hides a place, against all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.nearby import Occluders, Strips, near_pairs, ranges, sizes
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import FloatArray, IntArray


def crowd(rng: np.random.Generator, count: int, frames: IntArray) -> tuple[IntArray, FloatArray]:
    """Boxes of random size all over the place, some outside the image, in some of the frames."""
    frame = np.sort(rng.choice(frames, count))
    corner, size = rng.uniform(-50, 300, (count, 2)), rng.uniform(5, 120, (count, 2))
    return frame, np.concatenate([corner, corner + size], axis=1)


@pytest.mark.parametrize("gap", [0, 1, 3])
@pytest.mark.parametrize("frames", [np.arange(8), np.array([3, 4, 90, 91]), np.array([7])], ids=["all", "few", "one"])
def test_near_pairs_are_all_pairs_within_reach(gap: int, frames: IntArray) -> None:
    rng = np.random.default_rng(gap)
    frame, boxes = crowd(rng, 200, frames)
    centre, reach = centres(boxes), 0.6 * sizes(boxes)
    i, j = near_pairs(frame, centre, reach, gap)
    apart = np.abs(centre[None] - centre[:, None])
    near = (apart <= reach[:, None]).all(axis=2) & (frame[None] - frame[:, None] == gap)
    expected = {(int(a), int(b)) for a, b in zip(*np.nonzero(near), strict=True)}
    assert len(i) == len(expected)
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == expected


def test_nobody_is_near_where_there_is_nobody() -> None:
    i, j = near_pairs(np.empty(0, dtype=np.int64), np.empty((0, 2)), np.empty((0, 2)), 1)
    assert len(i) == len(j) == 0


def test_a_strip_holds_the_boxes_of_its_frame_between_two_places() -> None:
    x = np.linspace(0, 1000, 1500)
    strips = Strips.of(np.zeros(len(x), dtype=np.int64), x, np.arange(len(x)))
    when, low, high = np.array([0, 0, 5, -1]), np.array([200.0, -9, 0, 0]), np.array([210.0, -5, 9, 9])
    first, count = strips.between(strips.keys(when, low), strips.keys(when, high))
    within = strips.ordered[first[0] : first[0] + count[0]]
    assert within.tolist() == np.flatnonzero((x >= 200) & (x <= 210)).tolist()
    # No box lies in a frame that there is not.
    assert count[1:].tolist() == [0, 0, 0]


def test_ranges_follow_each_other() -> None:
    which, place = ranges(np.array([5, 0, 2]), np.array([2, 0, 3]))
    assert which.tolist() == [0, 0, 2, 2, 2]
    assert place.tolist() == [5, 6, 2, 3, 4]


@pytest.mark.parametrize("size", [None, (320, 240)])
def test_what_hides_a_place_is_all_nearer_boxes_and_the_border(size: tuple[int, int] | None) -> None:
    rng = np.random.default_rng(11)
    frame, boxes = crowd(rng, 150, np.arange(12))
    tails, heads = rng.integers(0, 150, (2, 400))
    later = frame[heads] > frame[tails]
    tails, heads = tails[later], heads[later]
    expected = []
    for i, j in zip(tails, heads, strict=True):
        middle = (frame[i] + frame[j]) // 2
        share = (middle - frame[i]) / (frame[j] - frame[i])
        x1, y1, x2, y2 = boxes[i] * (1 - share) + boxes[j] * share
        area = lost = (x2 - x1) * (y2 - y1)
        if size is None:
            lost = 0.0
        else:
            lost -= max(min(x2, size[0]) - max(x1, 0), 0) * max(min(y2, size[1]) - max(y1, 0), 0)
        for a1, b1, a2, b2 in boxes[(frame == middle) & (boxes[:, 3] > y2)]:
            lost += max(min(x2, a2) - max(x1, a1), 0) * max(min(y2, b2) - max(y1, b1), 0)
        expected.append(min(lost / area, 1) if frame[j] - frame[i] > 1 else 0)
    np.testing.assert_allclose(Occluders.of(frame, boxes, size).between(tails, heads), expected, atol=1e-12)
    assert 0 < np.mean(expected) < 1
