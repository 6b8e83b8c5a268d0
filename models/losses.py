"""What the anchors of a single-shot detector learn, and the multibox loss (Liu et al. 2016, section 2.2).

Its parts may be replaced by losses that care for the overlap of boxes, towards labels or what a teacher detects.
Complete IoU is for places: Zheng et al., *Distance-IoU Loss*, AAAI 2020, eq. 8 to 11. Quality focal loss is for scores:
Li et al., *Generalized Focal Loss*, NeurIPS 2020, eq. 5. Hinton et al., *Distilling the Knowledge in a Neural Network*,
2015, teach by the soft outputs of a classifier; that it is a detector here is ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import box_iou, complete_box_iou_loss

from tsuiseki.models.anchors import corners_from_centres, decode, encode

# Label of a box of the first class.
PERSON = 1
# Label of a box that is neither right nor wrong.
IGNORED = -1
# Label of what fills a batch up.
PADDING = 0


@dataclass(frozen=True)
class Matches:
    """What each anchor is to learn.

    Attributes:
        positive: ``(B, A)`` bool, the anchor stands for a box.
        neutral: ``(B, A)`` bool, the anchor learns nothing.
        box: ``(B, A)`` int64, which box the anchor stands for; meaningless elsewhere.
        classes: ``(B, A)`` int64, the class of that box, from 1; 0 elsewhere.
    """

    positive: Tensor
    neutral: Tensor
    box: Tensor
    classes: Tensor


def match_anchors(anchors: Tensor, boxes: Tensor, labels: Tensor, threshold: float = 0.5) -> Matches:
    """Give each anchor the box it overlaps best, and each box its best anchor whatever the overlap.

    Args:
        anchors: ``(A, 4)`` centre form.
        boxes: ``(B, M, 4)`` x1, y1, x2, y2, padded.
        labels: ``(B, M)`` class from 1 on, `IGNORED` or `PADDING`. An anchor on an ignored box is neutral.
        threshold: on the IoU from which an anchor stands for a box.
    """
    batch, count = labels.shape
    if count == 0:
        nothing = torch.zeros(batch, len(anchors), dtype=torch.bool, device=anchors.device)
        return Matches(nothing, nothing, nothing.long(), nothing.long())
    overlap = box_iou(boxes.reshape(-1, 4), corners_from_centres(anchors)).view(batch, count, -1)
    real = labels > PADDING
    of_real = overlap.masked_fill(~real[..., None], -1.0)
    best, box = of_real.max(dim=1)
    positive = best >= threshold
    favourite = of_real.argmax(dim=2)
    image, which = real.nonzero(as_tuple=True)
    # Where two boxes share their favourite anchor the last one written keeps it.
    box[image, favourite[image, which]] = which
    positive[image, favourite[image, which]] = True
    of_ignored = overlap.masked_fill(labels[..., None] != IGNORED, 0.0).amax(dim=1)
    neutral = ~positive & (of_ignored >= threshold / 2)
    return Matches(positive, neutral, box, labels.gather(1, box) * positive)


# Offsets, anchors (centre form) and boxes (x1, y1, x2, y2) of P positive anchors, each (P, 4), to the sum of losses.
BoxTerm: TypeAlias = Callable[[Tensor, Tensor, Tensor], Tensor]
# Logits (B, A, C + 1), the matches, and the (P,) IoU that each positive anchor's own box has with what it stands for,
# to the sum of losses.
ScoreTerm: TypeAlias = Callable[[Tensor, Matches, Tensor], Tensor]


@dataclass(frozen=True)
class DetectionLoss:
    """A term for the boxes of positive anchors, and one for the scores of all; either may be exchanged.

    Attributes:
        score: term of the scores.
        box: term of the boxes.
        box_weight: of the box term in the sum.
    """

    score: ScoreTerm
    box: BoxTerm
    box_weight: float = 1.0

    def __call__(
        self, logits: Tensor, offsets: Tensor, anchors: Tensor, boxes: Tensor, labels: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Both terms, each a sum over the batch divided by its number of positive anchors.

        Args:
            logits: ``(B, A, C + 1)``, background first.
            offsets: ``(B, A, 4)``.
            anchors: ``(A, 4)`` centre form.
            boxes: ``(B, M, 4)`` x1, y1, x2, y2, padded.
            labels: ``(B, M)`` class from 1 on, `IGNORED` or `PADDING`.

        Returns:
            Score loss and box loss, scalars; their sum (the box term weighted) is what training minimises.
        """
        matches = match_anchors(anchors, boxes, labels)
        image, anchor = matches.positive.nonzero(as_tuple=True)
        count = max(len(image), 1)
        predicted, reference = offsets.float()[image, anchor], anchors[anchor]
        target = boxes[image, matches.box[image, anchor]]
        box_loss = self.box(predicted, reference, target) / count
        overlap = paired_iou(decode(predicted.detach(), reference), target)
        return self.score(logits.float(), matches, overlap) / count, self.box_weight * box_loss


