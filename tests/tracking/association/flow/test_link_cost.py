"""Prices of links: what an unknown velocity and a sudden change of motion cost."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.flow.link_cost import LinkCost
from tsuiseki.tracking.association.tracklets.chain_motion import Measurements, beliefs_alone, beliefs_along
from tsuiseki.tracking.trackers.people.flow import FlowTracker
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
    costs = [LinkCost(settled=share).at_speed(speed) for share in (0.0, 1.0)]
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
    along = cost.mismatch(*known, i, j, *gap)
    alone = cost.mismatch_alone(seen, 1 / RATE)(i, j, *gap)
    bounded = cost.mismatch_along(seen, *known, 1 / RATE)(i, j, *gap)
    np.testing.assert_allclose(bounded, np.minimum(along, alone + cost.turn))
    assert (bounded < along).any()
    assert (bounded == along).any()


def test_strangers_pay_no_turn() -> None:
    cost, seen = LinkCost(settled=0), one_chain(np.array([0.0, 3.0]))
    alone, (i, j) = beliefs_alone(seen, cost.motion), pairs(2)
    gap = (np.full(1, 1 / RATE), np.zeros(1))
    np.testing.assert_allclose(
        cost.mismatch_along(seen, alone, alone, 1 / RATE)(i, j, *gap), cost.mismatch(alone, alone, i, j, *gap)
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
