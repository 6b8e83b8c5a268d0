"""Tracks that are broken on purpose: which detections go, what belongs together, and that nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.flow.seen import Seen, no_detections
from tsuiseki.tracking.association.tracklets.chain_motion import Measurements
from tsuiseki.trainers.association.broken_tracks import Breaks, broken
from tsuiseki.trainers.association.data import RandomWindows
from tsuiseki.trainers.association.labelled_flow import next_of_owner
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.experiments.end_to_end import crossing

RATE = 10.0
OFTEN = Breaks(copies=1, every=2.0, shortest=0.5, longest=1.0)


def side_by_side(frames: int = 100, people: int = 3) -> tuple[Seen, np.ndarray]:
    """``people`` in rows, of whom the second stands partly behind the first in the second half."""
    when = np.repeat(np.arange(frames), people)
    who = np.tile(np.arange(people), frames)
    left = 100.0 * who - np.where((who == 1) & (when >= frames // 2), 80.0, 0.0)
    boxes = np.stack([left, 0 * left, left + 40, np.where(who == 0, 101.0, 100.0)], axis=1)
    size = np.full((len(when), 2), (40.0, 100.0))
    places = np.concatenate([(boxes[:, :2] + boxes[:, 2:]) / 2, np.log(size)], axis=1)
    measured = Measurements(when / RATE, places, np.ones(len(when)), np.zeros(len(when)))
    seen = replace(
        no_detections(RATE, (640, 480)),
        numbers=np.arange(len(when)),
        frames=when,
        image=boxes,
        boxes=boxes,
        measured=measured,
    )
    return seen, who


def test_pieces_are_what_the_gaps_leave() -> None:
    seen, labels = side_by_side()
    left, pieces = broken(seen, labels, np.array([7, 8, -1]), OFTEN, np.random.default_rng(0))
    assert (np.diff(left) > 0).all()
    assert sorted(np.unique(pieces)) == list(range(pieces.max() + 1))
    # Nobody's tracklet stays whole, and nobody loses their first or last detection.
    assert (labels[left] == 2).sum() == 100
    for label in range(3):
        mine = pieces[labels[left] == label]
        frames = seen.frames[left][labels[left] == label]
        assert (frames[0], frames[-1]) == (0, 99)
        apart = np.diff(frames)
        np.testing.assert_array_equal(np.diff(mine) != 0, apart > 1)
        assert (label == 2) == (len(np.unique(mine)) == 1)
        # Gaps of .5 to 1 s hold 5 to 10 detections; two may lie in one another.
        assert (apart[apart > 1] >= 5).all()


def test_detections_in_no_track_stay_in_none() -> None:
    seen, labels = side_by_side()
    left, pieces = broken(seen, np.where(labels == 2, -1, labels), np.array([7, 8]), OFTEN, np.random.default_rng(0))
    np.testing.assert_array_equal(pieces == -1, labels[left] == 2)


def test_gaps_lie_where_somebody_is_hidden() -> None:
    seen, labels = side_by_side()
    dropped = np.zeros(100)
    for seed in range(40):
        left, _ = broken(seen, labels, np.array([7, 8, 9]), OFTEN, np.random.default_rng(seed))
        mine = seen.frames[left][labels[left] == 1]
        dropped[np.setdiff1d(np.arange(100), mine)] += 1
    # Half of the second person is hidden from frame 50 on: chances .6 and .1.
    assert dropped[60:].mean() > 3 * dropped[:45].mean() > 0


def test_the_second_level_gets_joins_of_labelled_identity() -> None:
    breaks = Breaks(copies=3, every=0.8, shortest=0.2, longest=0.4)
    plain, levels = sequence_graphs(crossing(3)), sequence_graphs(crossing(3), breaks=breaks)
    assert plain.broken == ()
    np.testing.assert_array_equal(levels.tracklets.costs, plain.tracklets.costs)
    assert len(levels.broken) == 3
    joins = [int(one.labelled[3 * len(one) :].sum()) for one in levels.broken]
    assert sum(joins) > 3 * int(plain.tracklets.labelled[3 * len(plain.tracklets) :].sum())
    assert len({len(one) for one in levels.broken}) > 1
    for one in levels.broken:
        taken = one.labelled[3 * len(one) :] > 0
        assert (next_of_owner(one.frames, one.owners)[one.tail[taken]] == one.head[taken]).all()
    again = sequence_graphs(crossing(3), breaks=breaks)
    assert all(np.array_equal(a.links, b.links) for a, b in zip(levels.broken, again.broken, strict=True))


def test_windows_come_with_all_of_them() -> None:
    levels = sequence_graphs(crossing(3), breaks=Breaks(copies=3, every=0.8, shortest=0.2, longest=0.4))
    windows = RandomWindows([levels], 1.0, 40, lambda: (0, 0))
    seen = {id(windows[k].tracklets) for k in range(40)}
    assert seen == {id(one) for one in (levels.tracklets, *levels.broken)}


@pytest.mark.parametrize("wrong", [{"copies": -1}, {"every": 0.0}, {"shortest": 2.0, "longest": 1.0}])
def test_wrong_settings(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected copies from 0, every above 0 and gaps above 0"):
        Breaks(**wrong)  # type: ignore[arg-type]
