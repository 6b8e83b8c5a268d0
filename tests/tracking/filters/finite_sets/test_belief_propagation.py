"""Association marginals against the sum over all associations."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tsuiseki.tracking.filters.finite_sets.pairs import association_marginals


def exact(detected, missed, unclaimed):
    tracks, count = detected.shape
    claimed, none, total = np.zeros((tracks, count)), np.zeros(tracks), 0.0
    for choice in itertools.product(range(count + 1), repeat=tracks):
        taken = [c for c in choice if c < count]
        if len(set(taken)) < len(taken):
            continue
        weight = np.prod([missed[i] if c == count else detected[i, c] for i, c in enumerate(choice)])
        weight *= np.prod([unclaimed[j] for j in range(count) if j not in taken])
        total += weight
        for i, c in enumerate(choice):
            if c == count:
                none[i] += weight
            else:
                claimed[i, c] += weight
    return claimed / total, none / total


@pytest.mark.parametrize("shape", [(1, 4), (4, 1), (1, 1), (2, 0), (0, 2)])
def test_without_loops_it_is_exact(shape):
    rng = np.random.default_rng(0)
    detected, missed, unclaimed = rng.random(shape), rng.random(shape[0]), rng.random(shape[1])
    claimed, none = association_marginals(detected, missed, unclaimed, tolerance=1e-10)
    expected_claimed, expected_none = exact(detected, missed, unclaimed)
    np.testing.assert_allclose(claimed, expected_claimed, atol=1e-8)
    np.testing.assert_allclose(none, expected_none, atol=1e-8)


def test_with_loops_it_is_close_and_consistent():
    rng = np.random.default_rng(1)
    for _ in range(20):
        detected, missed, unclaimed = 3 * rng.random((3, 4)), rng.random(3), rng.random(4)
        claimed, none = association_marginals(detected, missed, unclaimed)
        np.testing.assert_allclose(claimed.sum(axis=1) + none, 1.0)
        assert np.all(claimed.sum(axis=0) <= 1.0 + 1e-3)
        # Belief propagation's own error on full graphs with mild weights.
        assert np.abs(claimed - exact(detected, missed, unclaimed)[0]).max() < 0.12


def test_zero_weights_give_no_nan():
    claimed, none = association_marginals(np.zeros((2, 2)), np.zeros(2), np.zeros(2))
    assert np.isfinite(claimed).all()
    np.testing.assert_allclose(none, 1.0)
    claimed, none = association_marginals(np.eye(2), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(claimed, np.eye(2), atol=1e-6)
