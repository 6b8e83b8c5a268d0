"""The Siamese appearance network: one trunk, shared by every crop, to a unit-length feature (thesis 2.3.2).

Its losses learn a distance from identities: contrastive and triplet, on the hardest pairs of a batch or on all. A batch
holds P identities with K views each, and every view is once the anchor. Batch-hard mining (Hermans et al.
2017) counts only its farthest view of the same identity and its closest view of another.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from tsuiseki.models.backbones import TrunkName, build_trunk
from tsuiseki.models.contract import NetworkCard

# Horizontal stripes that a map is averaged over, top to bottom.
STRIPES = 4


class AppearanceNetwork(nn.Module):
    """Crops of people in, unit-length features out: two crops of one person lie close, those of two people apart.

    An `AppearanceTrunk`.

    Every stage of the trunk is averaged over horizontal stripes, so that the colour of a jacket differs from that of
    the trousers, then projected and normalised. The early stages carry the colours, the last one the shapes.

    Args:
        trunk: its name.
        weights: ``imagenet`` starts the trunk from torchvision's weights, null from scratch.
        feature_length: D of the features.
        dropout: share of the pooled values left out in training, in [0, 1).
        size: height and width of the crops, pixels.
    """

    def __init__(
        self,
        trunk: TrunkName = "mobilenet_v3_small",
        weights: Literal["imagenet"] | None = None,
        feature_length: int = 128,
        dropout: float = 0.0,
        size: tuple[int, int] = (128, 64),
    ) -> None:
        super().__init__()
        self.card = NetworkCard(trunk, *size, resize="stretch")
        self.trunk = build_trunk(trunk, weights)
        self.feature_length = feature_length
        pooled = sum(self.trunk.channels) * STRIPES
        # Stages differ in scale by orders of magnitude; without the first normalisation the last one drowns the rest.
        self.head = nn.Sequential(
            nn.BatchNorm1d(pooled),
            nn.Dropout(dropout),
            nn.Linear(pooled, feature_length, bias=False),
            nn.BatchNorm1d(feature_length),
        )

    def forward(self, images: Tensor) -> Tensor:
        """``(B, 3, H, W)`` normalised RGB to ``(B, D)`` of unit length."""
        stripes = [functional.adaptive_avg_pool2d(m, (STRIPES, 1)).flatten(1) for m in self.trunk(images)]
        features: Tensor = self.head(torch.cat(stripes, dim=1))
        return functional.normalize(features, dim=1)


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
    same = _same_person(ids)
    itself = torch.eye(len(ids), dtype=torch.bool, device=ids.device)
    distances = pairwise_distances(features)
    farthest = distances.masked_fill(~same | itself, -torch.inf).amax(dim=1)
    closest = distances.masked_fill(same, torch.inf).amin(dim=1)
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


def softmax_contrastive_loss(features: Tensor, ids: Tensor, temperature: float) -> Tensor:
    """Contrastive loss over all pairs of a batch (supervised contrastive, Khosla et al. 2020, eq. 2).

    For every anchor, the mean over its positives of -log of the positive's share in the sum of
    exp(cosine / temperature) over all others: hard pairs weigh most, but none is left out, so it learns from the
    first step on, where the hardest pairs alone still say little.

    Args:
        features: ``(B, D)`` of unit length.
        ids: ``(B,)`` identities; each at least twice, and at least two different ones.
        temperature: above 0; the lower, the more the hardest pairs count.

    Raises:
        ValueError: an anchor has no positive or no negative.
    """
    itself = torch.eye(len(ids), dtype=torch.bool, device=ids.device)
    positive = _same_person(ids) & ~itself
    logits = (features @ features.T / temperature).masked_fill(itself, -torch.inf)
    log_share = logits - logits.logsumexp(dim=1, keepdim=True)
    return -(log_share.masked_fill(~positive, 0).sum(dim=1) / positive.sum(dim=1)).mean()


def _same_person(ids: Tensor) -> Tensor:
    """``(B, B)`` whether two views show one person; every view needs another of its person and one of somebody else."""
    same = ids[:, None] == ids[None, :]
    count = same.sum(dim=1)
    if not bool(((count > 1) & (count < len(ids))).all()):
        raise ValueError(f"expected at least two identities with two views each, got ids {ids.tolist()}")
    return same
