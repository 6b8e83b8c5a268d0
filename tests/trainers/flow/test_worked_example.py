"""The worked example of docs/methods/association.md: two people in two frames, whom the tracker swaps."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.flow.flow_loss import Arcs, FlowLoss, cheapest, difference_weights

# a, b in the first frame, a, b in the second one; links a-a, b-b, a-b, b-a.
OWNERS = np.array([0, 1, 0, 1])
TAIL, HEAD = np.array([0, 1, 0, 1]), np.array([2, 3, 3, 2])
USE, STARTS, ENDS, LINKS = [-3.0] * 4, [0.0, 0, 5, 5], [5.0, 5, 0, 0], [1.0, 1.2, 0.6, 0.8]
COSTS = np.array([*USE, *STARTS, *ENDS, *LINKS])
RIGHT = np.array([1.0] * 4 + [1, 1, 0, 0] + [0, 0, 1, 1] + [1, 1, 0, 0])
SWAPPED = np.array([1.0] * 4 + [1, 1, 0, 0] + [0, 0, 1, 1] + [0, 0, 1, 1])
ARCS = Arcs(TAIL, HEAD, RIGHT, difference_weights(OWNERS, TAIL, HEAD, RIGHT))


def loss_and_gradient(loss: FlowLoss) -> tuple[float, FloatArray]:
    minima = loss.minima(COSTS, ARCS, np.random.default_rng(0))
    return minima.loss, minima.gradient


def test_the_tracker_swaps_them() -> None:
    np.testing.assert_array_equal(cheapest(COSTS, TAIL, HEAD), SWAPPED)
    np.testing.assert_allclose([COSTS @ RIGHT, COSTS @ SWAPPED], [-9.8, -10.6])


def test_hinge() -> None:
    value, gradient = loss_and_gradient(FlowLoss("hinge"))
    np.testing.assert_allclose(value, 4.8, atol=1e-5)
    np.testing.assert_array_equal(gradient, RIGHT - SWAPPED)


def test_fenchel_young() -> None:
    """Four links with noise of deviation 1 each: the swap stays the cheaper with P(N(0, 2) < 0.8) = 0.655.

    A share of 250 pairs deviates by 0.03, and by less where the two of a pair differ: four of that are allowed.
    """
    value, gradient = loss_and_gradient(FlowLoss("fenchel_young", pairs=250))
    np.testing.assert_allclose(value, 1.27, atol=0.2)
    np.testing.assert_allclose(gradient[12:], [0.655, 0.655, -0.655, -0.655], atol=0.12)
    assert abs(gradient[:4]).max() < 0.1
