"""The Siamese tracker: where in a search picture the target of a template picture is, and its box.

One trunk sees both pictures. Every cell of the template is compared with every cell of the search picture (pixel-wise
correlation, Yan et al., *Alpha-Refine*, CVPR 2021), so that a map a template cell comes out and convolutions learn how
the parts of a target lie to each other. Heads without anchors give for each cell a score and the distances to the four
sides of the box (SiamFC++, Xu et al., AAAI 2020).

The score is to be the overlap of the cell's own box with the target (quality focal loss, Li et al., *Generalized Focal
Loss*, NeurIPS 2020, eq. 5), as the area under the success curve asks for good boxes and not for certain ones. Only
cells near the middle of the target stand for it, so the map has one peak a target. All cells inside the target learn
the box by complete IoU (Zheng et al., *Distance-IoU Loss*, AAAI 2020, eq. 10): it is good even where the peak is off.

All but the template's side is convolutional: a search picture may have any side of 16 k - 1 pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import Conv2dNormActivation, complete_box_iou_loss

from tsuiseki.models.backbones import TRUNK_STRIDES, TrunkName, build_trunk
from tsuiseki.models.contract import NetworkCard
from tsuiseki.models.detector import separable
from tsuiseki.models.losses import paired_iou, quality_focal

# Side of the template, pixels: that of SiamFC and its successors.
TEMPLATE_SIDE = 127
# Side of the search picture, pixels, likewise.
SEARCH_SIDE = 255
# Pixels of a picture from one cell to the next.
STRIDE = TRUNK_STRIDES[1]
# Cells along a side of the template, without the first row and column: the others lie evenly about the middle.
TEMPLATE_CELLS = 7
# Cells about the middle of the template that show the target itself: it fills half of the side.
_INNER = slice(2, 5)
# Share of the target's width and height, about its middle, whose cells stand for it: more would blur the peak.
CORE = 0.5
# Chance of the target that an untrained head claims: without it the empty cells swamp the first steps.
_PRIOR = 0.02
# Largest logarithm of a distance in cells: boxes grow to twice the picture and not to infinity.
_LARGEST = math.log(2 * SEARCH_SIDE / STRIDE)
# Weight of the box term.
BOX_WEIGHT = 2.0

# Logits ``(B, 1, S, S)`` and distances ``(B, 4, S, S)``.
Heads: TypeAlias = tuple[Tensor, Tensor]


class TrackerNetwork(nn.Module):
    """Template and search pictures in, scores and boxes out.

    Args:
        trunk: its name.
        channels: of what is compared.

    Attributes:
        card: of the search picture.
    """

    def __init__(self, trunk: TrunkName = "mobilenet_v3_small", channels: int = 64) -> None:
        super().__init__()
        settings = {"stride": STRIDE, "trunk": trunk, "channels": channels}
        self.card = NetworkCard("siamese", SEARCH_SIDE, SEARCH_SIDE, resize="stretch", settings=settings)
        whole = build_trunk(trunk)
        # The last stage is too coarse to say where a target is.
        self.trunk = nn.ModuleList(whole.stages[:2])
        fine, coarse = whole.channels[:2]
        self.channels = channels
        self.lateral = _plain(fine, channels, stride=2)
        self.neck = _plain(coarse, channels)
        self.patterns = _wide(TEMPLATE_CELLS**2, channels)
        self.likeness = _active(channels, channels)
        self.merge = _active(3 * channels, channels)
        self.tower = nn.Sequential(_wide(channels, channels), _wide(channels, channels))
        self.score_branch, self.box_branch = separable(channels, channels), separable(channels, channels)
        self.score_head, self.box_head = nn.Conv2d(channels, 1, 1), nn.Conv2d(channels, 4, 1)
        for head in (self.score_head, self.box_head):
            nn.init.normal_(head.weight, std=0.01)
        nn.init.constant_(self.score_head.bias, -math.log((1 - _PRIOR) / _PRIOR))  # type: ignore[arg-type]
        # A target is four cells wide.
        nn.init.constant_(self.box_head.bias, math.log(2.0))  # type: ignore[arg-type]

    def describe(self, images: Tensor) -> Tensor:
        """``(B, 3, side, side)`` normalised pictures to ``(B, channels, cells, cells)``, every cell of unit length."""
        fine = self.trunk[0](images)
        features = self.neck(self.trunk[1](fine)) + self.lateral(fine)
        return functional.normalize(features[..., 1:, 1:], dim=1)

    def locate(self, template: Tensor, search: Tensor) -> Heads:
        """Logits ``(B, 1, S, S)`` and distances left, top, right, bottom ``(B, 4, S, S)``, pixels, from `describe`."""
        batch, _, rows, columns = search.shape
        alike = torch.matmul(template.flatten(2).transpose(1, 2), search.flatten(2))
        patterns = self.patterns(alike.view(batch, TEMPLATE_CELLS**2, rows, columns))
        inner = template[:, :, _INNER, _INNER].mean(dim=(2, 3), keepdim=True)
        likeness = self.likeness(search * inner * self.channels)
        merged = self.tower(self.merge(torch.cat((patterns, likeness, search), dim=1)))
        distances = self.box_head(self.box_branch(merged)).clamp(max=_LARGEST).exp() * STRIDE
        return self.score_head(self.score_branch(merged)), distances

    def forward(self, template: Tensor, search: Tensor) -> Heads:
        """Heads of normalised pictures ``(B, 3, 127, 127)`` and ``(B, 3, 255, 255)``; see `locate`."""
        return self.locate(self.describe(template), self.describe(search))

    def loss(self, heads: Heads, boxes: Tensor, present: Tensor) -> dict[str, Tensor]:
        """Score loss and box loss; see `tracker_loss`."""
        return tracker_loss(*heads, boxes, present)


class TemplatePart(nn.Module):
    """Half of a ``network``, as a file: a template picture to its features."""

    def __init__(self, network: TrackerNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, template: Tensor) -> Tensor:
        """``(B, 3, 127, 127)`` to ``(B, channels, 7, 7)``."""
        return self.network.describe(template)


class SearchPart(nn.Module):
    """The other half: features of the template and a search picture to scores in [0, 1] and boxes."""

    def __init__(self, network: TrackerNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, features: Tensor, search: Tensor) -> tuple[Tensor, Tensor]:
        """``(B, 1, S, S)`` scores, and ``(B, 4, S, S)`` distances of the sides from each cell's centre, pixels."""
        logits, distances = self.network.locate(features, self.network.describe(search))
        return logits.sigmoid(), distances


