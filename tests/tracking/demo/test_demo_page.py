"""What the demo says where the method that is drawn is not the best."""

from dataclasses import replace

import numpy as np

from tsuiseki.tracking.demo.page import why_not_best
from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_sequences
from tsuiseki.tracking.report.page import Report
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth

FRAMES = np.arange(10)
BOX = np.array([10.0, 10, 30, 60])


EVERY = np.ones(10, dtype=bool)
TRUTH = GroundTruth(FRAMES, np.ones(10, dtype=int), np.tile(BOX, (10, 1)), EVERY, ~EVERY, np.ones(10))


def demo(**tracks: list[Track]) -> Report:
    scores = {name: evaluate_sequences([SequencePair("walk", TRUTH, each, 10)]) for name, each in tracks.items()}
    return Report("", "", TRUTH, tracks, scores, 10)


def track(number: int, shift: float = 0.0) -> Track:
    return Track(number, FRAMES, np.tile(BOX + shift, (10, 1)), np.ones(10))


def test_a_second_best_method_is_told_by_its_false_boxes():
    line, where = why_not_best(demo(clean=[track(1)], flow=[track(1), track(2, 200.0)]))
    assert line.startswith("flow is not the best here in HOTA (0.")
    assert "keeps 10 false boxes (clean 0), misses 0 people (0)" in line

    assert where == "Its false boxes: 10 on things that never move and were taken for people all the time (1)."


def test_false_boxes_are_told_by_what_they_are():
    away = track(2, 200.0)
    away.boxes[:] += np.arange(10)[:, None] * [9.0, 0, 9, 0]
    away = replace(away, observed=FRAMES < 6)
    line, where = why_not_best(demo(clean=[track(1)], flow=[track(1), away]))
    assert "keeps 10 false boxes" in line
    assert where == (
        "Its false boxes: 4 filled into gaps where no person is, 6 beside people or on people who have a box already."
    )


def test_boxes_that_lie_less_closely_are_told_too():
    (line,) = why_not_best(demo(close=[track(1)], flow=[track(1, 2.0)]))
    assert "keeps 0 false boxes" in line
    assert "right boxes overlap true ones by 0.761 (1.000)" in line


def test_the_best_method_needs_no_excuse():
    assert why_not_best(demo(poor=[track(2, 200.0)], flow=[track(1)])) == []
