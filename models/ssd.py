"""The classic single-shot detectors: SSD300, SSD512 and SSDLite320, from scratch or from torchvision's COCO weights."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.models.detection import SSD300_VGG16_Weights, SSDLite320_MobileNet_V3_Large_Weights
from torchvision.models.detection.anchor_utils import DefaultBoxGenerator
from torchvision.models.detection.ssd import SSD, SSDFeatureExtractorVGG, SSDHead
from torchvision.models.detection.ssdlite import ssdlite320_mobilenet_v3_large

from tsuiseki.models.backbones import FROM_SCRATCH_MOMENTUM, Trunk, build_trunk, set_norm_momentum, vgg16_layers
from tsuiseki.models.detector import AnchorDetector, OneClass

CocoArchitecture = Literal["ssdlite320", "ssd300"]
# Logits of torchvision's COCO detectors beside the background: the ids run up to 90, with gaps.
COCO_CLASSES = 90
# Index of a person among them; 0 is the background.
COCO_PERSON = 1


def ssdlite320(classes: int = 1, state: dict[str, Tensor] | None = None, trunk: Trunk | None = None) -> AnchorDetector:
    """torchvision's SSDLite320 with a MobileNetV3 trunk (Howard et al. 2019).

    Args:
        classes: without the background.
        state: its state dict to start from.
        trunk: a ``mobilenet_v3_large`` whose weights to start from; its last layers are narrower here and start anew.
    """
    model = ssdlite320_mobilenet_v3_large(weights=None, weights_backbone=None, num_classes=classes + 1)
    if trunk is not None:
        weights = model.backbone.features.state_dict()
        pairs = zip(weights.items(), trunk.state_dict().values(), strict=True)
        weights.update({name: new for (name, old), new in pairs if old.shape == new.shape})
        model.backbone.features.load_state_dict(weights)
    elif state is None:
        set_norm_momentum(model, FROM_SCRATCH_MOMENTUM)
    return _from_torchvision(model, 320, classes, state)


def ssd300(classes: int = 1, state: dict[str, Tensor] | None = None, trunk: Trunk | None = None) -> AnchorDetector:
    """torchvision's SSD300 with a VGG16 trunk (Liu et al. 2016), from scratch, a state dict or a trunk."""
    layers = vgg16_layers() if trunk is None else nn.Sequential(*itertools.chain(*trunk.stages))
    generator = DefaultBoxGenerator(
        [[2], [2, 3], [2, 3], [2, 3], [2], [2]],
        scales=[0.07, 0.15, 0.33, 0.51, 0.69, 0.87, 1.05],
        steps=[8, 16, 32, 64, 100, 300],
    )
    head = SSDHead([512, 1024, 512, 256, 256, 256], generator.num_anchors_per_location(), classes + 1)
    model = SSD(SSDFeatureExtractorVGG(layers, highres=False), generator, (300, 300), classes + 1, head=head)
    return _from_torchvision(model, 300, classes, state)


def ssd512(classes: int = 1, trunk: Trunk | None = None) -> AnchorDetector:
    """SSD512 with a VGG16 trunk in the original layout: maps of 64, 32, 16, 8, 4, 2 and 1, 24,564 anchors.

    Liu et al. 2016; torchvision's ``highres`` extractor has other maps.
    """
    generator = DefaultBoxGenerator(
        [[2], [2, 3], [2, 3], [2, 3], [2, 3], [2], [2]],
        scales=[0.07, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05],
        steps=[8, 16, 32, 64, 128, 256, 512],
    )
    features = Vgg512(trunk or build_trunk("vgg16"))
    sides = [64, 32, 16, 8, 4, 2, 1]
    anchors = generator._grid_default_boxes([[s, s] for s in sides], [512, 512]) * 512
    counts = generator.num_anchors_per_location()
    class_heads = [_xavier_conv(c, n * (classes + 1)) for c, n in zip(features.channels, counts, strict=True)]
    box_heads = [_xavier_conv(c, n * 4) for c, n in zip(features.channels, counts, strict=True)]
    return AnchorDetector(features, class_heads, box_heads, anchors, classes, (512, 512))


class Vgg512(nn.Module):
    """The maps of SSD512: conv4_3 scaled to unit length times a learnt factor, fc7, and five of extra layers."""

    def __init__(self, trunk: Trunk) -> None:
        super().__init__()
        self.channels = (512, 1024, 512, 256, 256, 256, 256)
        self.conv4 = trunk.stages[0]
        self.conv5 = trunk.stages[1]
        self.scale = nn.Parameter(torch.full((512,), 20.0))
        self.fc = nn.Sequential(
            nn.MaxPool2d(kernel_size=3, stride=1, padding=1),
            nn.Conv2d(512, 1024, kernel_size=3, padding=6, dilation=6),
            nn.ReLU(inplace=True),
            nn.Conv2d(1024, 1024, kernel_size=1),
            nn.ReLU(inplace=True),
        )
        halving = [_extra(a, b) for a, b in itertools.pairwise(self.channels[1:6])]
        self.extra = nn.ModuleList([*halving, _extra(256, 256, kernel=4, stride=1)])

    def forward(self, images: Tensor) -> list[Tensor]:
        """``(B, 3, 512, 512)`` to seven maps ``(B, C, S, S)`` with S = 64, 32, 16, 8, 4, 2, 1."""
        x = self.conv4(images)
        maps = [self.scale.view(1, -1, 1, 1) * functional.normalize(x)]
        x = self.fc(self.conv5(x))
        maps.append(x)
        for block in self.extra:
            x = block(x)
            maps.append(x)
        return maps


