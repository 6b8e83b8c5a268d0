"""The quality loss: zero where boxes and scores are right, larger the worse either is, and gradients that mend both."""

from __future__ import annotations

import pytest
import torch

from tsuiseki.models.anchors import encode
from tsuiseki.models.quality_losses import QualityLoss

ANCHORS = torch.tensor([[20.0, 30.0, 20.0, 40.0], [60.0, 30.0, 20.0, 40.0], [100.0, 30.0, 20.0, 40.0]])
BOXES = torch.tensor([[[10.0, 12.0, 30.0, 52.0], [50.0, 10.0, 72.0, 50.0]]])
LABELS = torch.tensor([[1, -1]])


def heads(margins, shift=0.0):
    offsets = torch.zeros(1, 3, 4)
    offsets[0, 0] = encode(BOXES[0, :1], ANCHORS[:1])[0]
    offsets[0, 0, 0] += shift
    margins = torch.tensor(margins)
    return torch.stack([torch.zeros(3), margins], dim=1)[None], offsets


def test_right_boxes_with_right_scores_cost_nothing():
    score, box = QualityLoss()(*heads([12.0, 0.0, -12.0]), ANCHORS, BOXES, LABELS)
    assert float(box) == pytest.approx(0, abs=1e-6)
    assert float(score) == pytest.approx(0, abs=1e-4)


def test_the_loss_of_one_misplaced_box_is_its_complete_iou_and_the_focal_term():
    """Same size, shifted by d: no aspect term, so 1 - IoU + d^2 / diagonal^2 of the enclosing box."""
    shift = 2.0  # of the code, 0.1 * 20 pixels each
    score, box = QualityLoss(box_weight=1.0)(*heads([0.0, 0.0, -12.0], shift), ANCHORS, BOXES, LABELS)
    d = shift * 0.1 * 20
    iou = (20 - d) / (20 + d)
    assert float(box) == pytest.approx(1 - iou + d**2 / ((20 + d) ** 2 + 40**2), abs=1e-5)
    assert float(score) == pytest.approx(abs(0.5 - iou) ** 2 * 0.6931, abs=1e-3)


def test_ignored_places_learn_nothing_and_false_alarms_cost():
    loss = QualityLoss()
    quiet = loss(*heads([12.0, -5.0, -12.0]), ANCHORS, BOXES, LABELS)[0]
    assert float(loss(*heads([12.0, 5.0, -12.0]), ANCHORS, BOXES, LABELS)[0]) == pytest.approx(float(quiet))
    assert float(loss(*heads([12.0, 0.0, 5.0]), ANCHORS, BOXES, LABELS)[0]) > float(quiet) + 1


@pytest.mark.parametrize("people", [0, 1])
def test_gradients_are_finite_with_and_without_people(people):
    logits, offsets = (x.requires_grad_() for x in heads([0.0, 0.0, 0.0], 1.0))
    sum(QualityLoss()(logits, offsets, ANCHORS, BOXES[:, :people], LABELS[:, :people])).backward()
    assert torch.isfinite(logits.grad).all()
    assert torch.isfinite(offsets.grad).all()
    assert logits.grad.abs().sum() > 0
    assert bool(offsets.grad.abs().sum() > 0) == bool(people)
