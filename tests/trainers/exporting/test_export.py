"""Export to ONNX: the file says what it is, gives what torch gives, and refuses to exist otherwise."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import lightning
import numpy as np
import onnx
import pytest
import torch
from torch import Tensor, nn
from torchvision.models.detection.ssdlite import ssdlite320_mobilenet_v3_large

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard, OnnxModel
from tsuiseki.tracking.preprocessing import fit_image
from tsuiseki.trainers.detector import Detector, detections
from tsuiseki.trainers.exporting import export
from tsuiseki.trainers.exporting.export import ModelFile, export_onnx
from tsuiseki.trainers.exporting.export_networks import blend_weights, export_detector
from tsuiseki.trainers.exporting.written_networks import OUTPUTS, RawHeads

CARD = ModelCard("appearance", "tiny", input_height=8, input_width=8, feature_length=6)
EXAMPLE = torch.zeros(2, 3, 8, 8)


class Tiny(nn.Module):
    """A network with enough weights to store as float16."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.first = nn.Conv2d(3, 64, 3)
        self.last = nn.Linear(64, 6)

    def forward(self, images: Tensor) -> Tensor:
        """``(B, 3, 8, 8)`` to ``(B, 6)``."""
        features: Tensor = self.last(self.first(images).relu().mean(dim=(2, 3)))
        return features


class Constant(nn.Module):
    """Gives the same whatever it sees."""

    def forward(self, images: Tensor) -> Tensor:
        """Zeros."""
        return images.mean(dim=(2, 3)) * 0


@pytest.mark.slow
@pytest.mark.parametrize("float16", [False, True])
def test_the_file_carries_its_card_and_gives_what_torch_gives(tmp_path: Path, float16: bool) -> None:
    module = Tiny().eval()
    path = tmp_path / "tiny.onnx"
    difference = export_onnx(module, CARD, path, EXAMPLE, ["features"], float16)
    assert difference < (1e-2 if float16 else 1e-5)
    model = OnnxModel(path, "appearance", threads=1)
    assert model.card.name == "tiny"
    assert model.card.project_version
    assert (model.input_names, model.output_names) == (["images"], ["features"])
    inputs = torch.randn(5, 3, 8, 8)
    got = model.run(inputs.numpy())[0]
    # Weights of size 0.2 rounded to eleven bits, 27 and 64 of them in a sum.
    assert np.allclose(got, module(inputs).detach().numpy(), atol=1e-2 if float16 else 1e-5)
    kinds = {w.data_type for w in onnx.load(path).graph.initializer if np.prod(w.dims) >= 512}
    assert kinds == {onnx.TensorProto.FLOAT16 if float16 else onnx.TensorProto.FLOAT}


@pytest.mark.slow
def test_nothing_of_this_machine_is_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "tiny.onnx"
    export_onnx(Tiny(), CARD, path, EXAMPLE, ["features"])
    assert str(Path(__file__).parents[3]).encode() not in path.read_bytes()
    assert [e.key for e in onnx.load(path).metadata_props] == [METADATA_KEY]


