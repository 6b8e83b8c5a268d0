"""The gated Hungarian step against all matchings."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tsuiseki.tracking.association.assignment import assign


def _best(costs: np.ndarray, limit: float) -> tuple[int, float]:
    """Most pairs within the limit, and the least total of that many, over all matchings."""
    rows, columns = costs.shape
    best = (0, 0.0)
    for size in range(1, min(rows, columns) + 1):
        for chosen in itertools.combinations(range(rows), size):
            for targets in itertools.permutations(range(columns), size):
                values = costs[list(chosen), list(targets)]
                if (values <= limit).all() and (-size, values.sum()) < (-best[0], best[1]):
                    best = (size, float(values.sum()))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_it_is_the_best_of_all_matchings(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = rng.uniform(-1 if seed % 2 else 0, 1, (rng.integers(1, 5), rng.integers(1, 5)))
    costs[rng.random(costs.shape) < 0.2] = np.nan
    costs[rng.random(costs.shape) < 0.2] = np.inf
    rows, columns = assign(costs, 0.5)
    assert len(set(rows)) == len(rows)
    assert len(set(columns)) == len(columns)
    assert (costs[rows, columns] <= 0.5).all()
    size, total = _best(costs, 0.5)
    assert len(rows) == size
    np.testing.assert_allclose(costs[rows, columns].sum(), total, atol=1e-9)


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_nothing_to_match(shape: tuple[int, int]) -> None:
    rows, columns = assign(np.empty(shape), 1.0)
    assert len(rows) == len(columns) == 0


def test_a_cost_at_the_limit_is_allowed_and_one_above_is_not() -> None:
    assert len(assign(np.array([[0.3]]), 0.3)[0]) == 1
    assert len(assign(np.array([[np.nextafter(0.3, 1)]]), 0.3)[0]) == 0
