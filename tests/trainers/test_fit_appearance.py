"""Training an appearance network on rendered people, and exporting it."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from tsuiseki.models import appearance
from tsuiseki.models.backbones import Trunk
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.features.exported import crop_boxes
from tsuiseki.trainers.appearance import Appearance
from tsuiseki.trainers.exporting.export import ModelFile, load_module
from tsuiseki.trainers.exporting.export_networks import export_appearance
from tsuiseki.trainers.fit import fit_appearance
from tsuiseki.trainers.task_cli import APPEARANCE, TaskCLI

pytestmark = pytest.mark.slow


def options(folder: Path, *more: str) -> list[str]:
    """A training of seconds: twelve people, 64x32 pixels, and eight more to validate on."""
    data = {
        "rendered.file": folder / "people.npz",
        "rendered.identities": 20,
        "rendered.views": 6,
        "rendered.validation": 8,
        "batch_size": 18,
        "views": 3,
        "batches": 25,
    }
    trainer = {"accelerator": "cpu", "max_epochs": 4, "use_distributed_sampler": "false", "num_sanity_val_steps": 0}
    model = {"height": 64, "width": 32, "feature_length": 32, "optimisation.warmup_steps": 10}
    groups = {"data": data, "trainer": trainer, "model": model}
    return [f"--{g}.{k}={v}" for g, values in groups.items() for k, v in values.items()] + list(more)


def three_convolutions(*_: object) -> Trunk:
    """A trunk with the strides of all trunks that learns on a CPU in seconds."""

    def stage(before: int, after: int, stride: int) -> nn.Sequential:
        return nn.Sequential(nn.Conv2d(before, after, stride, stride), nn.BatchNorm2d(after), nn.ReLU())

    return Trunk([stage(3, 16, 8), stage(16, 24, 2), stage(24, 32, 2)], (16, 24, 32))


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of a finished training. While a test uses it, every network has the small trunk."""
    folder = tmp_path_factory.mktemp("appearance")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(appearance, "build_trunk", three_convolutions)
        assert main(["train", "appearance", *options(folder, f"--out={folder / 'out'}")]) == 0
        yield folder


def column(folder: Path, name: str) -> list[float]:
    with (folder / "out" / "metrics" / "version_0" / "metrics.csv").open() as file:
        return [float(row[name]) for row in csv.DictReader(file) if row[name]]


def test_training_learns_and_logs(trained: Path) -> None:
    loss = column(trained, "train/loss")
    assert loss[-1] < 0.9 * loss[0]
    # Eight people with four gallery views each: chance finds one in eight.
    assert column(trained, "val/rank1")[-1] > 0.3
    assert max(column(trained, "val/map")) > 0.3
    assert (trained / "out" / "checkpoints" / "best.ckpt").is_file()


def test_exported_network_describes_as_the_trained_one(trained: Path, tmp_path: Path) -> None:
    checkpoint = trained / "out" / "checkpoints" / "best.ckpt"
    path = tmp_path / "a.onnx"
    words = ["--checkpoint", str(checkpoint), "--out", str(path), "--training-data", "rendered people"]
    assert main(["export", "appearance", *words]) == 0
    network_file = exported.Appearance(path, threads=1)
    card = network_file.model.card
    assert (card.input_height, card.input_width, card.feature_length) == (64, 32, 32)
    assert card.training_data == "rendered people"
    image = np.random.default_rng(0).integers(0, 256, (80, 90, 3)).astype(np.uint8)
    boxes = np.array([[0, 0, 30, 60], [20, 10, 60, 80], [50, 5, 89, 70.0]])
    features = network_file.describe(image, boxes)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, atol=1e-5)
    network = load_module(Appearance, checkpoint).eval()
    with torch.no_grad():
        expected = network(torch.from_numpy(crop_boxes(image, boxes, 64, 32))).numpy()
    np.testing.assert_allclose(features, expected, atol=1e-4)


@pytest.mark.filterwarnings("ignore:(?s).*deprecated in v4")
@pytest.mark.parametrize("name", ["appearance_scenes", "appearance_mot", "appearance_mars"])
def test_configurations_build_what_they_say(name: str, tmp_path: Path) -> None:
    config = Path(str(resources.files("tsuiseki.configs"))) / f"{name}.yaml"
    words = ["--config", str(config), "--out", str(tmp_path), "--trainer.accelerator", "cpu"]
    words += [f"--data.{part}={tmp_path}" for part in ("train", "val") if name == "appearance_mars"]
    words += [f"--data.train={tmp_path}"] if name == "appearance_mot" else []
    cli = TaskCLI(APPEARANCE, words, run=False)
    cli.datamodule.trainer = cli.trainer
    cli.trainer.strategy.connect(cli.model)
    images = torch.zeros(2, *cli.datamodule.size, 3, dtype=torch.uint8)
    with torch.no_grad():
        features = cli.model.eval()(images)
    assert features.shape == (2, cli.model.card.feature_length)
    assert (cli.model.card.input_height, cli.model.card.input_width) == cli.datamodule.size


def test_request_errors(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="no_such_key"):
        fit_appearance(options(tmp_path, f"--out={tmp_path / 'o'}", "--model.no_such_key=1"))
    with pytest.raises(RequestError, match="trunk"):
        fit_appearance(options(tmp_path, f"--out={tmp_path / 'o'}", "--model.trunk=alexnet"))
    with pytest.raises(RequestError, match="expected a checkpoint at"):
        export_appearance(ModelFile(out=tmp_path / "a.onnx"), tmp_path / "none.ckpt")
    (tmp_path / "foreign.ckpt").write_bytes(b"not a checkpoint")
    with pytest.raises(RequestError, match=r"foreign\.ckpt"):
        export_appearance(ModelFile(out=tmp_path / "a.onnx"), tmp_path / "foreign.ckpt")
    assert not (tmp_path / "a.onnx").exists()
