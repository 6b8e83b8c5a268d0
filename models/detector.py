"""The SSD family under one interface: images in, class logits and box offsets of fixed anchors out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.models.detection.anchor_utils import DefaultBoxGenerator
from torchvision.models.detection.ssd import SSD, SSDFeatureExtractorVGG, SSDHead
from torchvision.models.detection.ssdlite import ssdlite320_mobilenet_v3_large
from torchvision.ops import Conv2dNormActivation

from tsuiseki.models.anchors import AnchorSizes, grid_anchors
from tsuiseki.models.backbones import FROM_SCRATCH_MOMENTUM, Trunk, build_trunk, set_norm_momentum, vgg16_layers

# Chance of a person at an anchor that an untrained detector claims: without it the negatives swamp the first steps.
_PRIOR = 0.02


class Detector(nn.Module):
    """Feature maps, and on each a class head and a box head.

    Args:
        features: images to a list of maps, in the order of the heads.
        class_heads: each from a map to ``K * (classes + 1)`` channels, anchor-major.
        box_heads: each from a map to ``K * 4`` channels, anchor-major.
        anchors: ``(A, 4)`` centre x, centre y, width, height in input pixels; map, row, column, anchor.
        classes: without the background.
        size: height and width of the input.
    """

    anchors: Tensor

    def __init__(
        self,
        features: nn.Module,
        class_heads: Sequence[nn.Module],
        box_heads: Sequence[nn.Module],
        anchors: Tensor,
        classes: int,
        size: tuple[int, int],
    ) -> None:
        super().__init__()
        self.features = features
        self.class_heads = nn.ModuleList(class_heads)
        self.box_heads = nn.ModuleList(box_heads)
        self.classes = classes
        self.size = size
        self.register_buffer("anchors", anchors, persistent=False)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Raw heads of normalised images.

        Args:
            images: ``(B, 3, H, W)`` float32.

        Returns:
            logits ``(B, A, classes + 1)``, background first, and offsets ``(B, A, 4)`` in the box code.
        """
        maps = self.features(images)
        logits = [_rows(head(x), self.classes + 1) for head, x in zip(self.class_heads, maps, strict=True)]
        offsets = [_rows(head(x), 4) for head, x in zip(self.box_heads, maps, strict=True)]
        return torch.cat(logits, dim=1), torch.cat(offsets, dim=1)


class OneClass(nn.Module):
    """A detector of many classes that keeps one of them.

    Everything else, the other classes too, becomes background: its logit is the log of the sum of their exponentials,
    which leaves the softmax probability of the kept class exactly as it was.

    Args:
        detector: of many classes.
        kept: index of the kept class among the logits; 0 is the background.
    """

    anchors: Tensor

    def __init__(self, detector: Detector, kept: int) -> None:
        super().__init__()
        self.detector = detector
        self.kept = kept
        self.classes = 1
        self.size = detector.size
        self.register_buffer("anchors", detector.anchors, persistent=False)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """As `Detector.forward`, with logits ``(B, A, 2)``."""
        logits, offsets = self.detector(images)
        others = torch.cat((logits[..., : self.kept], logits[..., self.kept + 1 :]), dim=-1)
        kept = logits[..., self.kept : self.kept + 1]
        return torch.cat((torch.logsumexp(others, dim=-1, keepdim=True), kept), dim=-1), offsets


class TopDown(nn.Module):
    """Feature pyramid over a trunk (Lin et al. 2017) of separable convolutions, so that fine maps know the context.

    Args:
        trunk: gives maps at strides 8, 16 and 32.
        width: channels of every map that comes out.
        levels: 3 for strides 8 to 32; 4 adds stride 64.
    """

    def __init__(self, trunk: Trunk, width: int, levels: int) -> None:
        super().__init__()
        self.trunk = trunk
        self.lateral = nn.ModuleList(
            [Conv2dNormActivation(c, width, kernel_size=1, activation_layer=None) for c in trunk.channels]
        )
        self.smooth = nn.ModuleList([separable(width, width) for _ in trunk.channels])
        self.coarser = nn.ModuleList([separable(width, width, stride=2) for _ in range(levels - len(trunk.channels))])

    def forward(self, images: Tensor) -> list[Tensor]:
        """``(B, 3, H, W)`` to maps ``(B, width, ceil(H / S), ceil(W / S))``, finest first."""
        maps = [lateral(x) for lateral, x in zip(self.lateral, self.trunk(images), strict=True)]
        for i in range(len(maps) - 1, 0, -1):
            maps[i - 1] = maps[i - 1] + functional.interpolate(maps[i], size=maps[i - 1].shape[-2:], mode="nearest")
        maps = [smooth(x) for smooth, x in zip(self.smooth, maps, strict=True)]
        for coarser in self.coarser:
            maps.append(coarser(maps[-1]))
        return maps


