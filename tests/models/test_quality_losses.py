"""The quality loss: zero where boxes and scores are right, larger the worse either is, and gradients that mend both."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from tsuiseki.models.anchors import corners_from_centres, encode, grid_anchors
from tsuiseki.models.losses import (
    DetectionLoss,
    SoftTargets,
    complete_iou,
    distillation_loss,
    mined_entropy,
    overlap_focal,
    smooth_l1,
    soft_targets,
)

ANCHORS = torch.tensor([[20.0, 30.0, 20.0, 40.0], [60.0, 30.0, 20.0, 40.0], [100.0, 30.0, 20.0, 40.0]])
BOXES = torch.tensor([[[10.0, 12.0, 30.0, 52.0], [50.0, 10.0, 72.0, 50.0]]])
LABELS = torch.tensor([[1, -1]])
QUALITY = DetectionLoss(overlap_focal, complete_iou)


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


@pytest.mark.parametrize("score", [mined_entropy, overlap_focal])
@pytest.mark.parametrize("box", [smooth_l1, complete_iou])
def test_scores_and_boxes_learn_apart(score, box):
    """Each term is what it is beside either of the other kind, and the weight is that of the boxes alone."""
    given = (*heads([1.0, 0.0, -1.0], 2.0), ANCHORS, BOXES, LABELS)
    found = DetectionLoss(score, box, box_weight=3.0)(*given)
    assert float(found[0]) == pytest.approx(float(DetectionLoss(score, smooth_l1)(*given)[0]))
    assert float(found[1]) == pytest.approx(3 * float(DetectionLoss(overlap_focal, box)(*given)[1]))


def test_the_hard_negatives_do_not_know_the_overlap():
    """Right and misplaced boxes cost scores by hard negatives the same, and quality focal scores not."""
    for score, same in ((mined_entropy, True), (overlap_focal, False)):
        loss = DetectionLoss(score, complete_iou)
        there, beside = (float(loss(*heads([2.0, 0.0, -9.0], s), ANCHORS, BOXES, LABELS)[0]) for s in (0.0, 3.0))
        assert (there == beside) is same


WIDTH = 64
GRID = grid_anchors([(2, 4), (1, 2)], [16, 32], [[(8, 20), (12, 30)], [(30, 60)]])


class LeftHalf(nn.Module):
    """Sees a person at every anchor with the mean of the image's left half as margin, and moves boxes by it."""

    def forward(self, images):
        seen = images[..., : WIDTH // 2].mean(dim=(1, 2, 3))[:, None].expand(-1, len(GRID))
        return torch.stack((torch.zeros_like(seen), seen), dim=-1), seen[..., None].expand(-1, -1, 4)


def test_a_calibration_is_taken_back():
    """Logit 2 of a network of scale 2 and shift 1 was 1/2 before."""
    found = soft_targets(LeftHalf(), torch.full((1, 3, 32, WIDTH), 2.0), (2.0, 1.0))
    assert torch.allclose(found.scores, torch.tensor(1 / (1 + math.exp(-0.5))))


def one_target(score: float) -> SoftTargets:
    scores, offsets = torch.zeros(1, len(GRID)), torch.zeros(1, len(GRID), 4)
    scores[0, 3] = score
    return SoftTargets(scores, offsets)


def logits_of(scores: torch.Tensor) -> torch.Tensor:
    return torch.stack((torch.zeros_like(scores), torch.logit(scores, eps=1e-7)), dim=-1)


def test_the_loss_is_0_where_the_student_finds_what_the_teacher_does():
    targets = one_target(1.0)
    losses = distillation_loss(logits_of(targets.scores), targets.offsets, GRID, targets)
    assert [float(x) for x in losses] == pytest.approx([0, 0], abs=1e-5)


def test_a_student_that_knows_nothing_by_hand():
    """Score 1/2 everywhere, one anchor taught 0.8: focal terms 0.5² ln 2 and 0.3² ln 2; complete IoU of a moved box."""
    targets = one_target(0.8)
    offsets = torch.zeros(1, len(GRID), 4)
    offsets[0, 3, 0] = 2.0  # of the code, 0.1 times the anchor's width each
    scores, boxes = distillation_loss(torch.zeros(1, len(GRID), 2), offsets, GRID, targets)
    focal = (len(GRID) - 1) * 0.25 * math.log(2) + 0.09 * math.log(2)
    assert float(scores) == pytest.approx(focal, rel=1e-5)  # divided by at least 1
    x1, y1, x2, y2 = corners_from_centres(GRID[3]).tolist()
    d = 0.2 * (x2 - x1)
    iou = (x2 - x1 - d) / (x2 - x1 + d)
    complete = 1 - iou + d**2 / ((x2 - x1 + d) ** 2 + (y2 - y1) ** 2)
    assert float(boxes) == pytest.approx(0.8 * complete, rel=1e-4)


def test_a_teacher_that_finds_nobody_teaches_no_boxes():
    logits = torch.zeros(1, len(GRID), 2, requires_grad=True)
    offsets = torch.zeros(1, len(GRID), 4, requires_grad=True)
    sum(distillation_loss(logits, offsets, GRID, one_target(0.0))).backward()
    assert logits.grad[..., 1].min() > 0
    assert not offsets.grad.any()