@pytest.mark.slow
def test_a_difference_to_torch_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(convert: Callable[..., onnx.ModelProto]) -> Callable[..., onnx.ModelProto]:
        def converted(*given: Any) -> onnx.ModelProto:
            model = convert(*given)
            for weight in model.graph.initializer:
                if weight.dims == [64, 3, 3, 3]:
                    values = onnx.numpy_helper.to_array(weight) * np.float32(1.05)
                    weight.CopyFrom(onnx.numpy_helper.from_array(values, weight.name))
            return model

        return converted

    monkeypatch.setattr(export, "convert_module", wrong(export.convert_module))
    with pytest.raises(RunError, match=r"features differs from torch by 0\.0.*not exported"):
        export_onnx(Tiny(), CARD, tmp_path / "tiny.onnx", EXAMPLE, ["features"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_output_that_says_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="features is constant"):
        export_onnx(Constant(), CARD, tmp_path / "constant.onnx", EXAMPLE, ["features"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "tiny.onnx"
    path.write_text("mine")
    with pytest.raises(RequestError, match="already exists"):
        export_onnx(Tiny(), CARD, path, EXAMPLE, ["features"])
    assert path.read_text() == "mine"


@pytest.mark.slow
def test_a_trained_detector_finds_the_same_boxes_without_torch(tmp_path: Path) -> None:
    torch.manual_seed(0)
    module = Detector(
        trunk="mobilenet_v3_small", height=64, width=96, anchors=[[(12, 28)], [(20, 50)], [(30, 60)]], channels=16
    ).eval()
    checkpoint = tmp_path / "last.ckpt"
    torch.save(
        {
            "state_dict": module.state_dict(),
            "hyper_parameters": dict(module.hparams),
            "pytorch-lightning_version": "2.5.0",
        },
        checkpoint,
    )
    path = tmp_path / "detector.onnx"
    words = ["--checkpoint", str(checkpoint), "--out", str(path), "--training-data", "noise", "--licence", "MIT"]
    assert main(["export", "detector", *words]) == 0
    detector = exported.Detector(path, score_threshold=0.0, threads=1)
    assert (detector.model.card.training_data, detector.model.card.licence) == ("noise", "MIT")
    assert detector.model.card.settings == {"variances": [0.1, 0.2]}
    rng = np.random.default_rng(0)
    image = np.asarray(cv2.resize(rng.integers(0, 256, (9, 12, 3), dtype=np.uint8), (120, 90)), dtype=np.uint8)
    fitted, scale = fit_image(image, detector.model.card)
    with torch.no_grad():
        expected = detections(*module.network.decode(module(torch.from_numpy(fitted[None]))), module.card)[0]
    found = detector.detect([image])[0]
    inside = found.boxes * np.tile(scale, 2)
    # Boxes are cut off at the image's border here, and at the input's there.
    border = np.tile(np.array([image.shape[1], image.shape[0]]) * scale, 2)
    # A network without training scores many alike, so their order is chance.
    assert found.scores[0] == pytest.approx(expected.scores[0], abs=1e-3)
    apart = np.abs(np.minimum(expected.boxes, border) - inside[0]).max(axis=1)
    assert apart.min() < 1e-2
    assert np.allclose(found.scores[:1], expected.scores[:1], atol=1e-4)


@pytest.mark.slow
def test_blended_weights_are_the_mean_of_both(tmp_path: Path) -> None:
    anchors = [[(12.0, 28.0)], [(20.0, 50.0)], [(30.0, 60.0)]]
    networks = []
    for seed in (0, 1):
        torch.manual_seed(seed)
        networks.append(Detector(height=64, width=64, anchors=anchors, channels=16).eval())
    path, card = tmp_path / "other.onnx", networks[0].card
    export_onnx(RawHeads(networks[1].network), card, path, torch.zeros(2, 3, 64, 64), OUTPUTS)
    own = networks[0].network.state_dict()["class_heads.0.1.weight"].clone()
    blend_weights(networks[0].network, card, path)
    mixed = networks[0].network.state_dict()["class_heads.0.1.weight"]
    assert torch.allclose(mixed, (own + networks[1].network.state_dict()["class_heads.0.1.weight"]) / 2, atol=1e-6)
    with torch.no_grad():
        assert all(torch.isfinite(part).all() for part in networks[0].network(torch.zeros(1, 3, 64, 64)))
    with pytest.raises(RequestError, match="with `checkpoint`"):
        export_detector(ModelFile(out=path), weights="coco", blend=path)


@pytest.mark.slow
def test_an_exported_detector_is_exported_again_for_another_input(tmp_path: Path) -> None:
    """What the first file finds in a corner, the second finds there, too, whose input only reaches farther."""
    small, large = tmp_path / "small.onnx", tmp_path / "large.onnx"
    torch.manual_seed(0)
    network = Detector(
        trunk="mobilenet_v3_small", height=64, width=64, anchors=[[(12, 28)], [(20, 50)], [(30, 60)]], channels=16
    )
    # A training leaves no two layers with the same biases, which the file would hold once.
    for _ in range(3):
        network.network(torch.randn(4, 3, 64, 64))
    network.eval()
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d) and layer.bias is not None:
            nn.init.normal_(layer.bias, std=0.1)
    card = replace(network.card, settings=network.card.settings | {"score_calibration": [2.0, 0.5], "straddling": 0.6})
    export_onnx(RawHeads(network.network, (2.0, 0.5)), card, small, torch.zeros(2, 3, 64, 64), OUTPUTS)
    export_detector(ModelFile(out=large), small, height=128, width=192)
    before, after = (OnnxModel(path, "detector", threads=1) for path in (small, large))
    assert (after.card.input_height, after.card.input_width) == (128, 192)
    # The calibration is in the weights now.
    assert "score_calibration" not in after.card.settings
    again = tmp_path / "again.onnx"
    export_detector(ModelFile(out=again), large, height=64, width=64)
    assert OnnxModel(again, "detector", threads=1).card.settings["straddling"] == 0.6
    images = torch.randn(1, 3, 64, 64).numpy()
    logits, offsets, anchors = before.run(images)
    calibrated, codes, places = OnnxModel(again, "detector", threads=1).run(images)
    np.testing.assert_allclose(np.diff(calibrated), np.diff(logits), atol=1e-4)
    np.testing.assert_allclose(codes, offsets, atol=1e-4)
    np.testing.assert_array_equal(places, anchors)
    assert len(after.run(torch.zeros(1, 3, 128, 192).numpy())[2]) == 6 * len(anchors)
    for head in network.network.class_heads:
        nn.init.zeros_(head[-1].bias)
    export_onnx(RawHeads(network.network), card, small, torch.zeros(2, 3, 64, 64), OUTPUTS, overwrite=True)
    with pytest.raises(RequestError, match="no weights for class_heads"):
        export_detector(ModelFile(out=tmp_path / "x.onnx"), small, height=128, width=192)
    with pytest.raises(RequestError, match="divide by"):
        export_detector(ModelFile(out=tmp_path / "odd.onnx"), small, height=100, width=192)
    with pytest.raises(RequestError, match="found none"):
        export_detector(ModelFile(out=tmp_path / "none.onnx"), tmp_path / "no.onnx")


@pytest.mark.slow
def test_coco_weights_become_a_person_detector(tmp_path: Path) -> None:
    torch.manual_seed(0)
    model = ssdlite320_mobilenet_v3_large(weights=None, weights_backbone=None, num_classes=91).eval()
    # A trained network answers to its input; a new one hardly does.
    for head in model.head.classification_head.module_list:
        nn.init.normal_(head[-1].weight, std=2.0)
    torch.save(model.state_dict(), tmp_path / "coco.pth")
    path = tmp_path / "coco.onnx"
    export_detector(ModelFile(out=path), weights="coco", state=tmp_path / "coco.pth")
    card = OnnxModel(path, "detector", threads=1).card
    assert (card.input_height, card.input_width, card.resize) == (320, 320, "stretch")
    assert (card.mean, card.std) == ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
    assert card.class_names == ("person",)
    images = torch.randn(1, 3, 320, 320)
    logits = OnnxModel(path, "detector", threads=1).run(images.numpy())[0]
    with torch.no_grad():
        expected = model.head(list(model.backbone(images).values()))["cls_logits"].softmax(dim=-1)[0, :, 1].numpy()
    scores = 1 / (1 + np.exp(logits[0, :, 0] - logits[0, :, 1]))
    assert np.allclose(scores, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "found none"),
        (b"no checkpoint", "expected a checkpoint of `tsuiseki train`, got something else"),
        ({"a": 1}, "Detector"),
    ],
)
def test_what_is_no_checkpoint(tmp_path: Path, content: object, message: str) -> None:
    checkpoint = tmp_path / "x.ckpt"
    if isinstance(content, bytes):
        checkpoint.write_bytes(content)
    elif content is not None:
        torch.save(content, checkpoint)
    with pytest.raises(RequestError, match=message):
        export_detector(ModelFile(out=tmp_path / "x.onnx"), checkpoint)
    assert not (tmp_path / "x.onnx").exists()


