"""`tsuiseki train detector` from a configuration: results, resuming, and what a wrong request gets."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Literal

import cv2
import lightning
import numpy as np
import onnxruntime
import pytest
import torch
import yaml
from lightning.pytorch.loggers import CSVLogger

from tsuiseki.datamodules.detector import DetectionData
from tsuiseki.datamodules.training_images import TrainingSource
from tsuiseki.models.detector import AnchorDetector, decode_heads
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association import detector_of
from tsuiseki.trainers.detector import Detector, DetectorOptimisation, detections
from tsuiseki.trainers.detector_network import detector_card
from tsuiseki.trainers.epoch_lines import EpochLines
from tsuiseki.trainers.exporting import written_networks
from tsuiseki.trainers.exporting.export import ModelFile
from tsuiseki.trainers.exporting.export_networks import _trained as trained_detector
from tsuiseki.trainers.exporting.export_networks import blend_weights, export_detector
from tsuiseki.trainers.exporting.exported_weights import layout_of
from tsuiseki.trainers.fit import fit_detector
from tsuiseki.trainers.refusals import one_line
from tsuiseki.trainers.task_cli import DETECTOR, TaskCLI


def sequence(folder: Path, frames: int = 6) -> Path:
    """A dark person walking over a light ground, 64x64."""
    (folder / "img1").mkdir(parents=True)
    (folder / "gt").mkdir()
    rows = []
    for n in range(frames):
        image = np.full((64, 64, 3), 200, dtype=np.uint8)
        image[18:46, 4 + 8 * n : 16 + 8 * n] = 30
        cv2.imwrite(str(folder / "img1" / f"{n + 1:06d}.png"), image)
        rows.append(f"{n + 1},1,{5 + 8 * n},19,12,28,1,1,1")
    (folder / "gt" / "gt.txt").write_text("\n".join(rows) + "\n")
    return folder


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A training of seconds."""
    source = {"folder": str(sequence(tmp_path / "walk"))}
    settings = {
        "out": str(tmp_path / "out"),
        "trainer": {"max_epochs": 1, "accelerator": "cpu", "num_sanity_val_steps": 0},
        "model": {
            "trunk": "mobilenet_v3_small",
            "height": 64,
            "width": 64,
            "anchors": [[[12, 28]], [[20, 50]], [[30, 60]]],
            "channels": 16,
            "optimisation": {"warmup_steps": 1},
        },
        "data": {"train": [source], "val": [source], "batch_size": 3, "batches": 2, "workers": 0},
    }
    path = tmp_path / "config.yaml"
    path.write_text(yaml.safe_dump(settings))
    return path


@pytest.mark.slow
def test_a_training_that_began_from_an_exported_file_goes_on_with_its_own_normalisations(
    config: Path, tmp_path: Path
) -> None:
    start = shipped("detector_street")
    layout, out = layout_of(start), tmp_path / "on"
    changes = {"start": start, "trunk": layout.trunk, "channels": layout.channels, "learning_rate": "1e-9"}
    words = ["--config", str(config), "--out", str(out), *(f"--model.{name}={v}" for name, v in changes.items())]
    fit_detector(words)
    last = out / "checkpoints" / "last.ckpt"
    before = torch.load(last, weights_only=True)["state_dict"]
    fit_detector([*words, "--ckpt_path", str(last), "--trainer.max_epochs", "2"])
    after = torch.load(last, weights_only=True)["state_dict"]
    learnt = [name for name in before if name.endswith(("weight", "bias"))]
    assert len(learnt) > 50
    for name in learnt:
        torch.testing.assert_close(after[name], before[name], rtol=1e-5, atol=1e-6)


