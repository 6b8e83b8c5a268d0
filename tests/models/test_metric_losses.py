"""Metric losses against hand-computed values."""

from __future__ import annotations

import math

import pytest
import torch

from tsuiseki.models.appearance import (
    contrastive_loss,
    hardest_distances,
    pairwise_distances,
    softmax_contrastive_loss,
    triplet_loss,
)

# Two people on a line: the first at 0 and 1, the second at 3 and 7.
LINE = torch.tensor([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0], [7.0, 0.0]])
IDS = torch.tensor([4, 4, 9, 9])


def test_distances_are_euclidean() -> None:
    features = torch.tensor([[0.0, 0.0], [3.0, 4.0]])
    torch.testing.assert_close(pairwise_distances(features), torch.tensor([[0.0, 5.0], [5.0, 0.0]]), atol=1e-5, rtol=0)


def test_hardest_pairs_on_a_line() -> None:
    farthest, closest = hardest_distances(LINE, IDS)
    torch.testing.assert_close(farthest, torch.tensor([1.0, 1.0, 4.0, 4.0]))
    torch.testing.assert_close(closest, torch.tensor([3.0, 2.0, 2.0, 6.0]))


def test_triplet_closed_form() -> None:
    # d+ - d- = -2, -1, 2, -2; with margin 1.5 the terms are 0, 0.5, 3.5, 0.
    torch.testing.assert_close(triplet_loss(LINE, IDS, 1.5), torch.tensor(1.0))


def test_contrastive_closed_form() -> None:
    # d+^2 = 1, 1, 16, 16; (2.5 - d-)+^2 = 0, 0.25, 0.25, 0.
    torch.testing.assert_close(contrastive_loss(LINE, IDS, 2.5), torch.tensor((34 + 0.5) / 8))


@pytest.mark.parametrize("loss", [triplet_loss, contrastive_loss])
def test_separated_people_cost_nothing(loss) -> None:  # type: ignore[no-untyped-def]
    features = torch.tensor([[1.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [-1.0, 0.0]])
    # Equal views are distinguished by the root of 1e-12.
    assert float(loss(features, IDS, 1.0)) == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("loss", [triplet_loss, contrastive_loss])
def test_gradient_is_finite_and_descends(loss) -> None:  # type: ignore[no-untyped-def]
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(8, 4, generator=generator)
    features[1] = features[0]  # equal views: the distance has no slope there
    features.requires_grad_()
    ids = torch.arange(4).repeat_interleave(2)
    before = loss(features, ids, 1.0)
    (gradient,) = torch.autograd.grad(before, features)
    assert torch.isfinite(gradient).all()
    assert float(loss(features.detach() - 1e-3 * gradient, ids, 1.0)) < float(before.detach())


def test_order_of_the_batch_does_not_matter() -> None:
    generator = torch.Generator().manual_seed(1)
    features, ids = torch.randn(12, 5, generator=generator), torch.arange(4).repeat(3)
    order = torch.randperm(12, generator=generator)
    for loss in (triplet_loss, contrastive_loss):
        torch.testing.assert_close(loss(features, ids, 0.7), loss(features[order], ids[order], 0.7))


@pytest.mark.parametrize("ids", [[0, 0, 0, 0], [0, 0, 1, 2]], ids=["no negative", "no positive"])
def test_unusable_batch(ids: list[int]) -> None:
    with pytest.raises(ValueError, match="two identities with two views"):
        triplet_loss(LINE, torch.tensor(ids), math.pi)


def test_softmax_closed_form() -> None:
    """Two people at right angles at temperature 1: each anchor sees one positive at cosine 1, two others at 0."""
    features = torch.tensor([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    expected = math.log(math.e + 2) - 1
    torch.testing.assert_close(softmax_contrastive_loss(features, IDS, 1.0), torch.tensor(expected))
    with pytest.raises(ValueError, match="two identities with two views"):
        softmax_contrastive_loss(features, torch.tensor([0, 0, 1, 2]), 1.0)
