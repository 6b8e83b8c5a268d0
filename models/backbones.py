"""Trunks shared by the networks: the convolutional part of image classifiers, cut at strides 8, 16 and 32."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import torchvision.models
from torch import Tensor, nn
from torchvision.models.vgg import cfgs, make_layers

TrunkName = Literal[
    "mobilenet_v3_small",
    "mobilenet_v3_large",
    "mobilenet_v3_large_075",
    "resnet18",
    "resnet50",
    "resnet101",
    "wide_resnet50",
    "vgg16",
]
# Input pixels from one cell of a map to the next.
TRUNK_STRIDES = (8, 16, 32)

# torchvision's MobileNetV3 averages batch statistics with momentum 0.01, which needs thousands of steps to settle.
FROM_SCRATCH_MOMENTUM = 0.1

_TORCHVISION_NAMES = {"wide_resnet50": "wide_resnet50_2", "mobilenet_v3_large_075": "mobilenet_v3_large"}
# Three quarters of the channels (Howard et al. 2019, 6.1): two thirds of the products, no weights at torchvision.
_WIDTHS = {"mobilenet_v3_large_075": 0.75}
# Where layers that run one after another are cut into stages, and the channels of these.
_CUTS = {
    "mobilenet_v3_small": ((4, 9), (24, 48, 576)),
    "mobilenet_v3_large": ((7, 13), (40, 112, 960)),
    "mobilenet_v3_large_075": ((7, 13), (32, 88, 720)),
    "vgg16": ((23, 30), (512, 512, 512)),
}


class Trunk(nn.Module):
    """Stages run one after another, each halving the map of the one before.

    Attributes:
        channels: of the map after each stage.
        strides: input pixels per map pixel after each stage.
    """

    def __init__(self, stages: Sequence[nn.Module], channels: Sequence[int]) -> None:
        super().__init__()
        self.stages = nn.ModuleList(stages)
        self.channels = tuple(channels)
        self.strides = TRUNK_STRIDES

    def forward(self, images: Tensor) -> list[Tensor]:
        """``(B, 3, H, W)`` to the maps ``(B, C_i, ceil(H / S_i), ceil(W / S_i))``, finest first."""
        maps = []
        for stage in self.stages:
            images = stage(images)
            maps.append(images)
        return maps


def build_trunk(name: TrunkName, weights: Literal["imagenet"] | None = None) -> Trunk:
    """The trunk called ``name``, from scratch or with torchvision's ImageNet weights.

    Raises:
        ValueError: there is no such trunk, or there are no such weights of it.
        ConnectionError: the weights are not on this machine and cannot be downloaded.
    """
    if name not in get_args(TrunkName):
        raise ValueError(f"expected a trunk of {', '.join(get_args(TrunkName))}; got {name!r}")
    if name in _WIDTHS and weights is not None:
        raise ValueError(f"there are no ImageNet weights of {name}; start from scratch with weights: null")
    if name in _CUTS:
        (first, second), channels = _CUTS[name]
        layers = vgg16_layers() if name == "vgg16" and weights is None else _classifier(name, weights).features
        trunk = Trunk((layers[:first], layers[first:second], layers[second:]), channels)
    else:
        model = _classifier(name, weights)
        widths = (128, 256, 512) if name == "resnet18" else (512, 1024, 2048)
        stem = nn.Sequential(model.conv1, model.bn1, model.relu, model.maxpool, model.layer1, model.layer2)
        trunk = Trunk((stem, model.layer3, model.layer4), widths)
    if weights is None:
        set_norm_momentum(trunk, FROM_SCRATCH_MOMENTUM)
    return trunk


def vgg16_layers() -> nn.Sequential:
    """The convolutional layers of VGG16 from scratch; torchvision's whole model has 120 million weights more."""
    layers: nn.Sequential = make_layers(cfgs["D"])
    for layer in layers:
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return layers


def set_norm_momentum(module: nn.Module, momentum: float) -> None:
    """Let every batch normalisation inside ``module`` average its statistics with ``momentum``."""
    for child in module.modules():
        if isinstance(child, nn.BatchNorm2d):
            child.momentum = momentum


def _classifier(name: str, weights: Literal["imagenet"] | None) -> Any:
    torchvision_name = _TORCHVISION_NAMES.get(name, name)
    enum = None if weights is None else "DEFAULT"
    width = {"width_mult": _WIDTHS[name]} if name in _WIDTHS else {}
    try:
        return torchvision.models.get_model(torchvision_name, weights=enum, **width)
    except (OSError, RuntimeError) as error:
        # An unreachable server is an OSError, a download that breaks off fails its checksum with a RuntimeError.
        raise ConnectionError(
            f"expected to download torchvision's ImageNet weights of {torchvision_name}, got: {error}; "
            "put the file into $TORCH_HOME/hub/checkpoints, or train from scratch with weights: null"
        ) from error
