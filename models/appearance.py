"""The Siamese appearance network: one trunk, shared by every crop, to a unit-length feature (thesis 2.3.2)."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from tsuiseki.models.backbones import TrunkName, build_trunk


class AppearanceNetwork(nn.Module):
    """Crops of people in, unit-length features out: two crops of one person lie close, those of two people apart.

    Every stage of the trunk is averaged over horizontal stripes, so that the colour of a jacket is told from that of
    the trousers, then projected and normalised. The early stages carry the colours, the last one the shapes.

    Args:
        trunk: its name.
        weights: ``imagenet`` starts the trunk from torchvision's weights, null from scratch.
        feature_length: D of the features.
        stripes: horizontal stripes a map is averaged over, top to bottom.
        dropout: share of the pooled values left out in training, in [0, 1).
    """

    def __init__(
        self,
        trunk: TrunkName = "mobilenet_v3_small",
        weights: Literal["imagenet"] | None = None,
        feature_length: int = 128,
        stripes: int = 4,
        dropout: float = 0.0,
    ) -> None:
        super().__init__()
        self.trunk = build_trunk(trunk, weights)
        self.stripes = stripes
        self.feature_length = feature_length
        pooled = sum(self.trunk.channels) * stripes
        # Stages differ in scale by orders of magnitude; without the first normalisation the last one drowns the rest.
        self.head = nn.Sequential(
            nn.BatchNorm1d(pooled),
            nn.Dropout(dropout),
            nn.Linear(pooled, feature_length, bias=False),
            nn.BatchNorm1d(feature_length),
        )

    def forward(self, images: Tensor) -> Tensor:
        """``(B, 3, H, W)`` normalised RGB to ``(B, D)`` of unit length."""
        stripes = [functional.adaptive_avg_pool2d(m, (self.stripes, 1)).flatten(1) for m in self.trunk(images)]
        features: Tensor = self.head(torch.cat(stripes, dim=1))
        return functional.normalize(features, dim=1)
