"""What differs from the empty view, and by how much boxes are off it."""

from __future__ import annotations

import numpy as np

from tests.trainers.adapt import street
from tsuiseki.trainers.adapt.silhouettes import (
    covered_share,
    difference,
    edge_offsets,
    moving_blobs,
    told_from_shadow,
    usual_offset,
)


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
    assert told_from_shadow(different, bright, boxes).tolist() == [True, False]


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
