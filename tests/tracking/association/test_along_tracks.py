"""What is known along tracks, found again only where they changed, and the prices of links that follow from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.chain_motion import (
    RUN_UP,
    MotionNoise,
    TrackMotion,
    any_within,
    beliefs_alone,
    beliefs_along,
    followed,
)
from tsuiseki.tracking.association.detection_tables import DetectionTable, Measurements, rows_of_numbers
from tsuiseki.tracking.association.flow_rounds import candidates
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.types import IntArray

MOTION = MotionNoise()


def walkers(rng: np.random.Generator, people: int, frames: int) -> tuple[DetectionTable, IntArray]:
    """Detections of people who walk at random, one in five missed, numbers with gaps; and who each is."""
    place = rng.uniform(0, 500, (people, 2)) + np.cumsum(rng.normal(0, 3, (frames, people, 2)), axis=0)
    frame, who = np.nonzero(rng.random((frames, people)) > 0.2)
    centre, count = place[frame, who], len(frame)
    size = np.log([30.0, 80.0]) + rng.normal(0, 0.05, (count, 2))
    noise, wander = 1 + rng.random(count), frame * 1e-5
    half = np.exp(size) / 2
    boxes = np.concatenate([centre - half, centre + half], axis=1)
    measured = Measurements(frame / 25.0, np.concatenate([centre, size], axis=1), noise, wander)
    numbers = np.cumsum(rng.integers(1, 3, count))
    return DetectionTable(numbers, frame, boxes, boxes, measured, None, 25.0, None), who


def linked(seen: DetectionTable, labels: IntArray) -> IntArray:
    """``(N,)`` the number of what follows each on its track."""
    follower = np.full(len(seen), -1)
    for track in range(int(labels.max()) + 1):
        rows = np.flatnonzero(labels == track)
        follower[rows[:-1]] = seen.numbers[rows[1:]]
    return follower


@pytest.mark.parametrize("seed", range(3))
def test_links_reach_as_far_as_the_time_between_looks_lets_people_go(seed: int) -> None:
    rng, cost = np.random.default_rng(seed), LinkCost()
    seen, _ = walkers(rng, 6, 40)
    times = np.cumsum(rng.choice([0.04, 0.1, 0.5], 40))[seen.frames]
    measured = replace(seen.measured, times=times, wander=np.zeros(len(seen)))
    uneven = replace(seen, measured=measured, even=False)
    every = np.arange(len(seen))
    found = set(zip(*(part.tolist() for part in candidates(uneven, every, every, 1, 3, cost)), strict=True))
    i, j = (part.ravel() for part in np.meshgrid(every, every, indexing="ij"))
    gap, size = seen.frames[j] - seen.frames[i], seen.boxes[:, 2:] - seen.boxes[:, :2]
    limits = cost.limits(size.max(axis=1)[i], times[j] - times[i])
    near = (np.abs(measured.places[j, :2] - measured.places[i, :2]) <= limits).all(axis=1)
    near &= (gap >= 1) & (gap <= 3) & (np.abs(measured.places[j, 3] - measured.places[i, 3]) < cost.size)
    assert found == set(zip(i[near].tolist(), j[near].tolist(), strict=True))


@pytest.mark.parametrize("seed", range(5))
def test_what_is_found_again_is_what_all_tracks_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    seen, labels = walkers(rng, 6, 200)
    known, first = followed(TrackMotion.alone(seen, MOTION), seen, labels, linked(seen, labels), MOTION, RUN_UP)
    labels = labels.copy()
    labels[rng.choice(len(labels), 2)] = rng.integers(-1, 6, 2)
    follower = linked(seen, labels)
    known, second = followed(known, seen, labels, follower, MOTION, RUN_UP)
    assert first[0].sum() > 3 * second[0].sum() > 0
    past, future = beliefs_along(labels, seen.measured, MOTION)
    for ours, whole in ((known.past, past), (known.future, future)):
        # What RUN_UP detections leave of a jump by hundreds of pixels: a fiftieth of the deviation of 0.03 * 80 pixels.
        np.testing.assert_allclose(ours.place[:, :2], whole.place[:, :2], atol=0.05)
        np.testing.assert_allclose(ours.place[:, 2:], whole.place[:, 2:], atol=1e-3)
        np.testing.assert_allclose(ours.velocity[:, :2], whole.velocity[:, :2], atol=0.1)
        np.testing.assert_allclose(ours.covariance, whole.covariance, rtol=2e-2, atol=1e-6)
    np.testing.assert_array_equal(known.follower, follower)


def test_nothing_changes_where_tracks_stay() -> None:
    seen, labels = walkers(np.random.default_rng(7), 4, 60)
    follower = linked(seen, labels)
    known, _ = followed(TrackMotion.alone(seen, MOTION), seen, labels, follower, MOTION, RUN_UP)
    again, changed = followed(known, seen, labels, follower, MOTION, RUN_UP)
    assert not changed[0].any()
    assert not changed[1].any()
    np.testing.assert_array_equal(again.past.place, known.past.place)


def test_a_detection_alone_is_a_chain_of_one() -> None:
    seen, _ = walkers(np.random.default_rng(8), 5, 20)
    alone, (past, future) = (
        beliefs_alone(seen.measured, MOTION),
        beliefs_along(np.full(len(seen), -1), seen.measured, MOTION),
    )
    for one in (past, future):
        np.testing.assert_array_equal(alone.place, one.place)
        np.testing.assert_array_equal(alone.velocity, np.abs(one.velocity))
        np.testing.assert_allclose(alone.covariance, one.covariance, rtol=1e-12)


@pytest.mark.parametrize("wander", [0.0, 0.01, 4.0])
def test_the_price_of_two_alone_is_that_of_chains_of_one(wander: float) -> None:
    rng = np.random.default_rng(9)
    (seen, _), cost = walkers(rng, 5, 30), LinkCost(velocity_confidence=0)
    alone = beliefs_alone(seen.measured, MOTION)
    i, j = rng.integers(0, len(seen), (2, 500))
    i, j = np.minimum(i, j), np.maximum(i, j)
    seconds, doubt = (seen.frames[j] - seen.frames[i]) / 25.0, np.full(500, wander)
    np.testing.assert_allclose(
        cost.mismatch_alone(seen.measured, 1 / 25.0)(i, j, seconds, doubt),
        cost.mismatch(alone, alone)(i, j, seconds, doubt),
        rtol=1e-9,
        atol=1e-9,
    )


def test_flags_reach_no_other_track() -> None:
    bounds = np.array([0, 0, 0, 3, 3, 5, 5, 5]), np.array([2, 2, 2, 4, 4, 7, 7, 7])
    flags = np.array([0, 0, 1, 0, 0, 1, 0, 0], dtype=np.bool_)
    assert any_within(flags, bounds, 1, 0).astype(int).tolist() == [0, 0, 1, 0, 0, 1, 1, 0]
    assert any_within(flags, bounds, 0, 9).astype(int).tolist() == [1, 1, 1, 0, 0, 1, 0, 0]


def test_rows_of_numbers() -> None:
    known = np.array([3, 4, 9])
    assert rows_of_numbers(known, np.array([9, 3, -1, 5, 2, 10, 4])).tolist() == [2, 0, -1, -1, -1, -1, 1]
    assert rows_of_numbers(known[:0], np.array([1, -1])).tolist() == [-1, -1]
