"""What differs from the empty view, and by how much boxes are off it."""

from __future__ import annotations

import numpy as np

from tests.trainers.adapt import street
from tsuiseki.trainers.adapt.foreground import (
    Difference,
    covered_share,
    detected_boxes,
    difference,
    drawn_to_silhouettes,
    edge_offsets,
    moving_blobs,
    unlike_shadow,
    usual_offset,
)

USUAL = np.array([0.1, 0.0, 0.0, 0.0])


def test_people_differ_and_nothing_else() -> None:
    different, _ = difference(street.picture(40), street.picture(40) * 0 + street.view())
    shares = covered_share(different, np.concatenate([street.people(40), np.array([[2.0, 90.0, 20.0, 118.0]])]))
    assert (shares[:2] > 0.95).all()
    assert shares[2] == 0


def test_a_change_of_light_is_no_person() -> None:
    brighter = np.clip(street.view().astype(int) + 25, 0, 255).astype(np.uint8)
    assert difference(brighter, street.view())[0].mean() < 0.02


def test_a_shadow_is_told_from_a_person() -> None:
    image = street.view().copy()
    image[80:90, 40:80] = (0.7 * image[80:90, 40:80]).astype(np.uint8)
    different, bright = difference(image, street.view())
    assert different[82:88, 45:75].mean() > 0.9
    assert bright[82:88, 45:75].mean() < 0.1


def test_dark_legs_on_dark_ground_tell_nothing() -> None:
    """Two people alike, but that the lower half of one is as dark as a shadow there."""
    image = street.view().copy()
    boxes = np.array([[20.0, 30.0, 40.0, 90.0], [80.0, 30.0, 100.0, 90.0]])
    for x1, y1, x2, y2 in boxes.astype(int):
        image[y1:y2, x1:x2] = (230, 40, 40)
    image[60:90, 80:100] = (0.6 * street.view()[60:90, 80:100]).astype(np.uint8)
    different, bright = difference(image, street.view())
    assert (covered_share(different, boxes) > 0.9).all()
    assert unlike_shadow(different, bright, boxes).tolist() == [True, False]


def test_boxes_are_moved_onto_silhouettes() -> None:
    """The right side lies 0.2 widths outside; silhouettes get 0.08 of room, 0.03 above and below."""
    offsets = []
    for frame in range(0, 20):
        _, bright = difference(street.picture(frame), street.view())
        box = street.people(frame)[:1] + np.array([0, 0, 0.2 * 14, 0])
        offsets.append(edge_offsets(bright, box))
    left, top, right, bottom = usual_offset(np.concatenate(offsets))
    # A pixel is 0.06 of the box's width; smoothing blurs an edge by as much.
    np.testing.assert_allclose(right, (0.08 - 0.2) / 1.2, atol=0.08)
    np.testing.assert_allclose(left, -0.08 / 1.2, atol=0.08)
    np.testing.assert_allclose([top, bottom], [-0.03, 0.03], atol=0.05)


def test_few_silhouettes_move_nothing() -> None:
    assert (usual_offset(np.full((19, 4), 0.3)) == 0).all()
    assert (usual_offset(np.full((20, 4), 0.3)) == 0.3).all()


def test_unknown_people_are_seen() -> None:
    _, bright = difference(street.picture(40), street.view())
    both = moving_blobs(bright, np.empty((0, 4)), 20)
    rest = moving_blobs(bright, street.people(40)[:1], 20)
    assert len(both) >= 2
    assert len(rest) == len(both) - 1


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
