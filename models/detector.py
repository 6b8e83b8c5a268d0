"""Single-shot detectors under one interface, and the default one, which sees small people.

Images in, class logits and box offsets of fixed anchors out. `tsuiseki.models.ssd` has the classic ones.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import Conv2dNormActivation

from tsuiseki.models.anchors import VARIANCES, AnchorSizes, decode, grid_anchors
from tsuiseki.models.backbones import Trunk
from tsuiseki.models.contract import NetworkCard
from tsuiseki.models.losses import DetectionLoss, complete_iou, overlap_focal

# Chance of a person at an anchor that an untrained detector claims: without it the negatives swamp the first steps.
_PRIOR = 0.02


class AnchorDetector(nn.Module):
    """Feature maps, and on each a class head and a box head; a `DetectorNetwork`.

    Args:
        features: images to a list of maps, in the order of the heads.
        class_heads: each from a map to ``K * (classes + 1)`` channels, anchor-major.
        box_heads: each from a map to ``K * 4`` channels, anchor-major.
        anchors: ``(A, 4)`` centre x, centre y, width, height in input pixels; map, row, column, anchor.
        classes: without the background.
        size: height and width of the input.

    Attributes:
        card: by default of people, in letterboxed pictures.
        criterion: what `loss` sums up.
    """

    anchors: Tensor

    def __init__(
        self,
        features: nn.Module,
        class_heads: Iterable[nn.Module],
        box_heads: Iterable[nn.Module],
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
        names = ("person",) if classes == 1 else tuple(f"class {n + 1}" for n in range(classes))
        self.card = NetworkCard("anchors", *size, names, settings={"variances": list(VARIANCES)})
        self.criterion = DetectionLoss(overlap_focal, complete_iou, box_weight=2.0)
        self.register_buffer("anchors", anchors, persistent=False)

    def decode(self, outputs: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """Boxes ``(B, A, 4)`` in input pixels and scores ``(B, A, classes)`` of the raw heads; see `decode_heads`."""
        return decode_heads(*outputs, self.anchors)

    def loss(self, outputs: tuple[Tensor, Tensor], boxes: Tensor, labels: Tensor) -> dict[str, Tensor]:
        """Class loss and box loss; see `DetectionLoss`."""
        class_loss, box_loss = self.criterion(*outputs, self.anchors, boxes, labels)
        return {"class_loss": class_loss, "box_loss": box_loss}

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Raw heads of normalised images.

        Args:
            images: ``(B, 3, H, W)`` float32.

        Returns:
            logits ``(B, A, classes + 1)``, background first, and offsets ``(B, A, 4)`` in the box code.
        """
        return self.heads(self.features(images))

    def heads(self, maps: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Raw heads of the feature maps of images; see `forward`."""
        logits = [_rows(head(x), self.classes + 1) for head, x in zip(self.class_heads, maps, strict=True)]
        offsets = [_rows(head(x), 4) for head, x in zip(self.box_heads, maps, strict=True)]
        return torch.cat(logits, dim=1), torch.cat(offsets, dim=1)


def decode_heads(logits: Tensor, offsets: Tensor, anchors: Tensor) -> tuple[Tensor, Tensor]:
    """Boxes and scores of raw heads.

    Args:
        logits: ``(B, A, C + 1)``, background first.
        offsets: ``(B, A, 4)`` in the box code.
        anchors: ``(A, 4)`` centre form.

    Returns:
        boxes ``(B, A, 4)`` in input pixels, and scores ``(B, A, C)`` in [0, 1].
    """
    return decode(offsets.float(), anchors), logits.float().softmax(dim=-1)[..., 1:]


class OneClass(nn.Module):
    """A detector of many classes that keeps one of them.

    Everything else, the other classes too, becomes background: its logit is the log of the sum of their exponentials,
    which leaves the softmax probability of the kept class exactly as it was.

    Args:
        detector: of many classes.
        class_index: index of the class that stays among the logits; 0 is the background.
    """

    anchors: Tensor

    def __init__(self, detector: AnchorDetector, class_index: int) -> None:
        super().__init__()
        self.detector = detector
        self.class_index = class_index
        self.classes = 1
        self.size = detector.size
        self.register_buffer("anchors", detector.anchors, persistent=False)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """As `AnchorDetector.forward`, with logits ``(B, A, 2)``."""
        logits, offsets = self.detector(images)
        others = torch.cat((logits[..., : self.class_index], logits[..., self.class_index + 1 :]), dim=-1)
        score = logits[..., self.class_index : self.class_index + 1]
        return torch.cat((torch.logsumexp(others, dim=-1, keepdim=True), score), dim=-1), offsets


class TopDown(nn.Module):
    """Feature pyramid over a trunk (Lin et al. 2017) of separable convolutions, so that fine maps know the context.

    Args:
        trunk: gives maps at strides 8, 16 and 32.
        width: channels of every map that comes out.
        levels: 3 for strides 8 to 32; 4 adds stride 64.
        depth: convolutions on each map.
    """

    def __init__(self, trunk: Trunk, width: int, levels: int, depth: int = 1) -> None:
        super().__init__()
        self.trunk = trunk
        self.lateral = nn.ModuleList(
            [Conv2dNormActivation(c, width, kernel_size=1, activation_layer=None) for c in trunk.channels]
        )
        self.smooth = nn.ModuleList(
            [nn.Sequential(*(x for _ in range(depth) for x in separable(width, width))) for _ in trunk.channels]
        )
        self.coarser = nn.ModuleList([separable(width, width, stride=2) for _ in range(levels - len(trunk.channels))])

    def forward(self, images: Tensor) -> list[Tensor]:
        """``(B, 3, H, W)`` to maps ``(B, width, ceil(H / S), ceil(W / S))``, finest first."""
        return self.merged(self.trunk(images))

    def merged(self, trunk_maps: Sequence[Tensor]) -> list[Tensor]:
        """Maps of `forward` from those of the trunk, ``(B, C, H, W)`` each, finest first."""
        maps = [lateral(x) for lateral, x in zip(self.lateral, trunk_maps, strict=True)]
        for i in range(len(maps) - 1, 0, -1):
            maps[i - 1] = maps[i - 1] + functional.interpolate(maps[i], size=maps[i - 1].shape[-2:], mode="nearest")
        maps = [smooth(x) for smooth, x in zip(self.smooth, maps, strict=True)]
        for coarser in self.coarser:
            maps.append(coarser(maps[-1]))
        return maps


class BranchedDetector(AnchorDetector):
    """A trained detector, which stays as it is, and beside it one for boxes of other shapes, which learns.

    Both see the first stage of one trunk. The branch has later stages of its own, at half the resolution, and so has
    strides of 16, 32 and 64: wide boxes are large, and this takes a quarter of the time.

    Args:
        people: that stays.
        branch: its trunk has the stages of that of ``people``, without the first.

    Attributes:
        halved: from the map of the first stage to what the branch sees.
    """

    features: TopDown

    def __init__(self, people: AnchorDetector, branch: AnchorDetector) -> None:
        anchors = torch.cat((people.anchors, branch.anchors))
        super().__init__(people.features, people.class_heads, people.box_heads, anchors, people.classes, people.size)
        self.requires_grad_(False)
        self.branch = branch
        pyramid: Any = people.features
        channels = pyramid.trunk.channels[0]
        self.halved = nn.Conv2d(channels, channels, kernel_size=3, stride=2, padding=1)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """As `AnchorDetector.forward`, the anchors of the branch last."""
        maps = self.features.trunk(images)
        pyramid: Any = self.branch.features
        first = self.halved(maps[0])
        beside = self.branch.heads(pyramid.merged([first, *pyramid.trunk(first)]))
        logits, offsets = self.heads(self.features.merged(maps))
        return torch.cat((logits, beside[0]), dim=1), torch.cat((offsets, beside[1]), dim=1)

    def begin(self) -> None:
        """Let the branch begin with the trunk's later stages on every second cell, and its normalisations anew."""
        nn.init.dirac_(self.halved.weight)
        nn.init.zeros_(self.halved.bias)  # type: ignore[arg-type]
        for part in self.branch.modules():
            if isinstance(part, nn.BatchNorm2d):
                part.reset_parameters()
        pyramid: Any = self.branch.features
        pyramid.trunk.stages.load_state_dict(self.features.trunk.stages[1:].state_dict())

    def train(self, mode: bool = True) -> BranchedDetector:
        """Train the branch; all other normalisations keep their statistics."""
        super().train(False)
        self.branch.train(mode)
        return self


def people_detector(
    trunk: Trunk, size: tuple[int, int], anchor_sizes: AnchorSizes, width: int = 96, classes: int = 1
) -> AnchorDetector:
    """SSDLite that sees small people: stride 8 by a top-down path, an input of any shape, anchors as given.

    Args:
        trunk: gives maps at strides 8, 16 and 32.
        size: height and width of the input, pixels.
        anchor_sizes: ``(w, h)`` in input pixels of the anchors at strides 8, 16, 32 and, where there are four, 64.
        width: channels of the top-down path.
        classes: without the background.

    Raises:
        ValueError: the anchors are for another number of maps, or the size is no multiple of the coarsest stride.
    """
    strides = [8, 16, 32, 64][: len(anchor_sizes)]
    if not 3 <= len(anchor_sizes) <= 4 or any(s % strides[-1] for s in size):
        raise ValueError(
            f"expected anchors for 3 or 4 maps and an input whose sides divide by {strides[-1]}; "
            f"got anchors for {len(anchor_sizes)} maps and {size[1]}x{size[0]}"
        )
    features = TopDown(trunk, width, len(anchor_sizes))
    return _with_heads(features, size, strides, anchor_sizes, width, classes)


def branched_detector(trunk: Trunk, size: tuple[int, int], anchor_sizes: AnchorSizes, width: int) -> BranchedDetector:
    """A `people_detector` of three maps and 96 channels, and a branch beside it.

    Args:
        trunk: of the `people_detector`; the branch has copies of its later stages.
        size: see `people_detector`.
        anchor_sizes: those of the `people_detector` at strides 8, 16 and 32, then those of the branch at 16, 32 and 64.
        width: channels of the top-down path of the branch.

    Raises:
        ValueError: the anchors are not for six maps, or the size is no multiple of 32.
    """
    if len(anchor_sizes) != 6:
        raise ValueError(
            "expected anchors for 6 maps, 3 of the detector that stays and 3 of the branch; "
            f"got them for {len(anchor_sizes)}"
        )
    people, stages = people_detector(trunk, size, anchor_sizes[:3]), copy.deepcopy(list(trunk.stages[1:]))
    features = TopDown(trunk, width, 3, depth=2)
    # The pyramid takes the first map of the trunk of `people`, too.
    features.trunk = Trunk(stages, trunk.channels[1:])
    return BranchedDetector(people, _with_heads(features, size, [16, 32, 64], anchor_sizes[3:], width, 1))


def _with_heads(
    features: TopDown,
    size: tuple[int, int],
    strides: Sequence[int],
    anchor_sizes: AnchorSizes,
    width: int,
    classes: int,
) -> AnchorDetector:
    anchors = grid_anchors([(-(-size[0] // s), -(-size[1] // s)) for s in strides], strides, anchor_sizes)
    class_heads = [_lite_head(width, len(shapes) * (classes + 1)) for shapes in anchor_sizes]
    box_heads = [_lite_head(width, len(shapes) * 4) for shapes in anchor_sizes]
    for head in class_heads:
        bias: Any = head[-1].bias
        bias.data.view(-1, classes + 1)[:, 0] = float(torch.logit(torch.tensor(1 - _PRIOR)))
    return AnchorDetector(features, class_heads, box_heads, anchors, classes, size)


def separable(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """Depthwise 3x3 and pointwise convolution, each with batch normalisation and ReLU6."""
    return nn.Sequential(
        Conv2dNormActivation(
            inputs, inputs, kernel_size=3, stride=stride, groups=inputs, activation_layer=nn.ReLU6, inplace=True
        ),
        Conv2dNormActivation(inputs, outputs, kernel_size=1, activation_layer=nn.ReLU6, inplace=True),
    )


def _lite_head(width: int, outputs: int) -> nn.Sequential:
    block: nn.Module = Conv2dNormActivation(width, width, kernel_size=3, groups=width, activation_layer=nn.ReLU6)
    last = nn.Conv2d(width, outputs, kernel_size=1)
    nn.init.normal_(last.weight, std=0.03)
    nn.init.zeros_(last.bias)  # type: ignore[arg-type]
    return nn.Sequential(block, last)


def _rows(output: Tensor, columns: int) -> Tensor:
    """``(B, K * columns, H, W)`` to ``(B, H * W * K, columns)``."""
    batch, _, height, width = output.shape
    return output.view(batch, -1, columns, height, width).permute(0, 3, 4, 1, 2).reshape(batch, -1, columns)
