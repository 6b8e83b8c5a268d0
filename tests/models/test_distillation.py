"""Distillation: the mirror, the mean of a picture and its mirror image, and a loss of 0 at what the teacher finds."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from tsuiseki.models.anchors import corners_from_centres, decode, grid_anchors
from tsuiseki.models.backbones import build_trunk
from tsuiseki.models.detector import people_detector
from tsuiseki.models.distillation import (
    SoftTargets,
    distillation_loss,
    flip_averaged,
    found_by,
    mirrored,
    mirrored_anchors,
)

WIDTH = 64
ANCHORS = grid_anchors([(2, 4), (1, 2)], [16, 32], [[(8, 20), (12, 30)], [(30, 60)]])
ORDER = mirrored_anchors(ANCHORS, WIDTH)


def some_targets() -> SoftTargets:
    generator = torch.Generator().manual_seed(0)
    shape = (2, len(ANCHORS))
    return SoftTargets(torch.rand(shape, generator=generator), torch.randn(*shape, 4, generator=generator))


class LeftHalf(nn.Module):
    """Sees a person at every anchor with the mean of the image's left half as margin, and moves boxes by it."""

    def forward(self, images):
        seen = images[..., : WIDTH // 2].mean(dim=(1, 2, 3))[:, None].expand(-1, len(ANCHORS))
        return torch.stack((torch.zeros_like(seen), seen), dim=-1), seen[..., None].expand(-1, -1, 4)


def test_an_anchor_mirrored_twice_is_itself_and_once_lies_opposite():
    assert ORDER[ORDER].tolist() == list(range(len(ANCHORS)))
    assert torch.equal(ANCHORS[ORDER][:, 1:], ANCHORS[:, 1:])
    assert torch.equal(ANCHORS[ORDER][:, 0] + ANCHORS[:, 0], torch.full((len(ANCHORS),), float(WIDTH)))


def test_anchors_without_a_mirror_image_are_refused():
    for anchors, width in ((ANCHORS, WIDTH + 2), (torch.cat((ANCHORS, ANCHORS)), WIDTH)):
        with pytest.raises(ValueError, match="symmetrically"):
            mirrored_anchors(anchors, width)


def test_boxes_in_the_mirror_are_the_boxes_mirrored():
    targets = some_targets()
    other = mirrored(targets, ORDER)
    boxes, found = decode(targets.offsets, ANCHORS), decode(other.offsets, ANCHORS)
    assert torch.allclose(
        found[:, ORDER][..., [2, 1, 0, 3]],
        boxes * torch.tensor([-1, 1, -1, 1]) + torch.tensor([WIDTH, 0, WIDTH, 0]),
        atol=1e-4,
    )
    assert torch.equal(other.scores[:, ORDER], targets.scores)


def test_mirrored_twice_nothing_changes():
    targets = some_targets()
    again = mirrored(mirrored(targets, ORDER), ORDER)
    assert torch.equal(again.scores, targets.scores)
    assert torch.equal(again.offsets, targets.offsets)


def test_the_mean_of_a_picture_and_its_mirror_image():
    """A network of the left half's mean m: on the mirror image it sees the right half's; only x changes its sign."""
    left, right = 1.0, 3.0
    image = torch.full((1, 3, 32, WIDTH), left)
    image[..., WIDTH // 2 :] = right
    found = flip_averaged(LeftHalf(), image, ORDER)
    expected = (1 / (1 + math.exp(-left)) + 1 / (1 + math.exp(-right))) / 2
    assert torch.allclose(found.scores, torch.tensor(expected))
    assert torch.allclose(found.offsets, torch.tensor([(left - right) / 2, 2.0, 2.0, 2.0]).expand(1, len(ANCHORS), 4))


def test_what_the_mirror_image_teaches_is_the_mirrored_lesson():
    """Of any network: averaged over both, it is equivariant to mirroring."""
    torch.manual_seed(0)
    sizes = [[(9.0, 22.0)], [(25.0, 64.0)], [(52.0, 132.0)]]
    network = people_detector(build_trunk("mobilenet_v3_small"), (64, 96), sizes, 16).eval()
    order = mirrored_anchors(network.anchors, 96)
    images = torch.randn(2, 3, 64, 96)
    with torch.no_grad():
        once, other = flip_averaged(network, images, order), flip_averaged(network, images.flip(-1), order)
        plain, plain_other = found_by(network, images), found_by(network, images.flip(-1))
    back = mirrored(other, order)
    assert torch.allclose(once.scores, back.scores, atol=1e-6)
    assert torch.allclose(once.offsets, back.offsets, atol=1e-5)
    assert not torch.allclose(plain.offsets, mirrored(plain_other, order).offsets, atol=1e-5)


def test_a_calibration_is_taken_back():
    """Logit 2 of a network of scale 2 and shift 1 was 1/2 before."""
    found = found_by(LeftHalf(), torch.full((1, 3, 32, WIDTH), 2.0), (2.0, 1.0))
    assert torch.allclose(found.scores, torch.tensor(1 / (1 + math.exp(-0.5))))


def one_target(score: float) -> SoftTargets:
    scores, offsets = torch.zeros(1, len(ANCHORS)), torch.zeros(1, len(ANCHORS), 4)
    scores[0, 3] = score
    return SoftTargets(scores, offsets)


def logits_of(scores: torch.Tensor) -> torch.Tensor:
    return torch.stack((torch.zeros_like(scores), torch.logit(scores, eps=1e-7)), dim=-1)


def test_the_loss_is_0_where_the_student_finds_what_the_teacher_does():
    targets = one_target(1.0)
    losses = distillation_loss(logits_of(targets.scores), targets.offsets, ANCHORS, targets)
    assert [float(x) for x in losses] == pytest.approx([0, 0], abs=1e-5)


def test_a_student_that_knows_nothing_by_hand():
    """Score 1/2 everywhere, one anchor taught 0.8: focal terms 0.5² ln 2 and 0.3² ln 2; complete IoU of a moved box."""
    targets = one_target(0.8)
    offsets = torch.zeros(1, len(ANCHORS), 4)
    offsets[0, 3, 0] = 2.0  # of the code, 0.1 times the anchor's width each
    scores, boxes = distillation_loss(torch.zeros(1, len(ANCHORS), 2), offsets, ANCHORS, targets)
    focal = (len(ANCHORS) - 1) * 0.25 * math.log(2) + 0.09 * math.log(2)
    assert float(scores) == pytest.approx(focal, rel=1e-5)  # divided by at least 1
    x1, y1, x2, y2 = corners_from_centres(ANCHORS[3]).tolist()
    d = 0.2 * (x2 - x1)
    iou = (x2 - x1 - d) / (x2 - x1 + d)
    complete = 1 - iou + d**2 / ((x2 - x1 + d) ** 2 + (y2 - y1) ** 2)
    assert float(boxes) == pytest.approx(0.8 * complete, rel=1e-4)


def test_a_teacher_that_finds_nobody_teaches_no_boxes():
    logits = torch.zeros(1, len(ANCHORS), 2, requires_grad=True)
    offsets = torch.zeros(1, len(ANCHORS), 4, requires_grad=True)
    sum(distillation_loss(logits, offsets, ANCHORS, one_target(0.0))).backward()
    assert logits.grad[..., 1].min() > 0
    assert not offsets.grad.any()
