"""Training action streams on generated clips, and exporting them."""

from __future__ import annotations

import csv
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import lightning
import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional

from tsuiseki.datamodules.action import ActionBatch
from tsuiseki.models import action
from tsuiseki.models.backbones import Trunk
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import STREAMS, ActionRecogniser, averaged
from tsuiseki.tracking.formats.okutama import OKUTAMA_ACTIONS
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.trainers.action import Action
from tsuiseki.trainers.exporting import written_networks
from tsuiseki.trainers.exporting.export import ModelFiles, load_module
from tsuiseki.trainers.exporting.export_networks import export_action
from tsuiseki.trainers.fit import fit_action
from tsuiseki.trainers.task_cli import ACTION, TaskCLI

TRAINED = ("rgb_local", "flow_global")


def options(clips: Path, folder: Path, *more: str) -> list[str]:
    """A training of seconds."""
    groups = {
        "data": {
            "train": f"[{clips / 'train'}]",
            "val": f"[{clips / 'okutama'}]",
            "cache": folder / "cache",
            "batch_size": 16,
            "batches": 15,
            "cutting.step": 2,
        },
        "trainer": {"accelerator": "cpu", "max_epochs": 4, "use_distributed_sampler": "false"},
        "model": {
            "trunk": "mobilenet_v3_small", "size": 32, "dropout": 0.2,
            "learning_rate": 0.003, "optimisation": "{warmup_steps: 5}",
            "streams": "[rgb_local,flow_global]", "flow": "dis_fast",
        },
    }  # fmt: skip
    groups["trainer"]["num_sanity_val_steps"] = 0
    return [f"--{g}.{k}={v}" for g, values in groups.items() for k, v in values.items()] + list(more)


