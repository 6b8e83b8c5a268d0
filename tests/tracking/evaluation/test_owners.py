"""Whose box it is, on boxes whose owners are known."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.evaluation.coverage import IGNORED, UNMATCHED, matched_labels, owners_of
from tsuiseki.tracking.types.labels import GroundTruth

BOXES = np.array([[0.0, 0, 40, 100], [0, 200, 40, 300], [0, 400, 40, 500]])
# Frame 3 first, so that rows are no ids; the last person is ignored, the second neither evaluated nor ignored.
TRUTH = GroundTruth(
    np.array([3, 4, 4, 4]),
    np.array([9, 5, 6, 7]),
    np.concatenate([BOXES[:1], BOXES]),
    np.array([True, True, False, False]),
    np.array([False, False, False, True]),
    np.ones(4),
)


def test_a_box_belongs_to_one_label_and_a_label_to_one_box() -> None:
    boxes = np.array([BOXES[0], BOXES[0] + 5, BOXES[2], BOXES[0] + 1000])
    here = np.full(4, 4)
    assert owners_of(here, boxes, TRUTH).tolist() == [5, UNMATCHED, IGNORED, UNMATCHED]
    assert owners_of(here, boxes[[1, 0, 2, 3]], TRUTH).tolist() == [UNMATCHED, 5, IGNORED, UNMATCHED]
    assert matched_labels(here, boxes, TRUTH).tolist() == [1, UNMATCHED, 3, UNMATCHED]


def test_a_label_that_is_neither_evaluated_nor_ignored_owns_nothing() -> None:
    assert owners_of(np.array([4]), BOXES[1:2], TRUTH).tolist() == [UNMATCHED]
    assert matched_labels(np.array([4]), BOXES[1:2], TRUTH).tolist() == [2]


def test_a_frame_without_labels_and_no_labels_at_all() -> None:
    nobody = TRUTH.select(np.zeros(4, dtype=np.bool_))
    assert owners_of(np.array([0, 3]), BOXES[[0, 0]], TRUTH).tolist() == [UNMATCHED, 9]
    assert owners_of(np.array([4]), BOXES[:1], nobody).tolist() == [UNMATCHED]
