"""What is typed at a prompt answers in one line, and tables show themselves in notebooks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import tsuiseki
from tsuiseki.tracking.counts.scene import SceneLine
from tsuiseki.tracking.types.tracks import exact_track

LENGTH = 400
BOXES = np.arange(LENGTH)[:, None] + np.array([0.0, 0, 20, 50])
TRACK = tsuiseki.Track(7, np.arange(LENGTH), BOXES, np.ones(LENGTH), names={0: "a class with quite a long name"})
CROWD = tsuiseki.as_detections(np.column_stack([BOXES, np.full(LENGTH, 0.9)]))
SCENE = tsuiseki.Scene((SceneLine("door", np.array([[0.0, 90], [640, 90]])),))


def speakers() -> Iterator[object]:
    """Objects that a user meets, each large."""
    sort = tsuiseki.Sort(min_hits=1)
    targets = sort.update(CROWD)
    answers = tsuiseki.count([TRACK], SCENE, frame_rate=10.0)
    yield from (TRACK, CROWD, targets, next(iter(targets)), sort, answers, tsuiseki.Result([TRACK], "street.mp4"))
    yield from (tsuiseki.FlowTracker(), tsuiseki.PointTracker(tsuiseki.PointSettings(), (64, 48)))
    yield tsuiseki.Frame(3, 0.1, np.zeros((480, 640, 3), np.uint8))
    yield tsuiseki.Estimate(3, BOXES[3], 0.5, "searching")
    yield tsuiseki.Scan(1.5, BOXES[:, :2])
    yield tsuiseki.ActingTrack(TRACK, np.ones((LENGTH, 9)), np.ones((LENGTH, 9)))
    yield exact_track(2, np.arange(LENGTH), np.ones((LENGTH, 5)))
    yield tsuiseki.Position(1.5, np.zeros(3), np.eye(3), 0.5, "tracking")


@pytest.mark.parametrize("speaker", [*speakers()], ids=lambda speaker: type(speaker).__name__)
def test_a_repr_is_one_short_line(speaker: object) -> None:
    assert "\n" not in repr(speaker)
    assert len(repr(speaker)) <= 120
    assert type(speaker).__name__ in repr(speaker)


def test_a_repr_says_how_much_there_is() -> None:
    assert repr(TRACK) == "<Track 7: 400 boxes, frames 0 to 399>"
    assert repr(CROWD) == "<Detections: 400>"
    assert repr(tsuiseki.Targets.empty(5)) == "<Targets: 0 in frame 5>"
    assert repr(tsuiseki.count([TRACK], SCENE, frame_rate=10.0)) == "<Answers: 400 frames, people 1, lines 1, zones 0>"


def test_answers_are_tables_in_a_notebook() -> None:
    shown = tsuiseki.count([TRACK], SCENE, frame_rate=10.0)._repr_html_()
    assert shown.count("<table>") == 1
    assert "<td>door</td><td>in</td>" in shown


def test_a_result_counts_nothing_by_itself() -> None:
    """A sequence's `count` would be that of equal tracks; counting is `tsuiseki.count`."""
    result = tsuiseki.Result([TRACK])
    assert not hasattr(result, "count")
    assert not hasattr(result, "index")
    assert TRACK in result
    assert [*reversed(result)] == [TRACK]
