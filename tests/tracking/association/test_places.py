"""Entry and exit costs by place: what tracks found so far say of where the next begin and end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association import places
from tsuiseki.tracking.association.learnt_costs import CostNetwork
from tsuiseki.tracking.association.places import NO_COUNTS, EntryCounts, place_costs, starts_and_ends
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.types import FloatArray

SIZE = (1000, 500)
# A door in the middle of the picture.
DOOR = 600.0


def boxes_at(x: FloatArray) -> FloatArray:
    """Boxes 100 pixels high in the middle of the picture."""
    return np.column_stack([x - 20, np.full(len(x), 200.0), x + 20, np.full(len(x), 300.0)])


def through_the_door(people: int = 20) -> EntryCounts:
    """Everybody comes out of the door and leaves at the left border."""
    x = np.tile(np.linspace(DOOR, 30.0, 40), people)
    first = np.tile(np.arange(40) == 0, people)
    last = np.tile(np.arange(40) == 39, people)
    return EntryCounts(boxes_at(x), first, last)


def test_starts_are_cheap_where_tracks_began_and_dear_elsewhere() -> None:
    asked = boxes_at(np.array([DOOR, 300.0, 30.0]))
    entry, exit = place_costs(through_the_door(), asked, SIZE)
    assert entry[0] < 0 < min(entry[1], entry[2])
    assert exit[2] < 0 < min(exit[0], exit[1])
    assert max(abs(entry).max(), abs(exit).max()) <= places.MOST_BY_PLACE


def test_costs_are_the_logarithm_of_the_share_that_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a kernel of less than a cell the share of one cell can be counted by hand."""
    x = np.repeat([105.0, 505.0], 50)
    starts = np.zeros(100, dtype=np.bool_)
    starts[[0, 1, 2, 60]] = True
    for name, value in (("WIDTH", 0.001), ("PRIOR", 10.0), ("MOST_BY_PLACE", 9.0)):
        monkeypatch.setattr(places, name, value)
    counts = EntryCounts(boxes_at(x), starts, starts)
    entry, _ = place_costs(counts, boxes_at(np.array([105.0, 505.0, 905.0])), SIZE)
    mean = 4 / 100
    expected = [-np.log((n / mean + 10) / (around + 10)) for n, around in ((3, 50), (1, 50), (0, 0))]
    np.testing.assert_allclose(entry, expected, atol=1e-9)


def test_nothing_is_said_of_nothing() -> None:
    for counts, asked in ((NO_COUNTS, boxes_at(np.array([5.0]))), (through_the_door(), np.empty((0, 4)))):
        entry, exit = place_costs(counts, asked, SIZE)
        assert entry.tolist() == exit.tolist() == [0.0] * len(asked)


def test_starts_and_ends_of_short_tracks_and_at_the_ends_of_the_video_tell_nothing() -> None:
    frames = np.array([0, 1, 1, 2, 2, 3, 3, 4, 5, 6, 7, 8, 9])
    labels = np.array([0, 0, 1, 0, 1, 0, 1, 1, 2, 2, -1, 3, 3])
    starts, ends = starts_and_ends(labels, frames, (1, 8), 2)
    assert np.flatnonzero(starts).tolist() == [2, 8, 11]
    assert np.flatnonzero(ends).tolist() == [5, 7, 9]
    starts, ends = starts_and_ends(labels, frames, (1, 8), 3)
    assert np.flatnonzero(starts).tolist() == [2]
    assert np.flatnonzero(ends).tolist() == [5, 7]


def tracker(by_place: bool) -> FlowTracker:
    settings = FlowSettings()
    return FlowTracker(replace(settings, costs=replace(settings.costs, places=by_place)), frame_rate=10.0, size=SIZE)


def test_people_who_stay_apart_have_the_same_tracks_by_place_and_without() -> None:
    rng = np.random.default_rng(4)
    video = []
    for t in range(80):
        x = np.array([20 + 8 * t, 980 - 9 * t, 300 + 3 * t], dtype=np.float64)
        boxes = boxes_at(x) + rng.normal(0, 1, (3, 4))
        video.append(np.column_stack([boxes, rng.uniform(0.5, 1, 3)])[rng.random(3) > 0.1])
    found = []
    for by_place in (False, True):
        one = tracker(by_place)
        for boxes in video:
            one.update(boxes)
        found.append(one.tracks())
    assert [len(tracks) for tracks in found] == [3, 3]
    for plain, same in zip(found[0], found[1], strict=True):
        np.testing.assert_array_equal(plain.boxes, same.boxes)


class NoChanges(CostNetwork):
    """Learnt costs that change nothing."""

    def __init__(self) -> None:
        pass

    def links(self, rows: FloatArray) -> FloatArray:
        return np.zeros(len(rows))

    def detections(self, rows: FloatArray) -> FloatArray:
        return np.zeros((len(rows), 3))

    def joins(self, rows: FloatArray) -> FloatArray:
        return np.zeros(len(rows))


def test_a_delay_and_costs_learnt_on_tracks_take_all_places_alike() -> None:
    assert FlowTracker(frame_rate=10.0).facts()["entry_and_exit_by_place"]
    delayed = FlowTracker(frame_rate=10.0, delay=1.0)
    learnt = FlowTracker(frame_rate=10.0, changes=NoChanges())
    for one in (delayed, learnt):
        assert not one.facts()["entry_and_exit_by_place"]
        assert not one.settings.costs.places
