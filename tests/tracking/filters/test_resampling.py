"""Systematic resampling: unbiased, never a particle of weight zero, whatever the rounding."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.filters.resampling import systematic, systematic_rows


class LargestDraws:
    """A generator whose draws are all the largest number below one, where (n - 1 + u) / n rounds to one."""

    def random(self, size: int | tuple[int, int] | None = None) -> float | np.ndarray:
        value = np.nextafter(1.0, 0.0)
        return value if size is None else np.full(size, value)


@pytest.mark.parametrize("count", [7, 20, 31])
def test_frequencies_equal_the_weights(count):
    weights = np.array([0.0, 0.5, 2.0, 0.0, 0.05, 1.45, 3.0, 0.0])
    rng = np.random.default_rng(1)
    runs = 4000
    copies = np.array([np.bincount(systematic(weights, count, rng), minlength=8) for _ in range(runs)])
    expected = count * weights / weights.sum()
    # Multinomial copies vary most: five of their standard deviations, divided by the root of the runs.
    tolerance = 5 * np.sqrt(expected * (1 - weights / weights.sum()) / runs)
    assert np.all(np.abs(copies.mean(axis=0) - expected) <= tolerance + 1e-12)
    assert np.all(copies.sum(axis=1) == count)


def test_whole_parts_are_kept():
    weights, rng = np.random.default_rng(0).random(30), np.random.default_rng(2)
    copies = np.array([np.bincount(systematic(weights, 50, rng), minlength=30) for _ in range(2000)])
    assert np.all(copies >= np.floor(50 * weights / weights.sum()))


@pytest.mark.parametrize("weights", [[0, 0, 1, 0], [1e-300, 0, 1, 0], [0, 1e-320, 0], [1, 0, 0]])
def test_one_dominant_weight_takes_all(weights):
    drawn = systematic(np.array(weights, dtype=float), 1000, np.random.default_rng(0))
    np.testing.assert_array_equal(drawn, np.full(1000, np.argmax(weights)))


@pytest.mark.parametrize("count", [1, 3, 10, 1000, 2**20])
def test_largest_draw_and_cumulative_sum_below_one(count):
    weights = np.append(np.full(10, 0.1), 0.0)
    assert np.cumsum(weights)[-1] < 1.0
    drawn = systematic(weights, count, LargestDraws())
    assert len(drawn) == count
    assert drawn.max() <= 9
    assert drawn.min() >= 0


def test_indices_are_sorted_and_repeatable():
    weights = np.random.default_rng(0).random(50)
    drawn = systematic(weights, 200, np.random.default_rng(3))
    assert drawn.dtype == np.int64
    assert np.all(np.diff(drawn) >= 0)
    np.testing.assert_array_equal(drawn, systematic(weights, 200, np.random.default_rng(3)))


def test_no_draw_is_empty():
    assert len(systematic(np.ones(3), 0, np.random.default_rng(0))) == 0


def test_rows_are_drawn_apart():
    weights = np.array([[0.0, 1.0, 0.0], [0.5, 0.25, 0.25]])
    drawn = systematic_rows(weights, 8, np.random.default_rng(0))
    np.testing.assert_array_equal(drawn, [[1] * 8, [0] * 4 + [1] * 2 + [2] * 2])


@pytest.mark.parametrize("weights", [[], [0.0, 0.0], [1.0, np.nan], [1.0, np.inf], [2.0, -1.0]])
def test_refuses_what_are_no_weights(weights):
    with pytest.raises(ValueError, match="finite weights"):
        systematic(np.array(weights), 5, np.random.default_rng(0))
