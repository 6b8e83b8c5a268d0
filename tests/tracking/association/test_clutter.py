"""What moves tells what scores are worth."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.clutter import above_floor, floor_of, score_floor, standing_clutter
from tsuiseki.tracking.types import Detections, FloatArray, Track

RATE = 10.0


def street(frames: int = 150, seed: int = 0) -> list[Detections]:
    """Five walkers who score 0.7, three standing false positives at 0.4, and 40 scattered boxes a frame below 0.3."""
    rng = np.random.default_rng(seed)
    start, pace = rng.uniform(0, 400, (5, 2)), rng.uniform(2, 4, 5)
    places = rng.uniform(0, 600, (3, 2))
    found = []
    for t in range(frames):
        walkers = start + np.stack([pace * t, np.zeros(5)], axis=1)
        scattered = rng.uniform(0, 1200, (40, 2))
        corner = np.concatenate([walkers, places, scattered]) + rng.normal(0, 0.3, (48, 2))
        boxes = np.concatenate([corner, corner + np.array([20, 50])], axis=1)
        scores = np.concatenate([rng.normal(0.7, 0.03, 5), rng.normal(0.4, 0.02, 3), rng.uniform(0.05, 0.3, 40)])
        found.append(Detections(boxes, scores))
    return found


@pytest.mark.parametrize("law", [lambda s: s, lambda s: np.log(s / (1 - s)), lambda s: 100 * s])
def test_the_floor_lies_between_what_moves_and_what_does_not(law) -> None:
    found = [Detections(each.boxes, law(each.scores)) for each in street()]
    floor = floor_of(found, RATE)
    assert floor is not None
    assert law(0.3) < floor < law(0.62)


def test_most_of_the_low_scores_are_left_out() -> None:
    kept, floor = above_floor(street(), RATE)
    assert floor is not None
    assert 5 <= np.mean([len(each) for each in kept]) <= 8


def test_detections_that_are_mostly_right_stay() -> None:
    found = [each.select(each.scores > 0.35) for each in street()]
    assert above_floor(found, RATE) == (found, None)


def test_parked_cars_stay_beside_a_few_that_drive() -> None:
    driving = [each.select(slice(0, 5)) for each in street()]
    places = np.random.default_rng(1).uniform(0, 1200, (25, 2))
    parked = Detections(np.concatenate([places, places + np.array([20, 50])], axis=1), np.full(25, 0.4))
    found = [Detections(np.concatenate([d.boxes, parked.boxes]), np.append(d.scores, parked.scores)) for d in driving]
    floor = floor_of(found, RATE)
    assert floor is not None
    assert floor > 0.4
    assert above_floor(found, RATE) == (found, None)


@pytest.mark.parametrize(
    "found",
    [
        [],
        [Detections.empty()] * 5,
        [each.select(slice(5, None)) for each in street()],
        [Detections(each.boxes, np.full(len(each), np.nan)) for each in street()],
    ],
    ids=["no frame", "no detection", "nothing moves", "no scores"],
)
def test_nothing_is_cut_where_nothing_tells(found: list[Detections]) -> None:
    assert floor_of(found, RATE) is None


def test_equal_scores_are_all_kept() -> None:
    found = [Detections(each.boxes[:5], np.ones(5)) for each in street()]
    rows = np.repeat(np.arange(len(found)), 5)
    floor = score_floor(rows, np.concatenate([each.boxes for each in found]), np.ones(len(rows)), RATE)
    assert floor is None or floor <= 1


def track(number: int, boxes: FloatArray, score: float) -> Track:
    return Track(number, np.arange(len(boxes)), boxes, np.full(len(boxes), score))


def test_a_standing_track_that_scores_like_nobody_who_walks_is_clutter() -> None:
    still = np.tile([100.0, 100, 120, 150], (60, 1))
    walk = still + np.arange(60)[:, None] * [3.0, 0, 3, 0]
    tracks = [track(n, walk, 0.7 + n / 100) for n in range(1, 5)] + [track(5, still, 0.5), track(6, still, 0.9)]
    boxes = [each.boxes for each in tracks]
    assert standing_clutter(tracks, boxes, RATE).tolist() == [4]
    assert standing_clutter(tracks[1:], boxes[1:], RATE).tolist() == []
    assert standing_clutter([], [], RATE).tolist() == []
