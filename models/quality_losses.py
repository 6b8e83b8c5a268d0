"""Losses that care for the overlap of boxes, towards labels or towards what a teacher detects.

Complete IoU is for places: Zheng et al., *Distance-IoU Loss*, AAAI 2020, eq. 8 to 11. Quality focal loss is for scores:
Li et al., *Generalized Focal Loss*, NeurIPS 2020, eq. 5. Hinton et al., *Distilling the Knowledge in a Neural Network*,
2015, teach by the soft outputs of a classifier; that it is a detector here is ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import complete_box_iou_loss

from tsuiseki.models.anchors import decode
from tsuiseki.models.losses import Matches

# Anchors that the teacher takes for background teach no boxes.
_LEAST_SCORE = 0.1


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


@dataclass(frozen=True)
class SoftTargets:
    """What a teacher detects at each of its anchors.

    Attributes:
        scores: ``(B, A)`` of a person, in [0, 1].
        offsets: ``(B, A, 4)`` in the box code.
    """

    scores: Tensor
    offsets: Tensor


def found_by(detector: nn.Module, images: Tensor, calibration: tuple[float, float] = (1.0, 0.0)) -> SoftTargets:
    """Soft targets of ``detector`` in ``(B, 3, H, W)`` images; scores without ``calibration``, scale and shift."""
    logits, offsets = detector(images)
    scale, shift = calibration
    return SoftTargets(((logits[..., 1] - logits[..., 0] - shift) / scale).sigmoid(), offsets)


def distillation_loss(logits: Tensor, offsets: Tensor, anchors: Tensor, targets: SoftTargets) -> tuple[Tensor, Tensor]:
    """Quality focal loss towards the teacher's scores, and complete IoU loss towards its boxes, weighted by these.

    Args:
        logits: ``(B, A, 2)`` of the student, background first.
        offsets: ``(B, A, 4)`` of the student.
        anchors: ``(A, 4)`` centre form, the same for both.
        targets: of the teacher.

    Returns:
        Score loss and box loss, scalars: sums over the batch divided by the sum of the teacher's scores where it takes
        the anchor for a person, at least 1.
    """
    certain = targets.scores >= _LEAST_SCORE
    weights = targets.scores[certain]
    count = weights.sum().clamp(min=1)
    score_loss = quality_focal(logits[..., 1].float() - logits[..., 0].float(), targets.scores).sum() / count
    own = anchors.expand(len(logits), -1, -1)[certain]
    found, wanted = decode(offsets.float()[certain], own), decode(targets.offsets[certain], own)
    box_loss = (weights * complete_box_iou_loss(found, wanted, reduction="none")).sum() / count
    return score_loss, box_loss
