"""Search windows where they leave the image."""

import numpy as np
import pytest

from tsuiseki.tracking.single.search_windows import cut

IMAGE = np.random.default_rng(0).integers(0, 256, (40, 60, 3), dtype=np.uint8)


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.5, 9.0])
def test_a_window_at_its_own_place_is_the_image(scale):
    patch = cut(IMAGE, np.array([[30.0, 20.0]]), np.array([scale]), 8, 8)[0]
    assert patch.shape == (8, 8, 3)
    if scale == 1.0:
        np.testing.assert_array_equal(patch, IMAGE[16:24, 26:34])


@pytest.mark.parametrize("scale", [1.0, 2.5, 9.0])
@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (1, -1)])
def test_far_outside_the_border_repeats_and_memory_stays_bounded(scale, direction):
    def at(distance):
        centre = np.array([30.0, 20.0]) + distance * np.array(direction)
        return cut(IMAGE, centre[None], np.array([scale]), 8, 8)

    # 1e9 pixels of margin would not fit into any memory
    np.testing.assert_array_equal(at(1e9), at(1000.0))
