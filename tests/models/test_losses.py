"""The multibox loss: who matches whom, what is counted, what is ignored."""

from __future__ import annotations

import math
from functools import partial

import pytest
import torch

from tsuiseki.models.anchors import corners_from_centres, encode, grid_anchors
from tsuiseki.models.losses import (
    IGNORED,
    PADDING,
    PERSON,
    DetectionLoss,
    match_anchors,
    mined_entropy,
    overlap_focal,
    smooth_l1,
)

ANCHORS = grid_anchors([(4, 6)], [16], [[(16, 32)]])
MULTIBOX = DetectionLoss(mined_entropy, smooth_l1)


def test_every_box_gets_its_best_anchor_even_a_poor_one() -> None:
    boxes = torch.tensor([[[0.0, 0.0, 90.0, 60.0]]])
    matches = match_anchors(ANCHORS, boxes, torch.tensor([[PERSON]]))
    assert matches.positive.sum() == 1
    assert matches.box[matches.positive].tolist() == [0]


def test_padding_and_ignored_boxes_match_nothing() -> None:
    box = corners_from_centres(ANCHORS[7])
    for label in (PADDING, IGNORED):
        matches = match_anchors(ANCHORS, box[None, None], torch.tensor([[label]]))
        assert not matches.positive.any()
        assert matches.neutral[0, 7] == (label == IGNORED)


def test_two_boxes_are_told_apart() -> None:
    boxes = corners_from_centres(ANCHORS[[2, 20]])[None]
    matches = match_anchors(ANCHORS, boxes, torch.tensor([[PERSON, PERSON]]))
    assert matches.positive[0].nonzero().flatten().tolist() == [2, 20]
    assert matches.box[0, [2, 20]].tolist() == [0, 1]


def test_images_without_any_box() -> None:
    matches = match_anchors(ANCHORS, torch.zeros(2, 0, 4), torch.zeros(2, 0, dtype=torch.int64))
    assert not matches.positive.any()


def test_loss_by_hand() -> None:
    """One positive of 24 anchors and uniform logits: (1 + 3) times log 2; a shift of one unit costs 1 - 1/2."""
    boxes = corners_from_centres(ANCHORS[7])[None, None]
    logits, offsets = torch.zeros(1, 24, 2), torch.zeros(1, 24, 4)
    offsets[0, 7] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    loss = DetectionLoss(partial(mined_entropy, fewest_negatives=0), smooth_l1)
    class_loss, box_loss = loss(logits, offsets, ANCHORS, boxes, torch.tensor([[PERSON]]))
    assert float(class_loss) == pytest.approx(4 * math.log(2), rel=1e-6)
    assert float(box_loss) == pytest.approx(0.5, rel=1e-6)


def test_the_hardest_negatives_are_counted() -> None:
    boxes = corners_from_centres(ANCHORS[7])[None, None]
    logits = torch.zeros(1, 24, 2)
    logits[0, :, 0] = 3.0
    logits[0, [0, 11, 17], 1] = 6.0
    logits.requires_grad_()
    loss = DetectionLoss(partial(mined_entropy, fewest_negatives=0), smooth_l1)
    loss(logits, torch.zeros(1, 24, 4), ANCHORS, boxes, torch.tensor([[PERSON]]))[0].backward()
    assert logits.grad is not None
    assert logits.grad[0].abs().sum(dim=1).nonzero().flatten().tolist() == [0, 7, 11, 17]


def test_ignored_regions_teach_nothing() -> None:
    boxes = corners_from_centres(ANCHORS[[7, 20]])[None]
    logits = torch.zeros(1, 24, 2)
    logits[0, 20, 1] = 9.0
    logits.requires_grad_()
    labels = torch.tensor([[PERSON, IGNORED]])
    class_loss, _ = MULTIBOX(logits, torch.zeros(1, 24, 4), ANCHORS, boxes, labels)
    class_loss.backward()
    assert logits.grad is not None
    assert not logits.grad[0, 20].any()


def test_the_loss_falls_to_zero_on_the_truth() -> None:
    boxes = corners_from_centres(ANCHORS[[2, 20]])[None] + 1.5
    labels = torch.tensor([[PERSON, PERSON]])
    matches = match_anchors(ANCHORS, boxes, labels)
    logits = torch.zeros(1, 24, 2)
    logits[..., 0] = 30.0
    logits[0, matches.positive[0], 1] = 60.0
    offsets = encode(boxes[0, matches.box[0]], ANCHORS)[None]
    class_loss, box_loss = MULTIBOX(logits, offsets, ANCHORS, boxes, labels)
    assert float(class_loss + box_loss) < 1e-6


def test_a_batch_without_people_still_has_a_finite_loss() -> None:
    class_loss, box_loss = MULTIBOX(
        torch.zeros(2, 24, 2),
        torch.zeros(2, 24, 4),
        ANCHORS,
        torch.zeros(2, 0, 4),
        torch.zeros(2, 0, dtype=torch.int64),
    )
    assert float(class_loss) == pytest.approx(2 * 16 * math.log(2), rel=1e-5)
    assert float(box_loss) == 0


def test_an_anchor_learns_the_class_of_its_box() -> None:
    boxes = torch.tensor([[[0.0, 0, 16, 16], [32, 0, 48, 16]]])
    matches = match_anchors(ANCHORS, boxes, torch.tensor([[2, 1]]))
    assert matches.classes[matches.positive].unique().tolist() == [1, 2]
    assert (matches.classes[~matches.positive] == 0).all()
    logits = torch.zeros(1, len(ANCHORS), 3, requires_grad=True)
    for term in (mined_entropy, overlap_focal):
        term(logits, matches, torch.ones(int(matches.positive.sum()))).backward()
        assert logits.grad is not None
        falling = -logits.grad[matches.positive][:, 1:]
        assert (falling.argmax(dim=1) + 1).tolist() == matches.classes[matches.positive].tolist()
        logits.grad = None