@pytest.fixture(scope="module")
def trained(acting_clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished training."""
    folder = tmp_path_factory.mktemp("action")
    fit_action(options(acting_clips, folder, f"--out={folder / 'out'}"))
    return folder


@pytest.fixture(scope="module")
def exported(trained: Path) -> list[Path]:
    """The files of its streams."""
    done = export_action(
        ModelFiles(out=trained / "action.onnx", training_data="coloured boxes"), trained / "out/checkpoints/last.ckpt"
    )
    return list(done)


@pytest.mark.slow
def test_training_learns_and_logs_every_stream(trained: Path) -> None:
    with (trained / "out/metrics/version_0/metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    loss = [float(row["train/loss"]) for row in rows if row["train/loss"]]
    assert loss[-1] < 0.75 * loss[0]
    last = [row for row in rows if row["val/map"]][-1]
    # Three of twelve actions occur; guessing by how often gives 0.33.
    assert float(last["val/map"]) > 0.6
    assert {f"val/map_{name}" for name in TRAINED} <= last.keys()


@pytest.mark.slow
def test_exported_streams_say_what_the_trained_ones_say(
    exported: list[Path], trained: Path, acting_clips: Path
) -> None:
    recogniser = ActionRecogniser(exported, threads=1)
    assert recogniser.streams == TRAINED
    assert {one.flow for one in recogniser.inputs} == {"dis_fast"}
    assert recogniser.names == OKUTAMA_ACTIONS
    assert {OnnxModel(path, "action").card.training_data for path in exported} == {"coloured boxes"}
    paths = sorted((acting_clips / "validation/validation-0/img1").glob("*.jpg"))[4:6]
    images = [np.asarray(cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB), dtype=np.uint8) for path in paths]
    boxes = np.array([[40, 4, 54, 28], [-5, 100, 20, 150], [60, 34, 74, 58.0]])
    found = recogniser.recognise(images, boxes)
    assert found.shape == (2, 3, 12)
    module = load_module(Action, trained / "out/checkpoints/last.ckpt")
    assert module.names == OKUTAMA_ACTIONS
    crops = {name: torch.from_numpy(c) for name, c in crops_of(recogniser, images, boxes).items()}
    with torch.no_grad():
        logits = module(crops)
    for n, name in enumerate(TRAINED):
        np.testing.assert_allclose(found[n], logits[name].sigmoid().numpy(), atol=2e-4)
    np.testing.assert_allclose(averaged(found), found.mean(axis=0), atol=1e-6)
    # Without a frame before there is no flow, which is not an error.
    assert np.isfinite(recogniser.recognise(images[1:], boxes)).all()
    assert recogniser.recognise(images, np.empty((0, 4))).shape == (2, 0, 12)


def crops_of(recogniser: ActionRecogniser, images: list[np.ndarray], boxes: np.ndarray) -> dict[str, np.ndarray]:  # type: ignore[type-arg]
    from tsuiseki.tracking.features.action import crop_squares, square_boxes

    pictures = {True: recogniser.flow(images), False: images[-1]}
    return {
        one.stream: crop_squares(pictures[one.is_flow], square_boxes(boxes, one.scale), one.size)
        for one in recogniser.inputs
    }


@pytest.mark.slow
def test_streams_that_do_not_belong_together_are_refused(exported: list[Path], tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="one file a stream"):
        ActionRecogniser([exported[0], exported[0]])
    with pytest.raises(RequestError, match="at least one"):
        ActionRecogniser([])
    weights = Path(str(resources.files("tsuiseki.tracking"))) / "weights/appearance_people.onnx"
    with pytest.raises(RequestError, match="kind 'action'"):
        ActionRecogniser([weights])
    with pytest.raises(RequestError, match="ONNX file"):
        ActionRecogniser([tmp_path / "none.onnx"])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:(?s).*deprecated in v4")
@pytest.mark.parametrize(
    ("name", "trunk", "size"),
    [("action_drone", 576, 64), ("action_thesis", 2048, 224)],
)
def test_configurations_build_what_they_say(name: str, trunk: int, size: int, tmp_path: Path) -> None:
    config = Path(str(resources.files("tsuiseki.configs"))) / f"{name}.yaml"
    small = ["--model.streams=[rgb_local,flow_global]", "--model.fused=false"]
    words = ["--config", str(config), "--out", str(tmp_path), "--trainer.accelerator", "cpu", *small]
    words += ["--model.weights", "null", "--trainer.precision", "32"]
    words += [f"--data.{part}={tmp_path}" for part in ("train", "val")]
    cli = TaskCLI(ACTION, words, run=False)
    cli.datamodule.trainer = cli.trainer
    cli.trainer.strategy.connect(cli.model)
    assert (cli.model.rare_weight == 0, cli.datamodule.rarity == 0) == 2 * (name == "action_thesis",)
    assert cli.datamodule.cutting.size == size == cli.model.inputs["rgb_local"].size
    if name == "action_thesis":
        steps = cli.model.optimisation
        # A rate that stays, as 5.4.2 names nothing else.
        assert (steps.optimiser, steps.weight_decay, steps.warmup_steps, steps.final_share) == ("sgd", 0, 0, 1)
        assert cli.trainer.gradient_clip_val is None
        assert cli.datamodule.batch_size * cli.trainer.max_epochs * cli.datamodule.batches == 16 * 5000
    assert cli.datamodule.streams == ("rgb_local", "flow_global")
    assert cli.model.network.streams["rgb_local"].trunk.channels[-1] == trunk


@pytest.mark.slow
def test_request_errors(acting_clips: Path, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="no_such_key"):
        fit_action(options(acting_clips, tmp_path, f"--out={tmp_path / 'o'}", "--model.no_such_key=1"))
    with pytest.raises(RequestError, match="12: Handshaking"):
        fit_action(options(acting_clips, tmp_path, f"--out={tmp_path / 'o'}", "--model.actions=5"))
    with pytest.raises(RequestError, match="expected a checkpoint at"):
        export_action(ModelFiles(out=tmp_path / "a.onnx"), tmp_path / "none.ckpt")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:(?s).*deprecated in v4")
def test_the_thesis_configuration_trains_on_okutama_s_layout(acting_clips: Path, tmp_path: Path) -> None:
    """A step of one stream at full size, TV-L1 flow included; what a GPU would do five thousand times."""
    config = Path(str(resources.files("tsuiseki.configs"))) / "action_thesis.yaml"
    small = {
        "out": tmp_path / "out",
        "trainer.accelerator": "cpu",
        "trainer.precision": 32,
        "trainer.max_epochs": 1,
        "trainer.limit_val_batches": 1,
        "model.weights": "null",
        "model.streams": "[flow_global]",
        "model.fused": "false",
        "data.train": f"[{acting_clips / 'okutama'}]",
        "data.val": f"[{acting_clips / 'validation'}]",
        "data.cache": tmp_path / "cache",
        "data.cutting.step": 10,
        "data.batch_size": 2,
        "data.batches": 1,
        "data.workers": 0,
    }
    best = fit_action(["--config", str(config), *(f"--{name}={value}" for name, value in small.items())])
    module = load_module(Action, best)
    assert module.inputs["flow_global"].flow == "tv-l1"
    assert module.names == OKUTAMA_ACTIONS


def tiny_trunk(*_: object) -> Trunk:
    """Three convolutions in place of a classifier's."""
    return Trunk([nn.Conv2d(c, 4, 3, 2, 1) for c in (3, 4, 4)], (4, 4, 4))


@pytest.mark.slow
def test_streams_that_learn_jointly_are_exported_as_one_file_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(action, "build_trunk", tiny_trunk)
    torch.manual_seed(0)
    module = Action(actions=3, size=16, dropout=0.0, fused=True)
    crops = {n: torch.randint(0, 256, (2, 16, 16, i.channels), dtype=torch.uint8) for n, i in module.inputs.items()}
    truth = torch.tensor([[1.0, 0, 0], [0, 1, 1]])
    monkeypatch.setattr(module, "log", lambda *_, **__: None)
    mean = torch.stack([logits.sigmoid() for logits in module(crops).values()]).mean(dim=0)
    expected = functional.binary_cross_entropy(mean, truth)
    torch.testing.assert_close(module.training_step(ActionBatch(crops, truth), 0), expected)

    trainer = lightning.Trainer(accelerator="cpu", logger=False, enable_progress_bar=False)
    trainer.strategy.connect(module)
    trainer.save_checkpoint(tmp_path / "best.ckpt")
    real, fused = written_networks.export_onnx, tmp_path / "a_fused.onnx"

    def export_fused_alone(network: nn.Module, *given: Any) -> float:
        return real(network, *given) if isinstance(network, action.FusedProbability) else 0.0

    monkeypatch.setattr(written_networks, "export_onnx", export_fused_alone)
    monkeypatch.setattr(ModelFiles, "report", lambda *_: None)
    written = export_action(ModelFiles(out=tmp_path / "a.onnx"), tmp_path / "best.ckpt")
    assert set(written) == {fused, *(tmp_path / f"a_{name}.onnx" for name in STREAMS)}
    one = ActionRecogniser([fused], threads=1)
    assert one.streams == STREAMS
    rng = np.random.default_rng(0)
    images, boxes = list(rng.integers(0, 256, (2, 48, 64, 3), np.uint8)), np.array([[5, 4, 20, 40], [40, 2, 70, 30.0]])
    given = {name: torch.from_numpy(c) for name, c in crops_of(one, images, boxes).items()}
    with torch.no_grad():
        mean = torch.stack([logits.sigmoid() for logits in module.eval()(given).values()]).mean(dim=0)
    np.testing.assert_allclose(one.recognise(images, boxes), mean[None], atol=1e-5)
    with pytest.raises(RequestError, match="one file a stream, or one of all"):
        ActionRecogniser([fused, fused])
    with pytest.raises(RequestError, match="with `fused`, got rgb_local"):
        Action(streams=("rgb_local",), fused=True)
