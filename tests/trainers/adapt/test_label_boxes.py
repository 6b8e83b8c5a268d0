"""A label's box lies on the detection of its frame, and part of the way to its own silhouette."""

from __future__ import annotations

import numpy as np

from tests.trainers.adapt import street
from tsuiseki.trainers.adapt.foreground import Difference
from tsuiseki.trainers.adapt.label_boxes import detected_boxes, drawn_to_silhouettes
from tsuiseki.trainers.adapt.silhouettes import difference

USUAL = np.array([0.1, 0.0, 0.0, 0.0])


def _picture(frame: int) -> Difference:
    return Difference(*difference(street.picture(frame), street.view()))


def test_detections_take_the_place_of_smoothed_boxes() -> None:
    boxes = np.array([[10.0, 10, 30, 60], [50, 10, 70, 60], [90, 10, 110, 60]])
    found = np.array([[51.0, 12, 74, 60], [11, 10, 29, 61]])
    seen = np.array([True, True, True])
    np.testing.assert_array_equal(detected_boxes(boxes, seen, found), [found[1], found[0], boxes[2]])
    np.testing.assert_array_equal(detected_boxes(boxes, ~seen, found), boxes)
    np.testing.assert_array_equal(detected_boxes(boxes, seen, found[:0]), boxes)


def test_a_box_goes_half_of_the_way_to_its_own_silhouette() -> None:
    """The right side lies 0.14 of the width outside, and silhouettes have a room of 0.08 of theirs."""
    truth = street.people(10)[:1]
    boxes = truth + np.array([0, 0, 2.0, 0])
    moved = drawn_to_silhouettes(boxes, np.array([True]), _picture(10), USUAL, 0.5)
    whole = drawn_to_silhouettes(boxes, np.array([True]), _picture(10), USUAL, 1.0)
    np.testing.assert_allclose(moved, (boxes + whole) / 2)
    # To a pixel, which smoothing blurs an edge by.
    np.testing.assert_allclose(whole[0, 2], truth[0, 2] + 0.08 * 14, atol=1.0)
    assert moved[0, 2] < boxes[0, 2] - 0.2


def test_others_move_as_silhouettes_usually_lie() -> None:
    """Who was not detected, who stands beside somebody, and whose silhouette cannot be seen."""
    truth = street.people(10)[:1]
    wide = 0.1 * 14
    hidden = drawn_to_silhouettes(truth, np.array([False]), _picture(10), USUAL, 0.5)
    np.testing.assert_allclose(hidden, truth + np.array([wide, 0, 0, 0]))
    pair = np.concatenate([truth, truth + np.array([10.0, 0, 10, 0])])
    beside = drawn_to_silhouettes(pair, np.array([True, True]), _picture(10), USUAL, 0.5)
    np.testing.assert_allclose(beside, pair + np.array([wide, 0, 0, 0]))


def test_a_torn_silhouette_moves_no_side_far() -> None:
    """Only the left half of the person differs from the empty view."""
    image = street.picture(10).copy()
    x1, y1, x2, y2 = street.people(10)[0].round().astype(int)
    image[y1:y2, (x1 + x2) // 2 : x2 + 1] = street.view()[y1:y2, (x1 + x2) // 2 : x2 + 1]
    boxes = street.people(10)[:1]
    moved = drawn_to_silhouettes(boxes, np.array([True]), Difference(*difference(image, street.view())), USUAL, 1.0)
    np.testing.assert_allclose(moved[0, 2], boxes[0, 2] - 0.2 * 14)


def test_nothing_moves_where_nothing_shall() -> None:
    boxes = street.people(10)
    assert drawn_to_silhouettes(boxes, np.array([True, True]), _picture(10), USUAL, 0.0) is boxes