def test_checkpoint_or_weights_but_not_both(tmp_path: Path) -> None:
    for checkpoint, weights in ((None, None), (tmp_path / "x.ckpt", "coco")):
        with pytest.raises(RequestError, match="either one of `checkpoint` and `weights`"):
            export_detector(ModelFile(out=tmp_path / "x.onnx"), checkpoint, weights)  # type: ignore[arg-type]


def test_coco_without_a_connection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))

    def unreachable(*_: object, **__: object) -> None:
        raise OSError("no route to host")

    monkeypatch.setattr("torchvision.models._api.load_state_dict_from_url", unreachable)
    with pytest.raises(RequestError, match=r"expected to download .*no route to host"):
        export_detector(ModelFile(out=tmp_path / "x.onnx"), weights="coco")


@pytest.mark.slow
def test_a_checkpoint_is_scored_as_its_export_is(tmp_path: Path) -> None:
    torch.manual_seed(0)
    module = Detector(trunk="mobilenet_v3_small", height=64, width=64, channels=16)
    for head in module.network.class_heads:
        nn.init.zeros_(head[-1].bias)  # scores about a half, so that something is detected
    trainer = lightning.Trainer(max_epochs=0, accelerator="cpu", logger=False, enable_progress_bar=False)
    trainer.strategy.connect(module)
    checkpoint, file = tmp_path / "trained.ckpt", tmp_path / "exported.onnx"
    trainer.save_checkpoint(checkpoint)
    export_detector(ModelFile(out=file), checkpoint)
    for folder in ("img1", "gt"):
        (tmp_path / "video" / folder).mkdir(parents=True)
    picture = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "video/img1/000001.png"), picture)
    (tmp_path / "video/gt/gt.txt").write_text("1,1,20,20,20,40,1,1,1\n")
    scores = []
    for network in (checkpoint, file):
        out = tmp_path / f"{network.stem}.json"
        assert main(["evaluate", "detection", str(tmp_path / "video"), str(network), "--json", str(out)]) == 0
        scores.append(out.read_text().replace(network.stem, "network"))
    assert scores[0] == scores[1]
    assert json.loads(scores[0])["network"]["combined"]["scores"]
