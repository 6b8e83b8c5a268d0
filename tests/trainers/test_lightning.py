"""`tsuiseki.training`: each network does what users of Lightning expect, from three lines of Python."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import lightning
import numpy as np
import pytest
import torch
from lightning.pytorch.callbacks import (
    Callback,
    EarlyStopping,
    EMAWeightAveraging,
    LearningRateFinder,
    StochasticWeightAveraging,
)
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger

import tsuiseki
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.features.action import STREAMS
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.trainers.fit import fit_detector
from tsuiseki.training import (
    Action,
    ActionData,
    Appearance,
    AppearanceData,
    Association,
    AssociationData,
    DetectionData,
    Detector,
    Tracker,
    TrackerData,
)

pytestmark = [
    pytest.mark.filterwarnings("ignore::UserWarning"),
    pytest.mark.filterwarnings("ignore::lightning.fabric.utilities.rank_zero.LightningDeprecationWarning"),
]
ANCHORS: list[list[tuple[float, float]]] = [[(12, 28)], [(20, 50)], [(30, 60)]]


def crowd(folder: Path, frames: int = 40, people: int = 6, views: int = 1000) -> Path:
    """People of different colours who sway a little; each is labelled in ``views`` frames at most."""
    (folder / "img1").mkdir(parents=True)
    rows: dict[str, list[str]] = {"gt": [], "det": []}
    for frame in range(frames):
        image = np.full((64, 128, 3), 200, np.uint8)
        for person in range(people):
            x = 5 + 18 * person + frame % 5
            image[18:46, x : x + 12] = (40 * person, 255 - 40 * person, 90)
            if (frame + person) % frames < views:
                rows["gt"].append(f"{frame + 1},{person + 1},{x + 1},19,12,28,1,1,1")
            rows["det"].append(f"{frame + 1},-1,{x + 1},19,12,28,0.9,-1,-1,-1")
        cv2.imwrite(str(folder / "img1" / f"{frame + 1:06d}.png"), image)
    for name, lines in rows.items():
        (folder / name).mkdir()
        (folder / name / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return crowd(tmp_path_factory.mktemp("crowd") / "street")


def detector(**changes: Any) -> Detector:
    small: dict[str, Any] = {"trunk": "mobilenet_v3_small", "height": 64, "width": 128, "anchors": ANCHORS}
    return Detector(**{**small, "channels": 16, **changes})


class Network(NamedTuple):
    """How a module and its data are made, and the score that validation logs."""

    module: Callable[[], Any]
    data: Callable[[Path, Path], Any]
    score: str


NETWORKS = {
    "detector": Network(detector, lambda street, _: DetectionData(street, batch_size=2, batches=4, workers=0), "ap50"),
    "appearance": Network(
        lambda: Appearance(height=32, width=16),
        lambda street, _: AppearanceData(str(street), val_share=0.3, batch_size=8, views=2, batches=4),
        "map",
    ),
    "action": Network(
        lambda: Action(trunk="mobilenet_v3_small", streams=("rgb_local",), size=32, flow="dis_fast"),
        lambda _, clips: ActionData(clips / "train", batch_size=4, batches=4),
        "map",
    ),
    "association": Network(Association, lambda street, _: AssociationData(street, batches=4, seconds=0.5), "agreement"),
    "tracker": Network(
        lambda: Tracker(channels=16), lambda *_: TrackerData(batch_size=2, batches=4, validation=4), "overlap"
    ),
}
# Pairs for the tracker are drawn at about a hundredth of a second each.
each_network = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name == "tracker" else name for name in NETWORKS]
)
# Several trainings of networks of pictures take over two seconds.
each_network_longer = pytest.mark.parametrize(
    "name",
    [name if name == "association" else pytest.param(name, marks=pytest.mark.slow) for name in NETWORKS],
)


@pytest.fixture
def made(name: str, street: Path, acting_clips: Path) -> Callable[[], tuple[Any, Any]]:
    """Makes the module and the data of a network."""
    network = NETWORKS[name]
    return lambda: (network.module(), network.data(street, acting_clips))


def trainer(folder: Path, *callbacks: Callback, **changes: Any) -> lightning.Trainer:
    quiet: dict[str, Any] = {"enable_progress_bar": False, "enable_model_summary": False, "logger": False}
    quiet |= {"enable_checkpointing": False, "max_epochs": 1, "accelerator": "cpu", "default_root_dir": folder}
    return lightning.Trainer(callbacks=list(callbacks), **{**quiet, **changes})


@each_network_longer
def test_fit_validate_test_predict_load_and_go_on(
    name: str, made: Callable[[], tuple[Any, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    module, data = made()
    training, score = trainer(tmp_path), NETWORKS[name].score
    before = [value.clone() for value in module.network.parameters()]
    training.fit(module, data)
    assert any(not torch.equal(old, new) for old, new in zip(before, module.network.parameters(), strict=True))
    (validated,) = training.validate(module, data, verbose=False)
    (tested,) = training.test(module, data, verbose=False)
    assert 0 <= validated[f"val/{score}"] <= 1
    assert tested == {key.replace("val/", "test/"): value for key, value in validated.items()}
    predicted = training.predict(module, data)
    kind = Detections if name == "detector" else np.ndarray
    assert predicted
    assert all(isinstance(batch, kind) for batch in predicted)
    training.save_checkpoint(tmp_path / "a.ckpt")
    again = type(module).load_from_checkpoint(tmp_path / "a.ckpt")
    assert all(torch.equal(value, again.state_dict()[key]) for key, value in module.state_dict().items())
    resumed = trainer(tmp_path, max_epochs=2)
    resumed.fit(*made(), ckpt_path=tmp_path / "a.ckpt")
    assert resumed.global_step == 2 * training.global_step
    # No file is written that nobody asked for.
    assert [path.name for path in tmp_path.iterdir()] == ["a.ckpt"]


OPTIONS: dict[str, dict[str, Any]] = {
    "fast_dev_run": {"fast_dev_run": True},
    "limited": {"limit_train_batches": 2, "limit_val_batches": 1},
    "overfit": {"overfit_batches": 2, "max_epochs": 2},
    "bf16": {"precision": "bf16-mixed"},
}


@pytest.mark.slow
@each_network
@pytest.mark.parametrize("option", OPTIONS)
def test_options_of_the_trainer_work(
    option: str, name: str, made: Callable[[], tuple[Any, Any]], tmp_path: Path
) -> None:
    del name
    training = trainer(tmp_path, **OPTIONS[option])
    training.fit(*made())
    assert training.global_step == {"fast_dev_run": 1, "limited": 2, "overfit": 4, "bf16": 4}[option]


@each_network
def test_a_few_batches_are_learnt_by_heart(name: str, made: Callable[[], tuple[Any, Any]], tmp_path: Path) -> None:
    """With overfit_batches each epoch has the same samples."""
    del name
    seen: list[list[Any]] = [[], []]

    class Keep(Callback):
        def on_train_batch_start(self, trainer: lightning.Trainer, pl_module: Any, batch: Any, batch_idx: int) -> None:
            del pl_module, batch_idx
            if not isinstance(batch, tuple):
                seen[trainer.current_epoch].append(torch.as_tensor(batch.detections.costs))
            else:
                first = batch[0]
                seen[trainer.current_epoch].append(first if isinstance(first, torch.Tensor) else first["rgb_local"])

    trainer(tmp_path, Keep(), overfit_batches=2, max_epochs=2, limit_val_batches=0).fit(*made())
    assert len(seen[0]) == len(seen[1]) == 2
    assert all(torch.equal(first, later) for first, later in zip(*seen, strict=True))


def callbacks_of(score: str) -> list[Callback]:
    return [EarlyStopping(f"val/{score}", mode="max", patience=5), EMAWeightAveraging(decay=0.5)]


@each_network_longer
def test_callbacks_and_loggers_work(name: str, made: Callable[[], tuple[Any, Any]], tmp_path: Path) -> None:
    score = NETWORKS[name].score
    logs = [CSVLogger(tmp_path, "csv"), TensorBoardLogger(str(tmp_path), "board")]
    trainer(tmp_path, *callbacks_of(score), logger=logs, log_every_n_steps=1).fit(*made())
    assert f"val/{score}" in (tmp_path / "csv" / "version_0" / "metrics.csv").read_text()
    assert list((tmp_path / "board" / "version_0").glob("events*"))
    averaging = trainer(tmp_path, StochasticWeightAveraging(1e-3, swa_epoch_start=1), max_epochs=2)
    averaging.fit(*made())
    # Lightning may pass over the batches once more, for the statistics of normalisations.
    assert averaging.global_step >= 8


@each_network_longer
def test_the_learning_rate_is_found(name: str, made: Callable[[], tuple[Any, Any]], tmp_path: Path) -> None:
    del name
    module, data = made()
    finder = LearningRateFinder(min_lr=1e-6, max_lr=1e-2, num_training_steps=40)
    before = module.learning_rate
    trainer(tmp_path, finder, limit_val_batches=0).fit(module, data)
    assert finder.optimal_lr is not None
    suggested = finder.optimal_lr.suggestion()
    assert module.learning_rate == (before if suggested is None else suggested)


@each_network
@pytest.mark.slow
def test_export_gives_what_torch_gives(name: str, made: Callable[[], tuple[Any, Any]], tmp_path: Path) -> None:
    module, data = made()
    trainer(tmp_path, fast_dev_run=True).fit(module, data)
    out = tmp_path / f"{name}.onnx"
    differences = module.export(out, training_data="a crowd")
    worst = max(differences.values()) if isinstance(differences, dict) else differences
    assert worst < 1e-3
    with pytest.raises(RequestError, match="already exists"):
        module.export(out)
    example = module.example_input_array
    inputs = example if isinstance(example, tuple) else (example,)
    program = torch.export.export(module.eval(), inputs)
    expected, got = (
        torch.utils._pytree.tree_leaves(module(*inputs)),
        torch.utils._pytree.tree_leaves(program.module()(*inputs)),
    )
    for a, b in zip(expected, got, strict=True):
        torch.testing.assert_close(a, b)
    module.to_onnx(tmp_path / "lightning.onnx", dynamo=True, verbose=False)
    assert (tmp_path / "lightning.onnx").is_file()


@each_network
@pytest.mark.slow
def test_a_network_is_compiled(name: str, made: Callable[[], tuple[Any, Any]], tmp_path: Path) -> None:
    del name
    module, data = made()
    example = module.example_input_array
    inputs = example if isinstance(example, tuple) else (example,)
    expected = torch.utils._pytree.tree_leaves(module.eval()(*inputs))
    module.network.compile(backend="eager")
    for a, b in zip(torch.utils._pytree.tree_leaves(module(*inputs)), expected, strict=True):
        torch.testing.assert_close(a, b)
    training = trainer(tmp_path, fast_dev_run=True)
    training.fit(module, data)
    assert training.global_step == 1


SCRIPT = """
import sys, lightning, torch
sys.path.insert(0, {root!r})
from tests.trainers.test_lightning import NETWORKS, trainer
from pathlib import Path
network = NETWORKS[{name!r}]
training = trainer(Path({out!r}), devices=2, strategy="ddp", logger=False)
module = network.module()
training.fit(module, network.data(Path({street!r}), Path({clips!r})))
weights = sum(float(p.double().abs().sum()) for p in module.parameters())
(scores,) = training.validate(module, network.data(Path({street!r}), Path({clips!r})), verbose=False)
result = f"{{training.global_step}} {{weights}} {{sorted(scores.items())}}"
Path({out!r}, f"rank-{{training.global_rank}}.txt").write_text(result)
"""


@each_network
@pytest.mark.slow
def test_two_processes_learn_the_same_weights(name: str, street: Path, acting_clips: Path, tmp_path: Path) -> None:
    script = tmp_path / "ddp.py"
    places = {"street": str(street), "clips": str(acting_clips), "out": str(tmp_path)}
    script.write_text(SCRIPT.format(root=str(Path(__file__).parents[2]), name=name, **places))
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    first, second = (path.read_text() for path in sorted(tmp_path.glob("rank-*.txt")))
    # Four batches over two devices.
    assert first.startswith("2 ")
    assert first == second


@pytest.mark.slow
def test_predictions_are_those_of_the_exported_detector(street: Path, tmp_path: Path) -> None:
    module, data = Detector(start="people", height=96, width=192), DetectionData(street)
    predicted: Any = trainer(tmp_path).predict(module, data)
    assert len(predicted) == 4
    module.export(tmp_path / "detector.onnx")
    images = [read_image(path) for path in sorted((street / "img1").iterdir())[-4:]]
    for mine, theirs in zip(predicted, exported.Detector(tmp_path / "detector.onnx").detect(images), strict=True):
        np.testing.assert_allclose(mine.boxes, theirs.boxes, atol=1e-3)
        np.testing.assert_allclose(mine.scores, theirs.scores, atol=1e-4)


@pytest.mark.slow
def test_python_learns_what_the_command_learns(street: Path, tmp_path: Path) -> None:
    """The same weights, bit for bit, from ``start="people"`` and from ``--data`` with that start."""
    words = [
        "--model.start=people",
        "--model.height=64",
        "--model.width=128",
        "--data.batch_size=2",
        "--data.batches=3",
    ]
    words += ["--trainer.max_epochs=1", "--trainer.accelerator=cpu", "--data.workers=0"]
    last = fit_detector(["--data", str(street), f"--out={tmp_path / 'out'}", *words])
    assert last is not None
    assert exported.Detector(tmp_path / "out" / "detector.onnx").input_size == (64, 128)
    lightning.seed_everything(0, verbose=False)
    module = Detector(start="people", height=64, width=128)
    data = DetectionData(street, val_share=0.1, batch_size=2, batches=3, workers=0)
    averaged = EMAWeightAveraging(decay=0.98)
    trainer(tmp_path, averaged, gradient_clip_val=5.0, num_sanity_val_steps=0).fit(module, data)
    weights = torch.load(last, weights_only=True)["state_dict"]
    assert all(torch.equal(value, weights[name]) for name, value in module.state_dict().items())


@pytest.mark.slow
def test_one_call_gives_an_exported_file(street: Path, acting_clips: Path, tmp_path: Path) -> None:
    detector = tsuiseki.train_detector(street, tmp_path / "d", epochs=1, batches=1)
    assert exported.Detector(detector).input_size == (480, 640)
    appearance = tsuiseki.train_appearance(street, tmp_path / "a", epochs=1, batches=1)
    assert exported.Appearance(appearance).model.card.feature_length == 128
    association = tsuiseki.train_association(street, tmp_path / "b", epochs=1, batches=2)
    assert association == tmp_path / "b" / "association.onnx"
    assert association.is_file()
    streams = tsuiseki.train_action(acting_clips / "train", tmp_path / "c", epochs=1, batches=1)
    assert [path.name for path in streams] == [f"action_{name}.onnx" for name in STREAMS]
    with pytest.raises(RequestError, match="already holds a training"):
        tsuiseki.train_association(street, tmp_path / "b")


def test_nobody_is_rendered_who_was_not_asked_for(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tsuiseki.datamodules.appearance.render_people", lambda *_: pytest.fail("people are rendered"))
    data = AppearanceData(street, val_share=0.3, height=32, width=16)
    data.prepare_data()
    data.setup("fit")
    assert len(np.unique(data.train_crops.ids)) == 4
    assert len(np.unique(data.validation_crops.ids)) == 2
    assert list(tmp_path.iterdir()) == []
