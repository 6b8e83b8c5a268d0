"""What the demo says where the method that is drawn is not the best."""

import numpy as np

from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_sequences
from tsuiseki.tracking.report.demo import why_not_best
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth

FRAMES = np.arange(10)
BOX = np.array([10.0, 10, 30, 60])


def scored(*tracks: Track):
    boxes = np.tile(BOX, (10, 1))
    every = np.ones(10, dtype=bool)
    truth = GroundTruth(FRAMES, np.ones(10, dtype=int), boxes, every, ~every, np.ones(10))
    return evaluate_sequences([SequencePair("walk", truth, list(tracks), 10)])


def track(number: int, shift: float = 0.0) -> Track:
    return Track(number, FRAMES, np.tile(BOX + shift, (10, 1)), np.ones(10))


def test_a_second_best_method_is_told_by_its_false_boxes():
    (line,) = why_not_best({"clean": scored(track(1)), "flow": scored(track(1), track(2, 200.0))})
    assert line.startswith("flow is not the best here in HOTA (0.")
    assert "keeps 10 false boxes (clean 0), misses 0 people (0)" in line


def test_the_best_method_needs_no_excuse():
    assert why_not_best({"poor": scored(track(2, 200.0)), "flow": scored(track(1))}) == []
