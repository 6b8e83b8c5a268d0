"""The association network: nothing changes at first, changes are bounded, and gradients reach every weight."""

from __future__ import annotations

import torch

from tsuiseki.models.association import LARGEST, AssociationNetwork, CostChange
from tsuiseki.tracking.association.learnt_costs import LARGEST as LARGEST_IN_THE_TRACKER


def test_changes_nothing_at_first() -> None:
    network = AssociationNetwork(5, 4, 6)
    links, detections, joins = network(torch.randn(7, 5), torch.randn(3, 4), torch.randn(0, 6))
    assert links.shape == (7,)
    assert detections.shape == (3, 3)
    assert joins.shape == (0,)
    assert not links.any()
    assert not detections.any()


def test_changes_are_bounded_as_the_tracker_expects() -> None:
    assert LARGEST == LARGEST_IN_THE_TRACKER
    torch.manual_seed(0)
    change = CostChange(5, 2)
    for weight in change.parameters():
        torch.nn.init.normal_(weight, std=30)
    rows = 100 * torch.randn(200, 5)
    assert 0.9 * LARGEST < change(rows).abs().max() <= LARGEST


def test_standardises_features_of_any_scale() -> None:
    change = CostChange(3, 1)
    rows = torch.tensor([[0.0, 100.0, 5.0], [2.0, 300.0, 5.0]])
    change.standardise(rows)
    torch.testing.assert_close(change.mean, torch.tensor([1.0, 200.0, 5.0]))
    # The last one never varies: it is not blown up.
    torch.testing.assert_close(change.deviation, torch.tensor([1.0, 100.0, 0.05]))
    change.standardise(rows[:0])
    assert change.mean[1] == 200


def test_gradients_reach_every_weight() -> None:
    torch.manual_seed(0)
    network = AssociationNetwork(5, 4, 6)
    optimiser = torch.optim.SGD(network.parameters(), lr=0.1)
    for _ in range(2):
        optimiser.zero_grad()
        changes = network(torch.randn(7, 5), torch.randn(3, 4), torch.randn(2, 6))
        torch.cat([part.flatten() for part in changes]).add(1).square().sum().backward()
        optimiser.step()
    assert all(weight.grad is not None and weight.grad.abs().sum() > 0 for weight in network.parameters())


def test_less_than_all_is_taken_outside_of_training() -> None:
    torch.manual_seed(0)
    change = CostChange(4, 3, (0.5, 1.0, 1.0))
    torch.nn.init.normal_(change.linear.weight)
    rows = torch.randn(6, 4)
    torch.testing.assert_close(change.eval()(rows), change.train()(rows) * torch.tensor([0.5, 1.0, 1.0]))
