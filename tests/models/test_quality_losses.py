"""The quality loss: zero where boxes and scores are right, larger the worse either is, and gradients that mend both."""

from __future__ import annotations

import pytest
import torch

from tsuiseki.models.anchors import encode
from tsuiseki.models.losses import DetectionLoss, MinedEntropy, smooth_l1
from tsuiseki.models.quality_losses import QualityFocal, complete_iou

ANCHORS = torch.tensor([[20.0, 30.0, 20.0, 40.0], [60.0, 30.0, 20.0, 40.0], [100.0, 30.0, 20.0, 40.0]])
BOXES = torch.tensor([[[10.0, 12.0, 30.0, 52.0], [50.0, 10.0, 72.0, 50.0]]])
LABELS = torch.tensor([[1, -1]])
QUALITY = DetectionLoss(QualityFocal(), complete_iou)


def heads(margins, shift=0.0):
    offsets = torch.zeros(1, 3, 4)
    offsets[0, 0] = encode(BOXES[0, :1], ANCHORS[:1])[0]
    offsets[0, 0, 0] += shift
    margins = torch.tensor(margins)
    return torch.stack([torch.zeros(3), margins], dim=1)[None], offsets


def test_right_boxes_with_right_scores_cost_nothing():
    score, box = QUALITY(*heads([12.0, 0.0, -12.0]), ANCHORS, BOXES, LABELS)
    assert float(box) == pytest.approx(0, abs=1e-6)
    assert float(score) == pytest.approx(0, abs=1e-4)


def test_the_loss_of_one_misplaced_box_is_its_complete_iou_and_the_focal_term():
    """Same size, shifted by d: no aspect term, so 1 - IoU + d^2 / diagonal^2 of the enclosing box."""
    shift = 2.0  # of the code, 0.1 * 20 pixels each
    score, box = QUALITY(*heads([0.0, 0.0, -12.0], shift), ANCHORS, BOXES, LABELS)
    d = shift * 0.1 * 20
    iou = (20 - d) / (20 + d)
    assert float(box) == pytest.approx(1 - iou + d**2 / ((20 + d) ** 2 + 40**2), abs=1e-5)
    assert float(score) == pytest.approx(abs(0.5 - iou) ** 2 * 0.6931, abs=1e-3)


def test_ignored_places_learn_nothing_and_false_alarms_cost():
    loss = QUALITY
    quiet = loss(*heads([12.0, -5.0, -12.0]), ANCHORS, BOXES, LABELS)[0]
    assert float(loss(*heads([12.0, 5.0, -12.0]), ANCHORS, BOXES, LABELS)[0]) == pytest.approx(float(quiet))
    assert float(loss(*heads([12.0, 0.0, 5.0]), ANCHORS, BOXES, LABELS)[0]) > float(quiet) + 1


@pytest.mark.parametrize("people", [0, 1])
def test_gradients_are_finite_with_and_without_people(people):
    logits, offsets = (x.requires_grad_() for x in heads([0.0, 0.0, 0.0], 1.0))
    sum(QUALITY(logits, offsets, ANCHORS, BOXES[:, :people], LABELS[:, :people])).backward()
    assert torch.isfinite(logits.grad).all()
    assert torch.isfinite(offsets.grad).all()
    assert logits.grad.abs().sum() > 0
    assert bool(offsets.grad.abs().sum() > 0) == bool(people)


@pytest.mark.parametrize("score", [MinedEntropy(), QualityFocal()])
@pytest.mark.parametrize("box", [smooth_l1, complete_iou])
def test_scores_and_boxes_learn_apart(score, box):
    """Each term is what it is beside either of the other kind, and the weight is that of the boxes alone."""
    given = (*heads([1.0, 0.0, -1.0], 2.0), ANCHORS, BOXES, LABELS)
    found = DetectionLoss(score, box, box_weight=3.0)(*given)
    assert float(found[0]) == pytest.approx(float(DetectionLoss(score, smooth_l1)(*given)[0]))
    assert float(found[1]) == pytest.approx(3 * float(DetectionLoss(QualityFocal(), box)(*given)[1]))


def test_the_hard_negatives_do_not_know_the_overlap():
    """Right and misplaced boxes cost scores by hard negatives the same, and quality focal scores not."""
    for score, same in ((MinedEntropy(), True), (QualityFocal(), False)):
        loss = DetectionLoss(score, complete_iou)
        there, beside = (float(loss(*heads([2.0, 0.0, -9.0], s), ANCHORS, BOXES, LABELS)[0]) for s in (0.0, 3.0))
        assert (there == beside) is same
