"""Crops: as they should be near the image, and small whatever a detector says."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from tsuiseki.tracking.features.action import RGB_FILL, crop_squares
from tsuiseki.tracking.preprocessing import crop_boxes

IMAGE = np.random.default_rng(0).integers(0, 256, (120, 160, 3)).astype(np.uint8)
BOXES = ([9, 9, 1e5, 1e5], [1e6, 9, 1e6 + 20, 49], [-1e9, -1e9, 1e9, 1e9], [1e300, 1e300, 1e301, 1e301])


@pytest.mark.parametrize("box", BOXES)
def test_boxes_beyond_all_bounds_take_no_memory(box: list[float]) -> None:
    tracemalloc.start()
    crops = crop_boxes(IMAGE, np.array([box]), 64, 32)
    squares = crop_squares(IMAGE, np.array([[box[0], box[1], box[2], box[1] + box[2] - box[0]]]), 32)
    assert tracemalloc.get_traced_memory()[1] < 1e7
    tracemalloc.stop()
    assert crops.shape == (1, 64, 32, 3)
    assert squares.shape == (1, 32, 32, 3)


def test_a_box_far_outside_repeats_the_border() -> None:
    crop = crop_boxes(IMAGE, np.array([[1e6, 20, 1e6 + 40, 60.0]]), 40, 40)[0]
    np.testing.assert_array_equal(crop, np.repeat(IMAGE[20:60, -1:], 40, axis=1))


def test_a_square_around_everything_shows_the_image_in_the_middle() -> None:
    crop = crop_squares(IMAGE, np.array([[-4920.0, -4940, 5080, 5060]]), 100)[0]
    assert (crop == RGB_FILL).all(axis=2).sum() >= 100 * 100 - 4
