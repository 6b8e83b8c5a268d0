"""Prices of links: what an unknown velocity and a sudden change of motion cost."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.chain_motion import beliefs_alone, beliefs_along
from tsuiseki.tracking.association.detection_tables import Measurements
from tsuiseki.tracking.association.link_cost import TURN, LinkCost
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import FloatArray

RATE = 10.0


def one_chain(x: FloatArray, height: float = 100.0) -> Measurements:
    """Boxes of one target, a frame each, at ``(T,)`` centres; half as wide as high."""
    places = np.column_stack([x, np.zeros(len(x)), np.full((len(x), 2), np.log([height / 2, height]))])
    return Measurements(np.arange(len(x)) / RATE, places, np.ones(len(x)), np.zeros(len(x)))


def pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(count - 1), np.arange(1, count)


@pytest.mark.parametrize("speed", [0.5, 2.0, 6.0])
def test_a_known_velocity_takes_off_the_room_of_one_frame(speed: float) -> None:
    seen = one_chain(np.zeros(2))
    costs = [LinkCost(velocity_confidence=share).at_speed(speed) for share in (0.0, 1.0)]
    i, j = pairs(2)
    open_, known = (float(c.mismatch_alone(seen, 0.1)(i, j, np.full(1, 0.1), np.zeros(1))[0]) for c in costs)
    assert open_ > 0
    # Where the two do not differ, nothing but the room is paid.
    assert known == pytest.approx(0, abs=1e-12)


def test_no_link_along_tracks_is_dearer_than_a_sudden_change() -> None:
    cost = LinkCost()
    # It stands for two seconds and then moves at two heights a second.
    seen = one_chain(np.concatenate([np.zeros(20), 20.0 * np.arange(1, 20)]))
    known = beliefs_along(np.zeros(39, np.int64), seen, cost.motion)
    i, j = pairs(39)
    gap = (np.full(38, 1 / RATE), np.zeros(38))
    along = cost.mismatch(*known)(i, j, *gap)
    alone = cost.mismatch_alone(seen, 1 / RATE)(i, j, *gap)
    bounded = cost.mismatch_along(seen, *known, 1 / RATE)(i, j, *gap)
    np.testing.assert_allclose(bounded, np.minimum(along, alone + TURN))
    assert (bounded < along).any()
    assert (bounded == along).any()


def test_strangers_pay_no_turn() -> None:
    cost, seen = LinkCost(velocity_confidence=0), one_chain(np.array([0.0, 3.0]))
    alone, (i, j) = beliefs_alone(seen, cost.motion), pairs(2)
    gap = (np.full(1, 1 / RATE), np.zeros(1))
    np.testing.assert_allclose(
        cost.mismatch_along(seen, alone, alone, 1 / RATE)(i, j, *gap), cost.mismatch(alone, alone)(i, j, *gap)
    )


@pytest.mark.parametrize("speed", [1.0, 3.0, 5.0])
def test_fast_targets_at_few_frames_are_tracked(speed: float) -> None:
    """Cars that pass at several of their lengths a second, ten frames a second, scores that say little."""
    rng, tracker = np.random.default_rng(3), FlowTracker(frame_rate=RATE)
    for t in range(60):
        x = np.arange(4) * 1500 + speed * 60 / RATE * t
        boxes = np.column_stack([x, 100.0 * np.arange(4), x + 60, 100.0 * np.arange(4) + 40])
        tracker.update(np.column_stack([boxes + rng.normal(0, 1, boxes.shape), rng.uniform(0.4, 0.9, 4)]))
    assert [len(track) for track in tracker.tracks()] == [60] * 4


# Of 2.5 frames a second a delay of 1 s holds no three of anybody.
@pytest.mark.parametrize(
    ("rate", "every", "delay"),
    [
        (10.0, 2, None),
        (10.0, 3, None),
        (10.0, 4, None),
        (30.0, 2, None),
        (30.0, 4, None),
        (10.0, 3, 1.0),
        (30.0, 4, 1.0),
    ],
)
def test_a_detector_that_runs_on_every_nth_frame_is_believed(rate: float, every: int, delay: float | None) -> None:
    """Two people who cross, boxed without error."""
    tracker = FlowTracker(frame_rate=rate, delay=delay)
    for t in range(60):
        boxes = [[100 + 4 * t, 100, 140 + 4 * t, 200, 0.9], [400 - 4 * t, 110, 440 - 4 * t, 210, 0.9]]
        tracker.update(boxes if t % every == 0 else np.empty((0, 5)))
    tracks = tracker.tracks()
    assert len(tracks) == 2
    for track in tracks:
        assert track.observed.sum() >= 60 // every - 1
        # Nobody turns where they meet.
        assert abs(np.sign(np.diff(track.boxes[:, 0])).sum()) == len(track) - 1


@pytest.mark.parametrize(("every", "speed", "frames"), [(3, 20, 20), (3, 20, 30), (3, 30, 60), (2, 30, 30)])
def test_fast_people_at_few_frames_a_second_are_tracked(every: int, speed: int, frames: int) -> None:
    """Every second or third frame of ten a second, as a video of its own: two people who cross fast."""
    tracker = FlowTracker(frame_rate=RATE / every)
    times = range(0, frames, every)
    for t in times:
        x = speed * (t - frames / 2)
        tracker.update([[300 + x, 100, 340 + x, 200, 0.9], [300 - x, 110, 340 - x, 210, 0.9]])
    assert [len(track) for track in tracker.tracks()] == [len(times)] * 2
