"""Pricing again only what has changed gives what pricing everything gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.costs import HandSetCost, PairFeatures, inner_products
from tsuiseki.tracking.association.flow.repricing import (
    ALL_NEW,
    PricedPairs,
    action_distances,
    network,
    price_pairs,
    reprice,
)
from tsuiseki.tracking.association.gating import GateSettings
from tsuiseki.tracking.association.rows import DetectionRows
from tsuiseki.tracking.types import FloatArray

SIZE = np.array([16.0, 30.0])
GATE = GateSettings(5, reach=3.0, speed=0.5)


class Counted:
    """Hand-set costs that count what they are asked."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __call__(self, pairs: PairFeatures) -> FloatArray:
        self.asked.append(len(pairs))
        return HandSetCost()(pairs)


@pytest.fixture
def rows() -> DetectionRows:
    rng = np.random.default_rng(0)
    corner = rng.uniform(0, 80, (90, 2))
    boxes = np.concatenate([corner, corner + SIZE], axis=1)
    return DetectionRows(np.arange(90), np.repeat(np.arange(30), 3), boxes, np.full(90, 0.9), None)


def priced(rows: DetectionRows, actions: FloatArray, cost: Counted) -> PricedPairs:
    return price_pairs(rows, actions, cost, GATE, 0.1)


def test_it_is_bit_for_bit_what_pricing_all_gives(rows: DetectionRows) -> None:
    rng = np.random.default_rng(1)
    cost, actions = Counted(), rng.random((90, 6))
    now = priced(rows, actions, cost)
    for _ in range(4):
        actions = actions.copy()
        actions[rng.integers(0, 90, 9)] = rng.random((9, 6))
        now = reprice(now, action_distances(actions, actions, now.i, now.j), cost, 0.0)
        anew = priced(rows, actions, Counted())
        np.testing.assert_array_equal(now.costs, anew.costs)
        np.testing.assert_array_equal(
            network(rows.scores, now, 9, 9).transition, network(rows.scores, anew, 9, 9).transition
        )
    assert max(cost.asked[1:]) < cost.asked[0] / 2


def test_small_changes_do_not_add_up_unseen(rows: DetectionRows) -> None:
    """A distance is compared with that of the last pricing, not with that of the flow before."""
    cost = Counted()
    now = priced(rows, np.random.default_rng(2).random((90, 6)), cost)
    first = now.pairs.action
    assert first is not None
    for step in (1, 2, 3):
        now = reprice(now, first + 0.0004 * step, cost, 0.001)
    assert cost.asked[1:] == [0, 0, cost.asked[0]]
    np.testing.assert_array_equal(now.costs, HandSetCost()(replace(now.pairs, action=first + 0.0004 * 3)))


def test_other_costs_price_all(rows: DetectionRows) -> None:
    cost = Counted()
    now = priced(rows, np.full((90, 6), 0.5), cost)
    assert now.pairs.action is not None
    reprice(now, now.pairs.action, cost, ALL_NEW)
    assert cost.asked == [len(now.i)] * 2


def test_inner_products_in_pieces() -> None:
    rng = np.random.default_rng(3)
    earlier, later = rng.normal(size=(2, 50, 100_000 // 50))
    i, j = rng.integers(0, 50, (2, 400))
    # 125 pairs to a piece.
    np.testing.assert_array_equal(inner_products(earlier, later, i, j), np.einsum("pd,pd->p", earlier[i], later[j]))
    assert len(inner_products(earlier, later, i[:0], j[:0])) == 0
