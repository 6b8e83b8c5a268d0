"""Losses that learn a distance from identities: contrastive and triplet, on the hardest pairs of a batch.

A batch holds P identities with K views each. Every view is once the anchor; its farthest view of the same identity
and its closest view of another are the pairs that count (batch-hard mining, Hermans et al. 2017).
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def pairwise_distances(features: Tensor) -> Tensor:
    """``(B, B)`` Euclidean distances of ``(B, D)`` features."""
    square = (features * features).sum(dim=1)
    squared = square[:, None] + square[None, :] - 2 * features @ features.T
    # The root has no finite slope at 0, where the diagonal and equal views lie.
    return squared.clamp_min(1e-12).sqrt()


def hardest_distances(features: Tensor, ids: Tensor) -> tuple[Tensor, Tensor]:
    """Distance of every anchor to its farthest positive and to its closest negative, each ``(B,)``.

    Args:
        features: ``(B, D)``.
        ids: ``(B,)`` identities; each at least twice, and at least two different ones.

    Raises:
        ValueError: an anchor has no positive or no negative.
    """
    same = ids[:, None] == ids[None, :]
    other = ~torch.eye(len(ids), dtype=torch.bool, device=ids.device)
    positive, negative = same & other, ~same
    if not bool(positive.any(dim=1).all() and negative.any(dim=1).all()):
        raise ValueError(f"expected at least two identities with two views each, got ids {ids.tolist()}")
    distances = pairwise_distances(features)
    farthest = distances.masked_fill(~positive, -torch.inf).amax(dim=1)
    closest = distances.masked_fill(~negative, torch.inf).amin(dim=1)
    return farthest, closest


def triplet_loss(features: Tensor, ids: Tensor, margin: float) -> Tensor:
    """Mean over the anchors of max(0, d(anchor, positive) - d(anchor, negative) + margin), batch-hard.

    Args:
        features: ``(B, D)``.
        ids: ``(B,)`` identities.
        margin: by how much the negative has to be farther than the positive.
    """
    farthest, closest = hardest_distances(features, ids)
    return functional.relu(farthest - closest + margin).mean()


def contrastive_loss(features: Tensor, ids: Tensor, margin: float) -> Tensor:
    """Mean over the anchors of (d(positive)^2 + max(0, margin - d(negative))^2) / 2, batch-hard (Hadsell et al. 2006).

    Args:
        features: ``(B, D)``.
        ids: ``(B,)`` identities.
        margin: distance from which on a negative costs nothing.
    """
    farthest, closest = hardest_distances(features, ids)
    return ((farthest**2 + functional.relu(margin - closest) ** 2) / 2).mean()
