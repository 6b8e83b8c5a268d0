"""Losses that care for the overlap of boxes: complete IoU for places, quality focal loss for scores.

Zheng et al., *Distance-IoU Loss*, AAAI 2020, eq. 8 to 11; Li et al., *Generalized Focal Loss*, NeurIPS 2020, eq. 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional
from torchvision.ops import complete_box_iou_loss

from tsuiseki.models.anchors import decode
from tsuiseki.models.losses import Matches


def complete_iou(offsets: Tensor, anchors: Tensor, boxes: Tensor) -> Tensor:
    """Summed complete IoU loss of the boxes that ``offsets`` make of ``anchors`` (centre form); all ``(P, 4)``."""
    loss: Tensor = complete_box_iou_loss(decode(offsets, anchors), boxes, reduction="sum")
    return loss


@dataclass(frozen=True)
class QualityFocal:
    """A score that is to be the IoU of its own box, 0 where there is nobody.

    No negatives are chosen: the focal factor leaves the easy ones without weight.

    Attributes:
        focus: exponent of the distance between score and quality.
    """

    focus: float = 2.0

    def __call__(self, logits: Tensor, matches: Matches, overlap: Tensor) -> Tensor:
        """The sum over all anchors that are not neutral.

        Args:
            logits: ``(B, A, 2)``: the score is the sigmoid of their difference.
            matches: what the anchors stand for.
            overlap: ``(P,)`` IoU of the positive anchors' boxes.
        """
        quality = torch.zeros_like(matches.positive, dtype=torch.float32)
        quality[matches.positive] = overlap
        focal = quality_focal(logits[..., 1] - logits[..., 0], quality, self.focus)
        return focal[~matches.neutral].sum()


def quality_focal(margin: Tensor, quality: Tensor, focus: float = 2.0) -> Tensor:
    """Quality focal loss of each score, the sigmoid of ``margin``, that is to be ``quality`` in [0, 1]; same shapes."""
    entropy = functional.binary_cross_entropy_with_logits(margin, quality, reduction="none")
    return entropy * (margin.sigmoid() - quality).abs() ** focus
