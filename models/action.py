"""The four-stream action network: colour and optical flow, each of a local and a global crop (thesis 5.2.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from tsuiseki.models.backbones import Trunk, TrunkName, build_trunk


class ActionStream(nn.Module):
    """One stream: crops of people in, one logit an action out.

    Args:
        classes: number of actions; a person may perform several at once.
        channels: of the input: 3 of colour, 2 for each stacked pair of flow.
        trunk: its name; the thesis has ``resnet101``.
        weights: ``imagenet`` starts the trunk from torchvision's weights, null from scratch.
        dropout: share of the pooled values left out in training, in [0, 1); the thesis has 0.7.
    """

    def __init__(
        self,
        classes: int,
        channels: int = 3,
        trunk: TrunkName = "resnet18",
        weights: Literal["imagenet"] | None = None,
        dropout: float = 0.7,
    ) -> None:
        super().__init__()
        self.trunk = build_trunk(trunk, weights)
        if channels != 3:
            set_input_channels(self.trunk, channels, keep=weights is not None)
        self.dropout = nn.Dropout(dropout)
        self.classifier = nn.Linear(self.trunk.channels[-1], classes)

    def forward(self, crops: Tensor) -> Tensor:
        """``(B, channels, H, W)`` normalised crops to logits ``(B, classes)``."""
        pooled = functional.adaptive_avg_pool2d(self.trunk(crops)[-1], 1).flatten(1)
        logits: Tensor = self.classifier(self.dropout(pooled))
        return logits


class ActionNetwork(nn.Module):
    """Streams by name; what they say is averaged after the sigmoid (thesis Fig. 5.3).

    Args:
        streams: at least one, each an `ActionStream` or another `ActionClassifier`.
    """

    def __init__(self, streams: Mapping[str, nn.Module]) -> None:
        super().__init__()
        if not streams:
            raise ValueError("expected at least one stream")
        self.streams = nn.ModuleDict(dict(streams))

    def forward(self, crops: Mapping[str, Tensor]) -> Tensor:
        """Crops ``(B, channels, H, W)`` by stream to the probabilities ``(B, classes)``: a single-frame feature."""
        return torch.stack([stream(crops[name]).sigmoid() for name, stream in self.streams.items()]).mean(dim=0)


class FusedProbability(nn.Module):
    """The four streams of the thesis as they are exported together.

    Args:
        network: of these four.
    """

    def __init__(self, network: ActionNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, rgb_local: Tensor, rgb_global: Tensor, flow_local: Tensor, flow_global: Tensor) -> Tensor:
        """``(B, channels, H, W)`` of each stream to probabilities ``(B, classes)``."""
        crops = {"rgb_local": rgb_local, "rgb_global": rgb_global}
        probability: Tensor = self.network({**crops, "flow_local": flow_local, "flow_global": flow_global})
        return probability


class StreamProbability(nn.Module):
    """A stream as it is exported: with the sigmoid.

    Args:
        stream: trained.
    """

    def __init__(self, stream: ActionStream) -> None:
        super().__init__()
        self.stream = stream

    def forward(self, crops: Tensor) -> Tensor:
        """``(B, channels, H, W)`` to probabilities ``(B, classes)``."""
        probability: Tensor = self.stream(crops).sigmoid()
        return probability


def set_input_channels(trunk: Trunk, channels: int, *, keep: bool) -> None:
    """Let ``trunk`` take another number of channels.

    Args:
        trunk: changed in place.
        channels: of the new first convolution.
        keep: start every channel from the mean of the old weights over the colours, scaled so that the variance of what
            comes out stays: a flow stream can start from weights learnt on colour (Wang et al. 2016). Otherwise the
            convolution starts at random.
    """
    parent, name, first = _first_convolution(trunk)
    fresh = nn.Conv2d(
        channels,
        first.out_channels,
        kernel_size=first.kernel_size,  # type: ignore[arg-type]
        stride=first.stride,  # type: ignore[arg-type]
        padding=first.padding,  # type: ignore[arg-type]
        bias=first.bias is not None,
    )
    if keep:
        with torch.no_grad():
            mean = first.weight.mean(dim=1, keepdim=True)
            fresh.weight.copy_(mean.expand_as(fresh.weight) * (first.in_channels / channels) ** 0.5)
    setattr(parent, name, fresh)


def _first_convolution(module: nn.Module) -> tuple[nn.Module, str, nn.Conv2d]:
    for path, child in module.named_modules():
        if isinstance(child, nn.Conv2d):
            parent, _, name = path.rpartition(".")
            return module.get_submodule(parent), name, child
    raise ValueError("expected a convolution in the trunk")


def action_loss(logits: Tensor, truth: Tensor, positive_weight: Tensor | None = None) -> Tensor:
    """The multi-label binary cross-entropy of Eq. (5.1), as a mean instead of a sum.

    Args:
        logits: ``(B, C)``.
        truth: ``(B, C)`` 1 for the actions performed, 0 for the others.
        positive_weight: ``(C,)`` of the terms of performed actions; None weighs all the same.
    """
    return functional.binary_cross_entropy_with_logits(logits, truth, pos_weight=positive_weight)


def fused_logits(logits: Sequence[Tensor]) -> Tensor:
    """``(B, C)`` logits of the mean probability of streams (thesis Fig. 5.3), from those of each, ``(B, C)``."""
    mean = torch.stack([stream.sigmoid() for stream in logits]).mean(dim=0)
    return torch.logit(mean, eps=1e-6)


def positive_weights(counts: Tensor, samples: int, exponent: float, limit: float) -> Tensor:
    """``(C,)`` weights for rare actions: ``(negatives / positives) ** exponent``, within [1, limit].

    Args:
        counts: ``(C,)`` samples in which each action is performed.
        samples: number of all samples.
        exponent: 0 weighs nothing, 1 balances every action.
        limit: largest weight.
    """
    odds = (samples - counts).clamp(min=1) / counts.clamp(min=1)
    return (odds.double() ** exponent).clamp(1, limit).float()
