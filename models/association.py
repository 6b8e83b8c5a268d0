"""Linear networks that change the costs of the flow by features of links, detections and joins."""

from __future__ import annotations

import torch
from torch import Tensor, nn

# No change of a cost is larger; the tracker relies on it.
LARGEST = 8.0


class CostChange(nn.Module):
    """Features in, changes of costs out: a linear map, bounded by ±`LARGEST`.

    With its first weights the linear map gives 0 everywhere, so the costs start as the tracker's own.

    Args:
        features: F.
        changes: K, costs that are changed.
        trust: shares of the changes that are taken outside of training; all by default. What fits the training
            sequences best goes too far on others.
        network: a module from standardised features ``(P, F)`` to ``(P, K)``, or ``(P,)`` of one change, in place of
            the linear map.
    """

    mean: Tensor
    deviation: Tensor
    trust: Tensor

    def __init__(
        self, features: int, changes: int, trust: tuple[float, ...] | None = None, network: nn.Module | None = None
    ) -> None:
        super().__init__()
        self.register_buffer("trust", torch.tensor(trust or (1.0,) * changes))
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("deviation", torch.ones(features))
        self.changes = changes
        self.linear: nn.Module = nn.Linear(features, changes) if network is None else network
        if network is None:
            for weights in self.linear.parameters():
                nn.init.zeros_(weights)

    def standardise(self, rows: Tensor) -> None:
        """Take mean and deviation of the features from ``(P, F)`` rows; features that hardly vary are left as large."""
        if len(rows):
            self.mean.copy_(rows.mean(dim=0))
            self.deviation.copy_(rows.std(dim=0, correction=0).clamp(min=0.05))

    def forward(self, rows: Tensor) -> Tensor:
        """``(P, F)`` features to ``(P, K)`` changes."""
        # What was never in the training is no reason for a change beyond what was.
        standard = ((rows - self.mean) / self.deviation).clamp(-5.0, 5.0)
        bounded: Tensor = LARGEST * torch.tanh(self.linear(standard).view(-1, self.changes) / LARGEST)
        return bounded if self.training else bounded * self.trust


class AssociationNetwork(nn.Module):
    """The changes of all costs of the flow over detections and of the joining of tracklets.

    Args:
        links: number of features of a link.
        detections: of a detection.
        joins: of a join of two tracklets.
        trust: share of the change of what using a detection costs that is taken outside of training.
        link_costs: a `LinkCosts` in place of the linear map of links.
    """

    def __init__(
        self, links: int, detections: int, joins: int, trust: float = 1.0, link_costs: nn.Module | None = None
    ) -> None:
        super().__init__()
        self.links = CostChange(links, 1, network=link_costs)
        # Of using a detection, of a track's start at it, and of its end.
        self.detections = CostChange(detections, 3, (trust, 1.0, 1.0))
        self.joins = CostChange(joins, 1)

    def trusts(self) -> dict[str, Tensor]:
        """The shares of the changes that are taken, by their names in the state: settings, and nothing learnt."""
        return {name: value for name, value in self.state_dict().items() if name.endswith("trust")}

    def forward(self, links: Tensor, detections: Tensor, joins: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """``(P, F)``, ``(N, G)`` and ``(J, H)`` features to ``(P,)``, ``(N, 3)`` and ``(J,)`` changes."""
        return self.links(links)[:, 0], self.detections(detections), self.joins(joins)[:, 0]
