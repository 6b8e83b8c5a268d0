"""Losses of whole flows: brute force, finite differences, convexity, and where they are 0."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from tests.trainers.flow.flows import all_flows
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.trainers.flow.flow_loss import (
    Arcs,
    FlowLoss,
    FlowLossName,
    cheapest,
    difference_weights,
    differing,
)

# The solver rounds each of some 40 costs to a millionth.
ROUNDED = 1e-4
LOSSES = (FlowLoss("fenchel_young", 0.7, 3), FlowLoss("hinge"), FlowLoss("both", 0.7, 3))


def random_arcs(rng: np.random.Generator, count: int, share: float = 0.6) -> tuple[IntArray, IntArray]:
    """Links between detections that are in the order of time."""
    tail, head = np.triu_indices(count, 1)
    kept = rng.random(len(tail)) < share
    return tail[kept], head[kept]


def window(seed: int, count: int = 6) -> tuple[Arcs, FloatArray]:
    """Two people and a false detection in turn, and costs at random."""
    rng = np.random.default_rng(seed)
    tail, head = random_arcs(rng, count)
    owners = np.arange(count) % 3 - 1
    flow = labelled_flow(owners, tail, head)
    costs = rng.normal(0, 2, 3 * count + len(tail))
    return Arcs(tail, head, flow, difference_weights(owners, tail, head, flow)), costs


def labelled_flow(owners: IntArray, tail: IntArray, head: IntArray) -> FloatArray:
    count = len(owners)
    flow = np.zeros(3 * count + len(tail))
    for person in range(owners.max() + 1):
        mine = np.flatnonzero(owners == person)
        flow[mine] = flow[count + mine] = flow[2 * count + mine] = 1
        for a, b in itertools.pairwise(mine):
            link = np.flatnonzero((tail == a) & (head == b))
            flow[3 * count + link] = 1
            flow[[count + b] * len(link)] = flow[[2 * count + a] * len(link)] = 0
    return flow


def value_at(loss: FlowLoss, costs: FloatArray, arcs: Arcs, seed: int = 0) -> float:
    return loss.minima(costs, arcs, np.random.default_rng(seed)).loss


@pytest.mark.parametrize("count", [1, 2, 5, 8])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_cheapest_of_all_flows_is_found(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tail, head = random_arcs(rng, count, 0.5)
    costs = rng.normal(0, 2, 3 * count + len(tail))
    flow = cheapest(costs, tail, head)
    assert costs @ flow == pytest.approx(min(costs @ other for other in all_flows(count, tail, head)), abs=ROUNDED)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_hinge_is_the_largest_margin_over_all_flows(seed: int) -> None:
    arcs, costs = window(seed)
    found = value_at(FlowLoss("hinge"), costs, arcs)
    constant, slope = differing(arcs)
    margins = [
        constant + slope @ flow - costs @ flow + costs @ arcs.labelled
        for flow in all_flows(arcs.count, arcs.tail, arcs.head)
    ]
    assert found == pytest.approx(max(margins), abs=ROUNDED)
    assert found > 0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_distance_is_that_of_each_arc(seed: int) -> None:
    arcs, _ = window(seed)
    constant, slope = differing(arcs)
    for flow in all_flows(arcs.count, arcs.tail, arcs.head):
        assert constant + slope @ flow == pytest.approx(arcs.weight @ np.abs(flow - arcs.labelled))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_gradient_is_that_of_finite_differences(seed: int) -> None:
    """Of the expected perturbed minimum: the same 2 x 150 draws on both sides of every cost.

    Where a draw changes its flow within the step, the difference quotient lies between the two: with steps of 0.002
    and an ε of 0.7 that is about one draw in a hundred.
    """
    arcs, costs = window(seed)
    loss, step = FlowLoss("fenchel_young", 0.7, 150), 1e-3

    def value(at: FloatArray) -> float:
        return value_at(loss, at, arcs, 3)

    gradient = loss.minima(costs, arcs, np.random.default_rng(3)).gradient
    some = np.eye(len(costs))[seed::4]
    around = [(value(costs + step * unit) - value(costs - step * unit)) / (2 * step) for unit in some]
    np.testing.assert_allclose(gradient[seed::4], around, atol=0.03)
    assert np.abs(gradient).max() > 0.3


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.name)
def test_convex_along_segments(loss: FlowLoss) -> None:
    arcs, one = window(0)
    other = window(0)[1][::-1].copy()

    along = [value_at(loss, one + share * (other - one), arcs, 1) for share in np.linspace(0, 1, 21)]
    assert (np.diff(along, 2) >= -ROUNDED).all()
    assert np.diff(along, 2).max() > 0.01


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.name)
@pytest.mark.parametrize("seed", range(5))
def test_never_below_zero(loss: FlowLoss, seed: int) -> None:
    arcs, costs = window(seed)
    assert value_at(loss, costs, arcs, seed) >= -ROUNDED


def test_hinge_is_zero_where_the_labelled_flow_wins_by_the_margin() -> None:
    arcs, _ = window(0)
    minima = FlowLoss("hinge").minima(5 * (1 - 2 * arcs.labelled), arcs, np.random.default_rng(0))
    assert minima.loss == pytest.approx(0, abs=ROUNDED)
    assert not minima.gradient.any()
    # A flow that costs as much as the labelled one is no win.
    assert value_at(FlowLoss("hinge"), np.zeros(len(arcs.labelled)), arcs) > 1


@pytest.mark.parametrize("name", ["fenchel_young", "hinge", "both"])
def test_descent_ends_at_the_labelled_flow(name: FlowLossName) -> None:
    arcs, start = window(2)
    costs, rng = start.copy(), np.random.default_rng(0)
    assert (cheapest(start, arcs.tail, arcs.head) != arcs.labelled).any()
    for _ in range(80):
        costs -= 0.3 * FlowLoss(name, 0.3, 2).minima(costs, arcs, rng).gradient
    np.testing.assert_array_equal(cheapest(costs, arcs.tail, arcs.head), arcs.labelled)


@pytest.mark.parametrize("pairs", [1, 3])
def test_both_is_the_mean_of_the_two(pairs: int) -> None:
    arcs, costs = window(3)
    found = []
    for name in ("fenchel_young", "hinge", "both"):
        minima = FlowLoss(name, 0.7, pairs).minima(costs, arcs, np.random.default_rng(1))  # type: ignore[arg-type]
        found.append(np.append(minima.gradient, minima.loss))
    np.testing.assert_allclose((found[0] + found[1]) / 2, found[2], atol=1e-12)


def test_the_same_draws_give_the_same_loss() -> None:
    arcs, costs = window(1)
    one, again, other = (value_at(LOSSES[0], costs, arcs, k) for k in (0, 0, 1))
    assert one == again != other


def test_a_window_without_detections_costs_nothing() -> None:
    none = np.empty(0, np.int64)
    arcs = Arcs(none, none, np.empty(0), np.empty(0))
    for loss in LOSSES:
        assert value_at(loss, np.empty(0), arcs) == 0


@pytest.mark.parametrize(
    "wrong", [{"name": "l2"}, {"epsilon": 0.0}, {"epsilon": np.nan}, {"epsilon": np.inf}, {"pairs": 0}, {"pairs": 1.5}]
)
def test_a_loss_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    ((name, value),) = wrong.items()
    with pytest.raises(RequestError, match=rf"epsilon above 0 and a number of pairs from 1, got .*{name}='?{value}"):
        FlowLoss(**wrong)


def distance(flow: dict[str, list[int]]) -> float:
    """Δ of a flow over two people of three frames, 0 2 4 and 1 3 5, named by what it has."""
    tail, head = np.array([0, 2, 1, 3, 2, 3, 0]), np.array([2, 4, 3, 5, 5, 4, 4])
    owners = np.array([0, 1] * 3)
    right = labelled_flow(owners, tail, head)
    made = np.zeros(len(right))
    for offset, name in ((0, "used"), (6, "starts"), (12, "ends"), (18, "links")):
        made[offset + np.array(flow[name], dtype=np.int64)] = 1
    constant, slope = differing(Arcs(tail, head, right, difference_weights(owners, tail, head, right)))
    return float(constant + slope @ made)


def test_a_switch_counts_more_than_a_missed_box() -> None:
    every = list(range(6))
    right = {"used": every, "starts": [0, 1], "ends": [4, 5], "links": [0, 1, 2, 3]}
    missed = {"used": [0, 1, 3, 4, 5], "starts": [0, 1], "ends": [4, 5], "links": [6, 2, 3]}
    missed_at_the_end = {"used": [0, 1, 2, 3, 5], "starts": [0, 1], "ends": [2, 5], "links": [0, 2, 3]}
    missed_and_broken = {"used": [0, 1, 3, 4, 5], "starts": [0, 1, 4], "ends": [0, 4, 5], "links": [2, 3]}
    broken = {"used": every, "starts": [0, 1, 4], "ends": [2, 4, 5], "links": [0, 2, 3]}
    swapped = {"used": every, "starts": [0, 1], "ends": [4, 5], "links": [0, 2, 4, 5]}
    found = [distance(flow) for flow in (right, missed, missed_at_the_end, missed_and_broken, broken, swapped)]
    assert found == [0, 1, 1.5, 2, 1, 4]