def cell_centres(cells: int) -> Tensor:
    """``(2, cells, cells)`` x and y of the cells of a picture, continuous pixels, evenly about its middle."""
    side = STRIDE * (cells + 1) - 1
    along = side / 2 + (torch.arange(cells, dtype=torch.float32) - (cells - 1) / 2) * STRIDE
    return torch.stack((along.expand(cells, cells), along[:, None].expand(cells, cells)))


def corner_boxes(distances: Tensor, centres: Tensor) -> Tensor:
    """``(B, 4, S, S)`` x1, y1, x2, y2 of the boxes whose sides are so far from the ``centres`` ``(2, S, S)``."""
    return torch.cat((centres - distances[:, :2], centres + distances[:, 2:]), dim=1)


def cells_of_targets(centres: Tensor, boxes: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
    """Which cells stand for the target, and which lie inside it, each ``(B, S, S)`` bool.

    The cell next to the middle always stands for a target in the picture, however small that is.

    Args:
        centres: ``(2, S, S)`` of the cells.
        boxes: ``(B, 4)`` x1, y1, x2, y2.
        present: ``(B,)`` bool, the target is in the picture.
    """
    middle, half = (boxes[:, 2:] + boxes[:, :2]) / 2, (boxes[:, 2:] - boxes[:, :2]) / 2
    off = (centres - middle[:, :, None, None]).abs()
    relative = (off / half[:, :, None, None].clamp(min=1e-6)).amax(dim=1)
    nearest = off.square().sum(dim=1).flatten(1)
    nearest = nearest == nearest.amin(dim=1, keepdim=True)
    there = present[:, None, None]
    core = (relative <= CORE) | nearest.view_as(relative)
    return core & there, ((relative <= 1) | core) & there


def tracker_loss(logits: Tensor, distances: Tensor, boxes: Tensor, present: Tensor) -> dict[str, Tensor]:
    """Quality focal loss of all scores, and complete IoU loss of the boxes of all cells inside a target.

    Both are sums over the batch, divided by the number of cells that stand for, or lie in, a target.

    Args:
        logits: ``(B, 1, S, S)``.
        distances: ``(B, 4, S, S)``.
        boxes: ``(B, 4)`` in the search picture, pixels; any where the target is absent.
        present: ``(B,)`` bool.
    """
    centres = cell_centres(logits.shape[-1]).to(boxes.device)
    core, inside = cells_of_targets(centres, boxes, present)
    # Overlaps of half precision are too coarse.
    logits, distances = logits.float(), distances.float()
    corners = corner_boxes(distances, centres).permute(0, 2, 3, 1)
    truth = boxes[:, None, None].expand_as(corners)
    quality = torch.zeros_like(logits[:, 0])
    quality[core] = paired_iou(corners.detach()[core], truth[core])
    score_loss = quality_focal(logits[:, 0], quality).sum() / core.sum().clamp(min=1)
    box_loss = complete_box_iou_loss(corners[inside], truth[inside], reduction="sum") / inside.sum().clamp(min=1)
    return {"score_loss": score_loss, "box_loss": BOX_WEIGHT * box_loss}


def best_boxes(heads: Heads) -> tuple[Tensor, Tensor]:
    """The box ``(B, 4)`` of the cell with the highest score, and that score ``(B,)`` in [0, 1]."""
    logits, distances = heads
    score, cell = logits.flatten(1).max(dim=1)
    corners = corner_boxes(distances.float(), cell_centres(logits.shape[-1]).to(logits.device)).flatten(2)
    return corners.gather(2, cell[:, None, None].expand(-1, 4, 1))[..., 0], score.float().sigmoid()


def _plain(inputs: int, outputs: int, stride: int = 1) -> nn.Module:
    layer: nn.Module = Conv2dNormActivation(inputs, outputs, 2 * stride - 1, stride, activation_layer=None)
    return layer


def _active(inputs: int, outputs: int) -> nn.Module:
    layer: nn.Module = Conv2dNormActivation(inputs, outputs, kernel_size=1, activation_layer=nn.ReLU6)
    return layer


def _wide(inputs: int, outputs: int) -> nn.Sequential:
    """Depthwise 5x5 and pointwise convolution: a target is about that many cells wide."""
    parts: Sequence[nn.Module] = (
        Conv2dNormActivation(inputs, inputs, kernel_size=5, groups=inputs, activation_layer=None),
        _active(inputs, outputs),
    )
    return nn.Sequential(*parts)