def people_detector(trunk: Trunk, size: tuple[int, int], anchor_sizes: AnchorSizes, width: int = 96) -> Detector:
    """SSDLite that sees small people: stride 8 by a top-down path, an input of any shape, anchors as given.

    Args:
        trunk: gives maps at strides 8, 16 and 32.
        size: height and width of the input, pixels.
        anchor_sizes: ``(w, h)`` in input pixels of the anchors at strides 8, 16, 32 and, where there are four, 64.
        width: channels of the top-down path.

    Raises:
        ValueError: the anchors are for another number of maps, or the size is no multiple of the coarsest stride.
    """
    strides = [8, 16, 32, 64][: len(anchor_sizes)]
    if not 3 <= len(anchor_sizes) <= 4 or any(s % strides[-1] for s in size):
        raise ValueError(
            f"expected anchors for 3 or 4 maps and an input whose sides divide by {strides[-1]}; "
            f"got anchors for {len(anchor_sizes)} maps and {size[1]}x{size[0]}"
        )
    anchors = grid_anchors([(size[0] // s, size[1] // s) for s in strides], strides, anchor_sizes)
    class_heads = [_lite_head(width, len(shapes) * 2) for shapes in anchor_sizes]
    box_heads = [_lite_head(width, len(shapes) * 4) for shapes in anchor_sizes]
    for head in class_heads:
        _set_prior(head[-1], classes=1)
    return Detector(TopDown(trunk, width, len(anchor_sizes)), class_heads, box_heads, anchors, 1, size)


def ssdlite320(classes: int = 1, state: dict[str, Tensor] | None = None) -> Detector:
    """torchvision's SSDLite320 with a MobileNetV3 trunk (Howard et al. 2019), optionally with its state dict."""
    model = ssdlite320_mobilenet_v3_large(weights=None, weights_backbone=None, num_classes=classes + 1)
    if state is None:
        set_norm_momentum(model, FROM_SCRATCH_MOMENTUM)
    return _from_torchvision(model, 320, classes, state)


def ssd300(classes: int = 1, state: dict[str, Tensor] | None = None) -> Detector:
    """torchvision's SSD300 with a VGG16 trunk (Liu et al. 2016), optionally with its state dict."""
    generator = DefaultBoxGenerator(
        [[2], [2, 3], [2, 3], [2, 3], [2], [2]],
        scales=[0.07, 0.15, 0.33, 0.51, 0.69, 0.87, 1.05],
        steps=[8, 16, 32, 64, 100, 300],
    )
    head = SSDHead([512, 1024, 512, 256, 256, 256], generator.num_anchors_per_location(), classes + 1)
    model = SSD(SSDFeatureExtractorVGG(vgg16_layers(), highres=False), generator, (300, 300), classes + 1, head=head)
    return _from_torchvision(model, 300, classes, state)


def ssd512(classes: int = 1, trunk: Trunk | None = None) -> Detector:
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
    return Detector(features, class_heads, box_heads, anchors, classes, (512, 512))


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
        halving = [_extra(a, b) for a, b in pairwise(self.channels[1:6])]
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


def separable(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """Depthwise 3x3 and pointwise convolution, each with batch normalisation and ReLU6."""
    return nn.Sequential(
        Conv2dNormActivation(
            inputs, inputs, kernel_size=3, stride=stride, groups=inputs, activation_layer=nn.ReLU6, inplace=True
        ),
        Conv2dNormActivation(inputs, outputs, kernel_size=1, activation_layer=nn.ReLU6, inplace=True),
    )


def _from_torchvision(model: SSD, side: int, classes: int, state: dict[str, Tensor] | None) -> Detector:
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
    return Detector(_TorchvisionMaps(model.backbone), class_heads, box_heads, anchors, classes, (side, side))


def _lite_head(width: int, outputs: int) -> nn.Sequential:
    block: nn.Module = Conv2dNormActivation(width, width, kernel_size=3, groups=width, activation_layer=nn.ReLU6)
    last = nn.Conv2d(width, outputs, kernel_size=1)
    nn.init.normal_(last.weight, std=0.03)
    nn.init.zeros_(last.bias)  # type: ignore[arg-type]
    return nn.Sequential(block, last)


def _set_prior(convolution: nn.Module, classes: int) -> None:
    bias = convolution.bias
    assert isinstance(bias, nn.Parameter)
    with torch.no_grad():
        bias.view(-1, classes + 1)[:, 0] = float(torch.logit(torch.tensor(1 - _PRIOR)))


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


def _rows(output: Tensor, columns: int) -> Tensor:
    """``(B, K * columns, H, W)`` to ``(B, H * W * K, columns)``."""
    batch, _, height, width = output.shape
    return output.view(batch, -1, columns, height, width).permute(0, 3, 4, 1, 2).reshape(batch, -1, columns)
