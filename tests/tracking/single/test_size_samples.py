"""Samples over sizes: what was cut out once is the same when it is cut out again."""

import numpy as np
import pytest

from tsuiseki.tracking.single.search_windows import SizeLadder

LADDER = SizeLadder(np.array([30.0, 60.0]), np.array([16, 32]), 4, 1.03, 11)
IMAGE = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
CENTRE = np.array([70.0, 55.0])


@pytest.mark.parametrize("middle", [-20, -2, 0, 1, 3, 20])
def test_rows_that_were_seen_are_those_that_would_be_cut_out(middle):
    seen = LADDER.sample(IMAGE, CENTRE, 0)
    again, fresh = LADDER.sample(IMAGE, CENTRE, middle, seen), LADDER.sample(IMAGE, CENTRE, middle)
    assert again.first == fresh.first == middle - 5
    np.testing.assert_allclose(again.rows, fresh.rows, atol=1e-6)


def test_levels_and_sizes_are_inverse():
    assert [LADDER.level(1.03**level) for level in range(-5, 6)] == pytest.approx(list(range(-5, 6)))