@pytest.mark.slow
def test_a_branch_is_trained_and_exported_beside_a_shipped_detector(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = shipped("detector_street")
    wide = [[[40, 40]], [[88, 88], [116, 56]], [[184, 184], [256, 120], [380, 180]]]
    layout = layout_of(start)
    anchors = json.dumps([*layout.anchors, *wide])
    changes = {"architecture": "branched", "start": start, "trunk": layout.trunk, "anchors": anchors, "width": 96}
    best = fit_detector(["--config", str(config), *(f"--model.{name}={v}" for name, v in changes.items())])
    out, images = tmp_path / "both.onnx", torch.randn(1, 3, 64, 96)
    # Two batches leave biases at zero, which a file leaves out.
    saved = torch.load(best, weights_only=True)
    for name, value in saved["state_dict"].items():
        if name.endswith("bias") and not value.any():
            value.fill_(0.01)
    torch.save(saved, best)
    export_detector(ModelFile(out=out), checkpoint=best)
    logits, offsets, given = onnxruntime.InferenceSession(out).run(None, {"images": images.numpy()})
    people, card = trained_detector(start, (64, 96))
    count = len(people.anchors)
    with torch.no_grad():
        before = people(images)
    torch.testing.assert_close(torch.tensor(logits[:, :count]), before[0], rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(torch.tensor(offsets[:, :count]), before[1], rtol=1e-3, atol=1e-3)
    assert len(given) == logits.shape[1] == count + 4 * 6 * 1 + 2 * 3 * 2 + 1 * 2 * 3
    # A file with a branch is also that of the detector of people beside it.
    assert layout_of(out).arguments == {**layout.arguments, "height": 64, "width": 96}
    assert layout_of(out, branched=True).anchors == [*layout.anchors, *[[tuple(size) for size in x] for x in wide]]
    again, _ = trained_detector(out, (64, 96))
    with torch.no_grad():
        torch.testing.assert_close(torch.tensor(logits), again(images)[0], rtol=1e-3, atol=1e-3)

    # For the mean of weights, too.
    blend_weights(people, card, out)
    with torch.no_grad():
        torch.testing.assert_close(people.eval()(images)[0], before[0], rtol=1e-3, atol=1e-3)
    with pytest.raises(RequestError, match="expected a detector without a branch"):
        detector_of(best)

    # Of its scores those of the branch are calibrated, and no others.
    def branch_alone(detector: exported.Detector, folder: Path) -> tuple[np.ndarray, np.ndarray]:
        assert folder == tmp_path
        raw = np.diff(detector.model.run(images.numpy())[0])
        assert raw[:, :count].max() < -20
        np.testing.assert_allclose(raw[:, count:], np.diff(logits)[:, count:], atol=1e-3)
        return np.zeros(1), np.zeros(1, dtype=np.bool_)

    monkeypatch.setattr(written_networks, "matched_scores", branch_alone)
    monkeypatch.setattr(written_networks, "fit_calibration", lambda *_: (2.0, 0.5))
    export_detector(ModelFile(out=tmp_path / "calibrated.onnx"), checkpoint=best, calibrate=tmp_path)
    margin = np.diff(logits)
    session = onnxruntime.InferenceSession(tmp_path / "calibrated.onnx")
    calibrated = np.diff(session.run(None, {"images": images.numpy()})[0])
    np.testing.assert_allclose(calibrated[:, :count], margin[:, :count], atol=1e-3)
    np.testing.assert_allclose(calibrated[:, count:], 2 * margin[:, count:] + 0.5, atol=1e-3)
    assert layout_of(tmp_path / "calibrated.onnx").card.settings["branch_calibration"] == [2.0, 0.5]
    # A training that goes on from it begins where that ended, and leaves the detector of people as it is.
    module = Detector(start=out, architecture="branched", learning_rate=1e-9)
    with torch.no_grad():
        begun = module.network.eval()(images)
    torch.testing.assert_close(begun[0], torch.tensor(logits), rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(begun[1], torch.tensor(offsets), rtol=1e-3, atol=1e-3)
    # Without the branch where that is not asked for, and where other boxes are.
    for checkpoint in (best, out):
        assert [type(Detector(start=checkpoint).network), len(Detector(start=checkpoint).network.anchors)] == [
            AnchorDetector, count,
        ]  # fmt: skip
        other = [*layout.anchors, *[[(50.0, 50.0)]] * 3]
        anew = Detector(start=checkpoint, architecture="branched", anchors=other, channels=16)
        assert not anew._begun
        same = [torch.equal(value, again.state_dict()[name]) for name, value in anew.network.state_dict().items()
                if name.startswith("branch.features.lateral") and name.endswith("0.weight")]  # fmt: skip
        assert same == [False] * 3
    changes = {"start": out, "architecture": "branched", "trunk": layout.trunk, "anchors": anchors}
    changes |= {"channels": 16, "width": 96, "learning_rate": "1e-9"}
    words = ["--config", str(config), "--out", str(tmp_path / "on")]
    on = fit_detector([*words, *(f"--model.{name}={v}" for name, v in changes.items())])
    export_detector(ModelFile(out=tmp_path / "on.onnx"), checkpoint=on)
    after = onnxruntime.InferenceSession(tmp_path / "on.onnx").run(None, {"images": images.numpy()})
    torch.testing.assert_close(torch.tensor(after[0]), torch.tensor(logits), rtol=1e-2, atol=2e-2)


@pytest.mark.parametrize("change", ["--model.weights=imagenet", "--model.classes=[person,car]"])
def test_a_branched_detector_starts_from_one_of_people(change: str, config: Path) -> None:
    with pytest.raises(RequestError, match="a branched detector is of people alone"):
        fit_detector(["--config", str(config), "--model.architecture=branched", change])


@pytest.mark.slow
def test_a_branch_needs_a_detector_beside_it(config: Path) -> None:
    anchors = json.dumps([[[12, 28]], [[20, 50]], [[30, 60]], [[20, 20]], [[44, 44]], [[92, 92]]])
    words = ["--config", str(config), "--model.architecture=branched", f"--model.anchors={anchors}"]
    with pytest.raises(RequestError, match=r"a branched detector needs model\.start"):
        fit_detector(words)
    start = shipped("detector_street")
    layout = layout_of(start)
    with pytest.raises(RequestError, match=r"street.onnx: expected a `start` .* anchors of its first three maps"):
        fit_detector([*words, f"--model.start={start}", f"--model.trunk={layout.trunk}"])
    words[-1] = f"--model.anchors={json.dumps([*layout.anchors, *[[[20, 20]]] * 3])}"
    with pytest.raises(RequestError, match=r"expected a `start` of the architecture people with the trunk"):
        fit_detector([*words, f"--model.start={start}", "--model.trunk=mobilenet_v3_large"])
    words += [f"--model.start={start}", f"--model.trunk={layout.trunk}", "--model.optimisation.features_rate=0.1"]
    with pytest.raises(RequestError, match="features_rate of 1"):
        fit_detector(words)


@pytest.mark.slow
def test_training_leaves_checkpoints_and_logs_and_goes_on(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    best = fit_detector(["--config", str(config)])
    out = tmp_path / "out"
    assert best == out / "checkpoints" / "best.ckpt"
    for name in ("checkpoints/best.ckpt", "checkpoints/last.ckpt", "metrics/version_0/config.yaml"):
        assert (out / name).is_file()
    assert list((out / "tensorboard").glob("events*"))
    assert "val/ap50" in (out / "metrics" / "version_0" / "metrics.csv").read_text().splitlines()[0]
    assert "epoch 1/1" in capsys.readouterr().out
    with pytest.raises(RequestError, match=r"already holds a training.*--ckpt_path"):
        fit_detector(["--config", str(config)])
    last = out / "checkpoints" / "last.ckpt"
    saving = {"filename": "{epoch}", "every_n_epochs": 2, "save_top_k": -1}
    every = json.dumps([{"class_path": "ModelCheckpoint", "init_args": saving}])
    fit_detector(
        ["--config", str(config), "--ckpt_path", str(last), "--trainer.max_epochs", "2", "--trainer.callbacks", every]
    )
    # In the folder of the first sitting, though it was the second that asked for it.
    assert (out / "checkpoints" / "epoch=1.ckpt").is_file()
    state = torch.load(last, weights_only=True)
    assert (state["epoch"], state["global_step"]) == (1, 4)
    assert (out / "metrics" / "version_1" / "metrics.csv").is_file()
    assert fit_detector(["test", "--config", str(config), "--ckpt_path", str(best)]) is None
    assert "test/ap50" in capsys.readouterr().out
    with pytest.raises(RequestError, match="validate: expected --ckpt_path"):
        fit_detector(["validate", "--config", str(config), "--overwrite", "true"])


@pytest.mark.slow
def test_the_start_is_an_epoch_and_stays_the_best_where_none_is_better(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """AP of the start and of two epochs, by a fixed order."""
    for values, best in (([0.5, 0.4, 0.5], (0, 0)), ([0.5, 0.6, 0.55], (0, 2)), ([0.1, 0.2, 0.3], (1, 4))):
        given = iter(values)
        monkeypatch.setattr(Detector, "scores", lambda _, __, given=given: {"ap": next(given)})
        words = ["--trainer.num_sanity_val_steps=-1", "--trainer.max_epochs=2", "--overwrite=true"]
        path = fit_detector(["--config", str(config), *words])
        assert path == tmp_path / "out" / "checkpoints" / "best.ckpt"
        state = torch.load(path, weights_only=True)
        assert (state["epoch"], state["global_step"]) == best
        assert f"epoch 0/2  val/ap {values[0]}" in capsys.readouterr().out
        assert layout_keys(state) == layout_keys(torch.load(path.with_name("last.ckpt"), weights_only=True))


def layout_keys(state: dict[str, dict[str, object]]) -> list[str]:
    return sorted(state["state_dict"])


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_training_that_is_interrupted_says_how_to_go_on(
    number: signal.Signals,
    config: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    original = EpochLines.on_train_epoch_start

    def begin(self: EpochLines, trainer: lightning.Trainer, module: lightning.LightningModule) -> None:
        original(self, trainer, module)
        if trainer.current_epoch == 1:
            signal.raise_signal(number)

    monkeypatch.setattr(EpochLines, "on_train_epoch_start", begin)
    assert main(["train", "detector", "--config", str(config), "--trainer.max_epochs", "3"]) == 128 + number
    out = tmp_path / "out"
    line = f"tsuiseki: interrupted; go on with --ckpt_path {out / 'checkpoints' / 'last.ckpt'}"
    assert capsys.readouterr().err.splitlines()[-1] == line
    record = json.loads((out / "run.json").read_text())
    assert (record["partial"], record["reason"]) == (True, "interrupted")
    assert "checkpoints/last.ckpt" in record["files"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (["--model.lerning_rate", "1"], "lerning_rate"),
        (["--model.height", "tall"], "height"),
        (["--data.train", "[{folder: x, frams: [1, 2]}]"], "frams"),
        (["--ckpt_path", "nowhere.ckpt"], "expected a checkpoint at nowhere.ckpt"),
        (["--model.architecture", "ssd300"], "300x300 images, got height 64 and width 64"),
        (["--model.weights", "coco"], "ssdlite320 and ssd300, not for people"),
        (["--model.height", "60"], "divide by 32"),
        (["--trainer.logger", "NeptuneLogger", "--trainer.logger.project", "x"], "eptune"),
        (["--trainer.accelerator", "tpu"], "torch_xla"),
        (["--trainer.callbacks", "ModelCheckpoint", "--trainer.callbacks.every_n_epochs", "-1"], "every_n_epochs"),
    ],
)
def test_a_wrong_request_is_one_line(config: Path, change: list[str], message: str) -> None:
    with pytest.raises(RequestError) as caught:
        fit_detector(["--config", str(config), *change])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_logger_that_is_not_installed_says_what_to_install() -> None:
    text = "No subtype\nErrors:\n  - Problem with W:\n      Requirement 'wandb' not met.\n  - Expected a bool\nGiven: 1"
    assert one_line(ValueError(text)) == "Problem with W: Requirement 'wandb' not met."


@pytest.mark.slow
def test_a_logger_that_fails_is_one_line(config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class UsageError(Exception):
        __module__ = "wandb.errors"

    def log(*_: object) -> None:
        raise UsageError("No key.\nLog in.")

    monkeypatch.setattr(CSVLogger, "log_hyperparams", log)
    with pytest.raises(RunError, match=r"the logger could not go on: No key\. Log in\."):
        fit_detector(["--config", str(config)])
    assert json.loads((tmp_path / "out" / "run.json").read_text())["reason"] == "No key. Log in."


@pytest.mark.slow
def test_loggers_of_lightning_are_taken_as_given(config: Path, tmp_path: Path) -> None:
    fit_detector(["--config", str(config), "--trainer.logger", "CSVLogger", f"--trainer.logger.save_dir={tmp_path}/log",
                  "--trainer.logger.name=mine"])  # fmt: skip
    assert "val/ap50" in (tmp_path / "log" / "mine" / "version_0" / "metrics.csv").read_text()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["checkpoints", "run.json"]


def test_options_of_lightning_mean_what_lightning_says(config: Path, tmp_path: Path) -> None:
    def trainer(*more: str) -> lightning.Trainer:
        return TaskCLI(DETECTOR, ["--config", str(config), *more], run=False).trainer

    ours = trainer()
    assert [type(one).__name__ for one in ours.loggers] == ["CSVLogger", "TensorBoardLogger"]
    assert ours.default_root_dir == str(tmp_path / "out")
    assert ours.progress_bar_callback is None
    theirs = trainer("--trainer.logger=false", f"--trainer.default_root_dir={tmp_path}/root",
                     "--trainer.enable_progress_bar=true", "--trainer.enable_model_summary=true",
                     "--trainer.enable_checkpointing=false")  # fmt: skip
    assert theirs.loggers == theirs.checkpoint_callbacks == []
    assert theirs.default_root_dir == str(tmp_path / "root")
    assert theirs.progress_bar_callback is not None
    kinds = [type(one).__name__ for one in theirs.callbacks]
    assert any(kind.endswith("ModelSummary") for kind in kinds)
    assert "EpochLines" not in kinds


@pytest.mark.slow
@pytest.mark.parametrize("change", ["--trainer.limit_val_batches=0", "--trainer.fast_dev_run=true"])
def test_no_checkpoint_is_named_that_is_not_there(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: str
) -> None:
    stale = tmp_path / "out" / "checkpoints" / "best.ckpt"
    stale.parent.mkdir(parents=True)
    stale.touch()
    assert fit_detector(["--config", str(config), "--overwrite=true", change]) is None
    out = capsys.readouterr().out
    assert "no best checkpoint was kept" in out
    assert float(re.findall(r"([\d.]+) batches/s", out)[-1]) < 1e6
    assert "best checkpoint:" not in out


@pytest.mark.slow
def test_scores_of_two_devices_are_those_of_one(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five images, of which one device has three and the other two: Lightning gives it the first one again."""
    monkeypatch.setattr(Detector, "forward", _heads)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # a forked process cannot use the threads of this one
    try:
        found = []
        for how in (["--trainer.devices=1"], ["--trainer.devices=2", "--trainer.strategy=ddp_fork"]):
            words = ["--config", str(config), "--trainer.logger=false", "--data.batch_size=2", *how]
            cli = TaskCLI(DETECTOR, words, run=False)
            cli.datamodule.trainer = cli.trainer
            cli.trainer.strategy.connect(cli.model)
            cli.datamodule.setup("fit")
            cli.datamodule.validation = torch.utils.data.Subset(cli.datamodule.validation, range(5))
            monkeypatch.setattr(cli.datamodule, "setup", lambda stage: stage)
            (scores,) = cli.trainer.validate(cli.model, datamodule=cli.datamodule, verbose=False)
            found.append(scores)
    finally:
        torch.set_num_threads(threads)
    assert found[0] == found[1]
    assert 0.1 < found[0]["val/ap50"] < 0.9


def _heads(self: Detector, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Scores that fall from left to right where the image is dark, on some of the images less."""
    anchors = self.network.anchors
    x, y = anchors[:, :2].long().clamp(0, 63).T
    dark = 200 - images[:, y, x].float().mean(dim=-1)
    score = dark / 20 - x / 16 - images[:, 30, :32].float().mean(dim=(1, 2))[:, None] / 100
    return torch.stack([torch.zeros_like(score), score], dim=2), torch.zeros(*score.shape, 4)


def test_a_missing_configuration_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"missing\.yaml"):
        fit_detector(["--config", str(tmp_path / "missing.yaml")])


@pytest.mark.slow
def test_a_person_is_learnt(config: Path, tmp_path: Path) -> None:
    changes = [
        "--trainer.max_epochs",
        "4",
        "--data.batches",
        "20",
        "--model.learning_rate",
        "0.004",
    ]
    calm = "{scale: [0.9, 1.1], rotation: 0, shear: 0, colour: 0, grey: 0, blur: 0, noise: 0, compression: 0, holes: 0}"
    fit_detector(["--config", str(config), *changes, "--data.augmentation", calm])
    rows = (tmp_path / "out" / "metrics" / "version_0" / "metrics.csv").read_text().splitlines()
    column = rows[0].split(",").index("val/ap50")
    scores = [float(row.split(",")[column]) for row in rows[1:] if row.split(",")[column]]
    assert max(scores) > 0.8


def test_detections_are_decoded_suppressed_and_cut_off() -> None:
    card = detector_card("test", (64, 64), "letterbox", "imagenet")
    anchors = torch.tensor([[10.0, 20.0, 12.0, 28.0], [11.0, 20.0, 12.0, 28.0], [60.0, 40.0, 20.0, 28.0]])
    logits = torch.tensor([[[0.0, 2.0], [0.0, 1.0], [0.0, -1.0]]])
    found = detections(*decode_heads(logits, torch.zeros(1, 3, 4), anchors), card)[0]
    assert found.boxes.tolist() == [[4.0, 6.0, 16.0, 34.0], [50.0, 26.0, 64.0, 54.0]]
    assert found.scores.tolist() == pytest.approx([1 / (1 + np.exp(-2)), 1 / (1 + np.e)])


def test_normalisation_is_that_of_the_card() -> None:
    module = Detector(
        trunk="mobilenet_v3_small", height=64, width=64, anchors=[[(12, 28)], [(20, 50)], [(30, 60)]], channels=16
    ).eval()
    image = torch.randint(0, 256, (1, 64, 64, 3), dtype=torch.uint8)
    mean, std = (torch.tensor(v).view(1, 3, 1, 1) for v in (module.card.mean, module.card.std))
    expected = module.network(((image.permute(0, 3, 1, 2) / 255) - mean) / std)
    assert torch.allclose(module(image)[0], expected[0], atol=1e-5)


@pytest.mark.parametrize("optimiser", ["adamw", "sgd"])
@pytest.mark.parametrize("rate", [0.0, 0.25, 1.0])
def test_features_learn_at_their_own_rate(
    rate: float, optimiser: Literal["adamw", "sgd"], monkeypatch: pytest.MonkeyPatch
) -> None:
    module = Detector(
        trunk="mobilenet_v3_small",
        height=64,
        width=64,
        anchors=[[(12, 28)], [(20, 50)], [(30, 60)]],
        channels=16,
        learning_rate=0.01,
        optimisation=DetectorOptimisation(optimiser=optimiser, features_rate=rate),
    )
    monkeypatch.setattr(Detector, "trainer", SimpleNamespace(estimated_stepping_batches=10))
    groups = module.configure_optimizers()["optimizer"].param_groups  # type: ignore[index]
    # At the end of the warm-up.
    rates = {id(p): group["initial_lr"] for group in groups for p in group["params"]}
    network = module.network
    heads = [*network.class_heads.parameters(), *network.box_heads.parameters()]
    assert len(rates) == len(list(network.parameters()))
    assert {rates[id(p)] for p in heads} == {0.01}
    assert {rates[id(p)] for p in network.features.parameters()} == {0.01 * rate}


def test_modules_and_data_work_with_a_trainer_of_ones_own(tmp_path: Path) -> None:
    walks = [TrainingSource(str(sequence(tmp_path / "walk")))]
    data = DetectionData(walks, walks, batch_size=3, batches=2, workers=0)
    anchors: list[list[tuple[float, float]]] = [[(12, 28)], [(20, 50)], [(30, 60)]]
    model = Detector(
        trunk="mobilenet_v3_small",
        height=64,
        width=64,
        anchors=anchors,
        channels=16,
        optimisation=DetectorOptimisation(warmup_steps=1),
    )
    trainer = lightning.Trainer(
        max_epochs=1, accelerator="cpu", logger=False, default_root_dir=tmp_path, enable_progress_bar=False
    )
    trainer.fit(model, data)
    (validated,), (tested,) = trainer.validate(model, data), trainer.test(model, data)
    assert tested == {name.replace("val/", "test/"): value for name, value in validated.items()}
    assert "test/ap50" in tested
