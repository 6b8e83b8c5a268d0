"""The multibox loss of single-shot detectors (Liu et al. 2016, section 2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchvision.ops import box_iou

from tsuiseki.models.anchors import corners_from_centres, encode

PERSON, IGNORED, PADDING = 1, -1, 0


@dataclass(frozen=True)
class Matches:
    """What each anchor is to learn.

    Attributes:
        positive: ``(B, A)`` bool, the anchor stands for a box.
        neutral: ``(B, A)`` bool, the anchor learns nothing.
        box: ``(B, A)`` int64, which box the anchor stands for; meaningless elsewhere.
    """

    positive: Tensor
    neutral: Tensor
    box: Tensor


def match_anchors(anchors: Tensor, boxes: Tensor, labels: Tensor, threshold: float = 0.5) -> Matches:
    """Give each anchor the box it overlaps best, and each box its best anchor whatever the overlap.

    Args:
        anchors: ``(A, 4)`` centre form.
        boxes: ``(B, M, 4)`` x1, y1, x2, y2, padded.
        labels: ``(B, M)`` `PERSON`, `IGNORED` or `PADDING`. An anchor on an ignored box is neutral.
        threshold: on the IoU from which an anchor stands for a box.
    """
    batch, count = labels.shape
    if count == 0:
        nothing = torch.zeros(batch, len(anchors), dtype=torch.bool, device=anchors.device)
        return Matches(nothing, nothing, nothing.long())
    overlap = box_iou(boxes.reshape(-1, 4), corners_from_centres(anchors)).view(batch, count, -1)
    person = labels == PERSON
    of_people = overlap.masked_fill(~person[..., None], -1.0)
    best, box = of_people.max(dim=1)
    positive = best >= threshold
    favourite = of_people.argmax(dim=2)
    image, which = person.nonzero(as_tuple=True)
    # Where two boxes share their favourite anchor the last one written keeps it.
    box[image, favourite[image, which]] = which
    positive[image, favourite[image, which]] = True
    of_ignored = overlap.masked_fill(labels[..., None] != IGNORED, 0.0).amax(dim=1)
    neutral = ~positive & (of_ignored >= threshold / 2)
    return Matches(positive, neutral, box)


class MultiBoxLoss(nn.Module):
    """Smooth L1 on the offsets of positive anchors and cross-entropy with hard negative mining.

    Args:
        negatives_per_positive: the hardest negatives counted for each positive of an image.
        fewest_negatives: counted in an image without positives.
        threshold: on the IoU from which an anchor stands for a box.
        box_weight: of the box term in the sum.
    """

    def __init__(
        self,
        negatives_per_positive: float = 3.0,
        fewest_negatives: int = 16,
        threshold: float = 0.5,
        box_weight: float = 1.0,
    ) -> None:
        super().__init__()
        self.negatives_per_positive = negatives_per_positive
        self.fewest_negatives = fewest_negatives
        self.threshold = threshold
        self.box_weight = box_weight

    def forward(
        self, logits: Tensor, offsets: Tensor, anchors: Tensor, boxes: Tensor, labels: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Both terms, each a sum over the batch divided by its number of positive anchors.

        Args:
            logits: ``(B, A, C + 1)``, background first.
            offsets: ``(B, A, 4)``.
            anchors: ``(A, 4)`` centre form.
            boxes: ``(B, M, 4)`` x1, y1, x2, y2, padded.
            labels: ``(B, M)`` `PERSON`, `IGNORED` or `PADDING`.

        Returns:
            Class loss and box loss, scalars; their sum (the box term weighted) is what training minimises.
        """
        matches = match_anchors(anchors, boxes, labels, self.threshold)
        logits, offsets = logits.float(), offsets.float()
        positive = matches.positive
        count = positive.sum().clamp(min=1)
        image, anchor = positive.nonzero(as_tuple=True)
        target = encode(boxes[image, matches.box[image, anchor]], anchors[anchor])
        box_loss = functional.smooth_l1_loss(offsets[image, anchor], target, reduction="sum")
        entropy = functional.cross_entropy(logits.transpose(1, 2), positive.long(), reduction="none")
        counted = positive | self._hard_negatives(entropy.detach(), matches)
        return entropy[counted].sum() / count, self.box_weight * box_loss / count

    def _hard_negatives(self, entropy: Tensor, matches: Matches) -> Tensor:
        """``(B, A)`` bool: the negatives of each image that the network gets most wrong."""
        candidates = ~(matches.positive | matches.neutral)
        wanted = (matches.positive.sum(dim=1) * self.negatives_per_positive).clamp(min=self.fewest_negatives)
        order = entropy.masked_fill(~candidates, -1.0).argsort(dim=1, descending=True)
        rank = torch.empty_like(order)
        rank.scatter_(1, order, torch.arange(order.shape[1], device=order.device).expand_as(order))
        return candidates & (rank < wanted[:, None])
