"""Losses that care for the overlap of boxes: complete IoU for places, quality focal loss for scores.

Zheng et al., *Distance-IoU Loss*, AAAI 2020, eq. 8 to 11; Li et al., *Generalized Focal Loss*, NeurIPS 2020, eq. 5.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import complete_box_iou_loss

from tsuiseki.models.anchors import decode
from tsuiseki.models.losses import match_anchors


class QualityLoss(nn.Module):
    """Complete IoU on the boxes of positive anchors; a score that is to be the IoU of its own box, 0 elsewhere.

    Takes and gives what `MultiBoxLoss` does, so that either can train a detector. No negatives are chosen: the focal
    factor leaves the easy ones without weight.

    Args:
        threshold: on the IoU from which an anchor stands for a box.
        box_weight: of the box term in the sum.
        focus: exponent of the distance between score and quality.
    """

    def __init__(self, threshold: float = 0.5, box_weight: float = 2.0, focus: float = 2.0) -> None:
        super().__init__()
        self.threshold = threshold
        self.box_weight = box_weight
        self.focus = focus

    def forward(
        self, logits: Tensor, offsets: Tensor, anchors: Tensor, boxes: Tensor, labels: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Score loss and box loss, scalars; see `MultiBoxLoss.forward` for the arguments.

        ``logits`` must be of one class, ``(B, A, 2)``: the score is the sigmoid of their difference.
        """
        matches = match_anchors(anchors, boxes, labels, self.threshold)
        image, anchor = matches.positive.nonzero(as_tuple=True)
        found = decode(offsets.float()[image, anchor], anchors[anchor])
        wanted = boxes[image, matches.box[image, anchor]]
        count = max(len(image), 1)
        box_loss = complete_box_iou_loss(found, wanted, reduction="sum") / count
        quality = torch.zeros_like(matches.positive, dtype=torch.float32)
        quality[image, anchor] = _paired_iou(found.detach(), wanted)
        margin = logits.float()[..., 1] - logits.float()[..., 0]
        entropy = functional.binary_cross_entropy_with_logits(margin, quality, reduction="none")
        focal = entropy * (margin.sigmoid() - quality).abs() ** self.focus
        return focal[~matches.neutral].sum() / count, self.box_weight * box_loss


def _paired_iou(a: Tensor, b: Tensor) -> Tensor:
    """``(N,)`` intersection over union of ``(N, 4)`` boxes with ``(N, 4)`` ones, row by row."""
    shared = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0).prod(dim=1)
    area_a, area_b = (a[:, 2:] - a[:, :2]).prod(dim=1), (b[:, 2:] - b[:, :2]).prod(dim=1)
    return shared / (area_a + area_b - shared).clamp(min=1e-6)