def smooth_l1(offsets: Tensor, anchors: Tensor, boxes: Tensor) -> Tensor:
    """Summed smooth L1 distance of ``offsets`` from the box code of ``boxes``; all ``(P, 4)``."""
    return functional.smooth_l1_loss(offsets, encode(boxes, anchors), reduction="sum")


def mined_entropy(
    logits: Tensor,
    matches: Matches,
    overlap: Tensor,
    negatives_per_positive: float = 3.0,
    fewest_negatives: int = 16,
) -> Tensor:
    """Summed cross-entropy of the positive anchors and of the negatives that the network gets most wrong.

    Args:
        logits: ``(B, A, C + 1)``, background first.
        matches: what the anchors stand for.
        overlap: does not count.
        negatives_per_positive: counted for each positive of an image.
        fewest_negatives: counted in an image without positives.
    """
    del overlap
    entropy = functional.cross_entropy(logits.transpose(1, 2), matches.classes, reduction="none")
    candidates = ~(matches.positive | matches.neutral)
    negatives = (matches.positive.sum(dim=1) * negatives_per_positive).clamp(min=fewest_negatives)
    order = entropy.detach().masked_fill(~candidates, -1.0).argsort(dim=1, descending=True)
    rank = torch.empty_like(order)
    rank.scatter_(1, order, torch.arange(order.shape[1], device=order.device).expand_as(order))
    return entropy[matches.positive | (candidates & (rank < negatives[:, None]))].sum()


def paired_iou(a: Tensor, b: Tensor) -> Tensor:
    """``(N,)`` intersection over union of ``(N, 4)`` boxes with ``(N, 4)`` ones, row by row."""
    shared = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0).prod(dim=1)
    area_a, area_b = (a[:, 2:] - a[:, :2]).prod(dim=1), (b[:, 2:] - b[:, :2]).prod(dim=1)
    return shared / (area_a + area_b - shared).clamp(min=1e-6)


# Anchors that the teacher takes for background teach no boxes.
_LEAST_SCORE = 0.1


def complete_iou(offsets: Tensor, anchors: Tensor, boxes: Tensor) -> Tensor:
    """Summed complete IoU loss of the boxes that ``offsets`` make of ``anchors`` (centre form); all ``(P, 4)``."""
    loss: Tensor = complete_box_iou_loss(decode(offsets, anchors), boxes, reduction="sum")
    return loss


def overlap_focal(logits: Tensor, matches: Matches, overlap: Tensor) -> Tensor:
    """Summed quality focal loss of scores that are to be the IoU of their own boxes, 0 for all other classes.

    No negatives are chosen: the focal factor leaves the easy ones without weight.

    Args:
        logits: ``(B, A, C + 1)``: the score of a class is the sigmoid of the difference to the background.
        matches: what the anchors stand for; neutral ones do not count.
        overlap: ``(P,)`` IoU of the positive anchors' boxes.
    """
    margins = logits[..., 1:] - logits[..., :1]
    quality = torch.zeros_like(margins, dtype=torch.float32)
    image, anchor = matches.positive.nonzero(as_tuple=True)
    quality[image, anchor, matches.classes[image, anchor] - 1] = overlap
    return quality_focal(margins, quality)[~matches.neutral].sum()


def quality_focal(margin: Tensor, quality: Tensor) -> Tensor:
    """Quality focal loss of each score, the sigmoid of ``margin``, that is to be ``quality`` in [0, 1]; same shapes."""
    entropy = functional.binary_cross_entropy_with_logits(margin, quality, reduction="none")
    return entropy * (margin.sigmoid() - quality).abs() ** 2.0


@dataclass(frozen=True)
class SoftTargets:
    """What a teacher detects at each of its anchors.

    Attributes:
        scores: ``(B, A)`` of a person, in [0, 1].
        offsets: ``(B, A, 4)`` in the box code.
    """

    scores: Tensor
    offsets: Tensor


def soft_targets(detector: nn.Module, images: Tensor, calibration: tuple[float, float] = (1.0, 0.0)) -> SoftTargets:
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
    reference = anchors.expand(len(logits), -1, -1)[certain]
    boxes, target = decode(offsets.float()[certain], reference), decode(targets.offsets[certain], reference)
    box_loss = (weights * complete_box_iou_loss(boxes, target, reduction="none")).sum() / count
    return score_loss, box_loss
