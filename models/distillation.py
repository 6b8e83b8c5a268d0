"""Learning from what another detector finds at every anchor, averaged over a picture and its mirror image.

Hinton et al., *Distilling the Knowledge in a Neural Network*, 2015, teach by the soft outputs of a classifier. That it
is a detector here, and the mean over the mirror image, are ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torchvision.ops import complete_box_iou_loss

from tsuiseki.models.anchors import decode
from tsuiseki.models.quality_losses import quality_focal

# Anchors that the teacher takes for background teach no boxes.
_LEAST_SCORE = 0.1
# Anchors are the same to a hundredth of a pixel.
_STEPS_PER_PIXEL = 100


@dataclass(frozen=True)
class SoftTargets:
    """What a detector finds at each of its anchors.

    Attributes:
        scores: ``(B, A)`` of a person, in [0, 1].
        offsets: ``(B, A, 4)`` in the box code.
    """

    scores: Tensor
    offsets: Tensor


def mirrored_anchors(anchors: Tensor, width: int) -> Tensor:
    """``(A,)`` int64: which anchor each one becomes where left and right change places.

    Args:
        anchors: ``(A, 4)`` centre form.
        width: of the image, pixels.

    Raises:
        ValueError: the anchors do not lie symmetrically.
    """
    opposite = anchors.clone()
    opposite[:, 0] = width - opposite[:, 0]
    rows, wanted = ((_STEPS_PER_PIXEL * x).round().long().tolist() for x in (anchors, opposite))
    number = {tuple(row): n for n, row in enumerate(rows)}
    order = [number.get(tuple(row), -1) for row in wanted]
    if len(number) < len(rows) or -1 in order:
        raise ValueError(f"expected anchors that lie symmetrically in {width} pixels, got others")
    return torch.tensor(order, dtype=torch.int64, device=anchors.device)


def mirrored(targets: SoftTargets, order: Tensor) -> SoftTargets:
    """What was found in an image, as it is found in the mirror; ``order`` of `mirrored_anchors`."""
    sign = targets.offsets.new_tensor([-1.0, 1.0, 1.0, 1.0])
    return SoftTargets(targets.scores[:, order], targets.offsets[:, order] * sign)


def found_by(detector: nn.Module, images: Tensor, calibration: tuple[float, float] = (1.0, 0.0)) -> SoftTargets:
    """What ``detector`` finds in ``(B, 3, H, W)`` images; scores without their ``calibration``, scale and shift."""
    logits, offsets = detector(images)
    scale, shift = calibration
    return SoftTargets(((logits[..., 1] - logits[..., 0] - shift) / scale).sigmoid(), offsets)


def flip_averaged(
    detector: nn.Module, images: Tensor, order: Tensor, calibration: tuple[float, float] = (1.0, 0.0)
) -> SoftTargets:
    """Mean of what ``detector`` finds in ``(B, 3, H, W)`` images and in their mirror images, mirrored back."""
    seen = found_by(detector, images, calibration)
    other = mirrored(found_by(detector, images.flip(-1), calibration), order)
    return SoftTargets((seen.scores + other.scores) / 2, (seen.offsets + other.offsets) / 2)


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
