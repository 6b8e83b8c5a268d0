"""The association network: nothing changes at first, changes are bounded, and gradients reach every weight."""

from __future__ import annotations

import pytest
import torch

from tsuiseki.models.association_network import LARGEST, AppearanceProjection, AssociationNetwork, CostChange
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


def unit_rows(count: int, length: int, spread: int) -> torch.Tensor:
    """Rows of unit length of which the last ``spread`` numbers vary much and the others little."""
    rows = torch.randn(count, length, generator=torch.Generator().manual_seed(0))
    rows[:, :-spread] *= 0.02
    return torch.nn.functional.normalize(rows, dim=1)


@pytest.mark.parametrize(("kept", "tolerance"), [(6, 1e-5), (3, 0.05)])
def test_a_projection_keeps_distances_at_first(kept: int, tolerance: float) -> None:
    """As many numbers as before: a rotation. Fewer: what is left out is small in these rows, .02 of the rest."""
    rows, projection = unit_rows(50, 6, 3), AppearanceProjection(6, kept)
    before = rows @ rows.T
    assert (projection(rows) @ projection(rows).T - before).abs().max() > (0.5 if kept < 6 else -1)
    projection.start(rows)
    found = projection(rows)
    assert found.shape == (50, kept)
    torch.testing.assert_close(found.norm(dim=1), torch.ones(50))
    torch.testing.assert_close(found @ found.T, before, atol=tolerance, rtol=0)


def test_what_is_not_known_stays_unknown() -> None:
    projection = AppearanceProjection(3, 2)
    rows = torch.tensor([[1.0, 0, 0], [float("nan")] * 3, [0, 0, 0]])
    found = projection(rows)
    assert found.isnan().tolist() == [[False] * 2, [True] * 2, [False] * 2]
    assert not found[2].any()
