"""The SSD family: shapes, anchor layouts, and COCO weights reduced to people."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from torchvision.models.detection.ssd import ssd300_vgg16
from torchvision.models.detection.ssdlite import ssdlite320_mobilenet_v3_large

from tsuiseki.models.anchors import corners_from_centres, decode
from tsuiseki.models.backbones import Trunk, build_trunk
from tsuiseki.models.detector import branched_detector, people_detector
from tsuiseki.models.ssd import coco_person_detector, coco_start, ssd300, ssd512, ssdlite320

ANCHORS = [[(9, 22), (13, 32)], [(25, 64)], [(52, 132)]]


def tiny_trunk() -> Trunk:
    """Three convolutions in place of a trunk."""
    first = nn.Sequential(nn.Conv2d(3, 8, 3, 8, 1), nn.ReLU())
    return Trunk((first, nn.Conv2d(8, 8, 3, 2, 1), nn.Conv2d(8, 8, 3, 2, 1)), (8, 8, 8))


@pytest.mark.parametrize(("size", "levels"), [((64, 96), 3), ((96, 64), 3), ((64, 128), 4), ((128, 64), 4)])
def test_people_detector_takes_any_rectangle(size: tuple[int, int], levels: int) -> None:
    sizes = [*ANCHORS, [(120, 280)]][:levels]
    detector = people_detector(tiny_trunk(), size, sizes, width=16).eval()
    logits, offsets = detector(torch.randn(2, 3, *size))
    count = sum(len(s) * (size[0] // 2**i) * (size[1] // 2**i) for i, s in zip((3, 4, 5, 6), sizes, strict=False))
    assert logits.shape == (2, count, 2)
    assert offsets.shape == (2, count, 4)
    assert detector.anchors.shape == (count, 4)


def test_heads_read_the_cell_that_their_anchor_stands_on() -> None:
    """The strongest answer to a spot in the image comes from an anchor on it, not from its mirror image."""
    torch.manual_seed(0)
    detector = people_detector(tiny_trunk(), (64, 96), ANCHORS, width=16).eval()
    image = torch.zeros(1, 3, 64, 96)
    changed = image.clone()
    changed[:, :, 16:32, 72:88] += 5.0
    with torch.no_grad():
        difference = (detector(changed)[1] - detector(image)[1])[0].abs().sum(dim=1)[: 8 * 12 * 2]
    # A trunk cell of 8 pixels, the 3x3 of smoothing and that of the head: within 16 pixels of the spot.
    assert (detector.anchors[difference.argmax(), :2] - torch.tensor([80.0, 24.0])).abs().max() <= 16


def test_an_untrained_people_detector_sees_few_people() -> None:
    detector = people_detector(tiny_trunk(), (64, 96), ANCHORS, width=16).eval()
    with torch.no_grad():
        logits, _ = detector(torch.randn(2, 3, 64, 96))
    assert logits.softmax(dim=-1)[..., 1].median().item() == pytest.approx(0.02, abs=0.015)


@pytest.mark.parametrize(
    ("anchors", "size", "message"),
    [(ANCHORS[:2], (64, 96), "3 or 4 maps"), (ANCHORS, (60, 96), "96x60"), ([*ANCHORS, [(9, 9)]], (96, 96), "by 64")],
)
def test_people_detector_says_what_does_not_fit(
    anchors: list[list[tuple[float, float]]], size: tuple[int, int], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        people_detector(tiny_trunk(), size, anchors)


def test_a_branch_leaves_the_detector_beside_it_as_it_is() -> None:
    torch.manual_seed(0)
    people = people_detector(tiny_trunk(), (64, 96), ANCHORS).eval()
    wide = [[(20, 20)], [(58, 28), (88, 42)], [(128, 60)]]
    both = branched_detector(tiny_trunk(), (64, 96), [*ANCHORS, *wide], 16)
    both.load_state_dict(people.state_dict(), strict=False)
    both.begin()
    images, count = torch.randn(2, 3, 64, 96), len(people.anchors)
    optimiser = torch.optim.SGD([p for p in both.parameters() if p.requires_grad], lr=0.1)
    first = both.train()(images)
    torch.stack([x.square().mean() for x in first]).sum().backward()
    optimiser.step()
    logits, offsets = both.eval()(images)
    assert both.anchors.shape == (logits.shape[1], 4)
    torch.testing.assert_close((logits[:, :count], offsets[:, :count]), people(images))
    assert not torch.allclose(offsets[:, count:], first[1][:, count:])
    own = both.branch.features.trunk.stages[0].weight
    assert not torch.allclose(own, people.features.trunk.stages[1].weight)


def test_a_branched_detector_takes_anchors_for_both() -> None:
    with pytest.raises(ValueError, match=r"6 maps.*got them for 3"):
        branched_detector(tiny_trunk(), (64, 96), ANCHORS, 16)


def test_ssd512_has_the_original_layout() -> None:
    # Two stages of the right stride and channels in place of VGG16, which would take seconds.
    stages = [nn.Conv2d(3, 512, 8, 8), nn.MaxPool2d(2), nn.MaxPool2d(2)]
    detector = ssd512(trunk=Trunk(stages, (512, 512, 512))).eval()
    image = torch.randn(1, 3, 512, 512)
    with torch.no_grad():
        sides = [x.shape[-1] for x in detector.features(image)]
        logits, offsets = detector(image)
    assert sides == [64, 32, 16, 8, 4, 2, 1]
    assert logits.shape == (1, 24564, 2)
    assert offsets.shape == (1, 24564, 4)
    assert detector.anchors.shape == (24564, 4)
    # First anchor: a square of 7 % of 512 on the first cell of stride 8; last: the tall one of the single cell.
    assert torch.allclose(detector.anchors[0], torch.tensor([4.0, 4.0, 35.84, 35.84]), atol=1e-3)
    assert detector.anchors[-1, :2].tolist() == [256.0, 256.0]


@pytest.mark.parametrize("weights", [None, "coco"])
def test_fixed_detectors_agree_with_their_anchors(weights: str | None) -> None:
    detector = ssdlite320() if weights is None else coco_start("ssdlite320", _random_state())
    with torch.no_grad():
        logits, offsets = detector.eval()(torch.randn(1, 3, 320, 320))
    assert logits.shape == (1, 3234, 2)
    assert offsets.shape == (1, 3234, 4)
    assert detector.anchors.shape == (3234, 4)


def test_ssdlite320_keeps_the_person_of_torchvision_exactly() -> None:
    model = ssdlite320_mobilenet_v3_large(weights=None, weights_backbone=None, num_classes=91)
    _spread(model)
    _compare(model.eval(), 320, coco_person_detector("ssdlite320", model.state_dict()))


@pytest.mark.slow
def test_ssd300_keeps_the_person_of_torchvision_exactly() -> None:
    model = ssd300_vgg16(weights=None, weights_backbone=None, num_classes=91)
    detector = coco_person_detector("ssd300", model.state_dict())
    assert detector.anchors.shape == (8732, 4)
    _compare(model.eval(), 300, detector)


@pytest.mark.slow
def test_fine_tuning_starts_from_the_logits_of_background_and_person() -> None:
    state = _random_state()
    image = torch.randn(1, 3, 320, 320)
    with torch.no_grad():
        many, _ = ssdlite320(90, state).eval()(image)
        one, _ = coco_start("ssdlite320", state).eval()(image)
    assert torch.allclose(one, many[..., :2], atol=1e-5)


@pytest.mark.slow
def test_fixed_detectors_start_from_the_weights_of_a_trunk() -> None:
    trunk = build_trunk("mobilenet_v3_large")
    image = torch.randn(1, 3, 64, 64)
    with torch.no_grad():
        detector = ssdlite320(trunk=trunk).eval()
        # The expansion at stride 16 belongs to both, and comes before what is narrower here.
        stem = trunk.eval().stages[1](trunk.stages[0](image))
        own = detector.features.extractor.features[0][:-1](image)  # type: ignore[index,union-attr]
    assert torch.allclose(own, stem, atol=1e-6)
    vgg = build_trunk("vgg16")
    weights = [p for p in ssd300(trunk=vgg).parameters() if p.shape == (64, 3, 3, 3)]
    assert torch.equal(weights[0], next(vgg.parameters()))


def test_a_state_dict_of_another_network_is_refused(tmp_path: Path) -> None:
    torch.save(nn.Linear(2, 2).state_dict(), tmp_path / "other.pth")
    with pytest.raises(ValueError, match="COCO-trained ssdlite320"):
        coco_person_detector("ssdlite320", tmp_path / "other.pth")


def _random_state() -> dict[str, Tensor]:
    torch.manual_seed(0)
    model = ssdlite320_mobilenet_v3_large(weights=None, weights_backbone=None, num_classes=91)
    _spread(model)
    return dict(model.state_dict())


def _spread(model: nn.Module) -> None:
    """Random statistics: with those of a new network the activations die out on the way to the heads."""
    generator = torch.Generator().manual_seed(1)
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d):
            assert module.running_mean is not None
            module.running_mean.normal_(0, 0.05, generator=generator)
    for head in model.head.classification_head.module_list:  # type: ignore[union-attr]
        nn.init.normal_(head[-1].bias, std=1.0, generator=generator)


def _compare(model: nn.Module, side: int, detector: nn.Module) -> None:
    image = torch.randn(2, 3, side, side, generator=torch.Generator().manual_seed(2))
    with torch.no_grad():
        features = list(model.backbone(image).values())  # type: ignore[operator]
        expected = model.head(features)  # type: ignore[operator]
        logits, offsets = detector.eval()(image)
    scores = expected["cls_logits"].softmax(dim=-1)
    assert scores[..., 1].std() > 1e-5
    # The log of the sum of exponentials rounds once more in float32.
    assert torch.allclose(logits.softmax(dim=-1)[..., 1], scores[..., 1], atol=1e-6)
    corners = corners_from_centres(detector.anchors)  # type: ignore[arg-type]
    boxes = model.box_coder.decode_single(expected["bbox_regression"][0], corners)  # type: ignore[operator,union-attr]
    assert torch.allclose(decode(offsets[0], detector.anchors), boxes, atol=1e-2)  # type: ignore[arg-type]
