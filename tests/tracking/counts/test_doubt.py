"""Intervals hold the true number as often as they say."""

import numpy as np
import pytest

from tsuiseki.tracking.counts.doubt import SHAPE, interval_of


@pytest.mark.parametrize(("false", "missed"), [(0.5, 0.5), (0.1, 2.0), (3.0, 1.0), (0.0, 6.0)])
def test_where_the_doubt_is_right_nine_of_ten_intervals_hold_the_truth(false, missed):
    rng = np.random.default_rng(0)
    low, high = interval_of(50, false, missed)
    true = 50 - rng.poisson(false, 20_000) + rng.poisson(rng.gamma(SHAPE, missed / SHAPE, 20_000))
    held = np.mean((true >= low) & (true <= high))
    # The nearest that whole numbers give to 0.9.
    assert 0.8 <= held <= 0.97
    assert low <= 50 <= high


def test_an_interval_reaches_neither_below_zero_nor_past_certainty():
    assert interval_of(0, 2.0, 0.0)[0] == 0
    assert interval_of(7, 0.0, 0.0) == (7, 7)
    low, high = interval_of(100_000, 300.0, 2400.0)
    assert 99_650 < low <= 100_000
    assert 105_000 < high < 106_000