class _TorchvisionMaps(nn.Module):
    def __init__(self, extractor: nn.Module) -> None:
        super().__init__()
        self.extractor = extractor

    def forward(self, images: Tensor) -> list[Tensor]:
        return list(self.extractor(images).values())


def _from_torchvision(model: SSD, side: int, classes: int, state: dict[str, Tensor] | None) -> AnchorDetector:
    if state is not None:
        model.load_state_dict(state)
    model.eval()
    with torch.no_grad():
        maps = list(model.backbone(torch.zeros(1, 3, side, side)).values())
    model.train()
    grid = [list(x.shape[-2:]) for x in maps]
    anchors = model.anchor_generator._grid_default_boxes(grid, [side, side]) * side
    class_heads = model.head.classification_head.module_list
    box_heads = model.head.regression_head.module_list
    return AnchorDetector(_TorchvisionMaps(model.backbone), class_heads, box_heads, anchors, classes, (side, side))


def _xavier_conv(inputs: int, outputs: int, kernel: int = 3, stride: int = 1, padding: int = 1) -> nn.Conv2d:
    layer = nn.Conv2d(inputs, outputs, kernel, stride, padding)
    nn.init.xavier_uniform_(layer.weight)
    nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return layer


def _extra(inputs: int, outputs: int, kernel: int = 3, stride: int = 2) -> nn.Sequential:
    middle = outputs // 2
    return nn.Sequential(
        _xavier_conv(inputs, middle, kernel=1, padding=0),
        nn.ReLU(inplace=True),
        _xavier_conv(middle, outputs, kernel=kernel, stride=stride),
        nn.ReLU(inplace=True),
    )


_BUILDERS = {"ssdlite320": ssdlite320, "ssd300": ssd300}
_WEIGHTS = {
    "ssdlite320": SSDLite320_MobileNet_V3_Large_Weights.COCO_V1,
    "ssd300": SSD300_VGG16_Weights.COCO_V1,
}


def coco_person_detector(architecture: CocoArchitecture, state: dict[str, Tensor] | Path | None = None) -> OneClass:
    """A COCO detector of which only people are left, each with exactly the probability that torchvision gives.

    Args:
        architecture: which of torchvision's detectors.
        state: its state dict, or the file of it; by default torchvision downloads that.

    Raises:
        ConnectionError: the weights are not on this machine and cannot be downloaded.
        ValueError: the state dict is of another network.
    """
    return OneClass(_coco_detector(architecture, state), class_index=COCO_PERSON)


def coco_start(architecture: CocoArchitecture, state: dict[str, Tensor] | Path | None = None) -> AnchorDetector:
    """A person detector to train on: everything of the COCO detector, of its class heads background and person.

    The arguments and errors are those of `coco_person_detector`.
    """
    many = _coco_detector(architecture, state)
    detector = _BUILDERS[architecture](1)
    weights = detector.state_dict()
    for name, values in many.state_dict().items():
        if values.shape == weights[name].shape:
            weights[name] = values
        else:
            rows = values.unflatten(0, (-1, COCO_CLASSES + 1))[:, [0, COCO_PERSON]]
            weights[name] = rows.flatten(0, 1)
    detector.load_state_dict(weights)
    return detector


def _coco_detector(architecture: CocoArchitecture, state: dict[str, Tensor] | Path | None) -> AnchorDetector:
    if state is None:
        state = _download(architecture)
    weights: dict[str, Tensor] = (
        torch.load(state, map_location="cpu", weights_only=True) if isinstance(state, Path) else state
    )
    try:
        return _BUILDERS[architecture](COCO_CLASSES, weights)
    except (RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(
            f"expected the state dict of torchvision's COCO-trained {architecture}; {str(error).splitlines()[0]}"
        ) from error


def _download(architecture: CocoArchitecture) -> dict[str, Tensor]:
    weights = _WEIGHTS[architecture]
    try:
        state: dict[str, Tensor] = weights.get_state_dict(progress=True, check_hash=True)
    except (OSError, RuntimeError) as error:
        raise ConnectionError(
            f"expected to download {weights.url}, got: {error}; "
            "put the file into $TORCH_HOME/hub/checkpoints, or give it with --state"
        ) from error
    return state
