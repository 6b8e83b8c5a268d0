"""What cannot be trained is refused in a line, before the first batch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from tests.trainers.test_lightning import crowd, detector, trainer
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.weights import shipped
from tsuiseki.training import (
    Action,
    ActionData,
    Appearance,
    AppearanceData,
    Association,
    AssociationData,
    DetectionData,
    Detector,
)

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return crowd(tmp_path_factory.mktemp("crowd") / "street")


def refused(call: Callable[[], object], message: str) -> None:
    with pytest.raises(RequestError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("module", "data"),
    [(detector, DetectionData), (Appearance, AppearanceData), (Action, ActionData), (Association, AssociationData)],
)
def test_an_unknown_layout_and_a_missing_folder(module: Any, data: Any, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no labels")
    training = trainer(tmp_path)
    refused(lambda: training.fit(module(), data(tmp_path)), "expected labelled video, such as .*; found none")
    refused(lambda: data(tmp_path / "nowhere"), "`train`: expected labelled video at .*nowhere, found none")
    refused(lambda: data(3), "`train`: expected a path, got int")
    refused(lambda: data([]), "expected at least one folder of labelled video, got none")


def test_no_box_of_the_class(street: Path, tmp_path: Path) -> None:
    refused(
        lambda: trainer(tmp_path).fit(detector(classes=["giraffe"]), DetectionData(street)),
        "`classes`: expected classes of .*gt.txt .*, got giraffe",
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trunk": "resnet18"}, "`trunk`: expected that of the `start` .*, mobilenet_v3_large_075, got resnet18"),
        ({"channels": 32}, "`channels`: expected that of the `start` .*, 96, got 32; leave it out"),
        ({"architecture": "ssd300"}, "`architecture`: expected that of the `start` .*, people, got ssd300"),
        ({"normalisation": "bytes"}, "`normalisation`: expected that of the `start`"),
        ({"weights": "imagenet"}, "expected one of `start` and `weights`, got both"),
        ({"height": 500}, "an input whose sides divide by 32; got anchors for 3 maps and 640x500"),
    ],
)
def test_what_contradicts_the_start(changes: dict[str, Any], message: str) -> None:
    refused(lambda: Detector(start="people", **changes), message)


def test_classes_that_contradict_the_start(tmp_path: Path) -> None:
    two = detector(classes=["person", "car"])
    trainer(tmp_path).strategy.connect(two)
    checkpoint = tmp_path / "two.ckpt"
    torch.save({"state_dict": two.state_dict(), "hyper_parameters": dict(two.hparams)}, checkpoint)
    refused(
        lambda: Detector(start=checkpoint, classes=["person", "dog"]),
        r"`classes`: expected that of the `start` .*two.ckpt, \['person', 'car'\], got \['person', 'dog'\]",
    )
    again = Detector(start=str(checkpoint))
    assert again.card.class_names == ("person", "car")
    assert all(torch.equal(value, again.state_dict()[name]) for name, value in two.state_dict().items())


def test_a_start_of_which_too_little_fits(tmp_path: Path) -> None:
    module = detector()
    state = {name: value for name, value in module.state_dict().items() if "trunk" not in name}
    checkpoint = tmp_path / "half.ckpt"
    torch.save({"state_dict": state, "hyper_parameters": dict(module.hparams)}, checkpoint)
    refused(
        lambda: Detector(start=checkpoint),
        r"`start`: expected weights for 90% of the (\d+) tensors of this detector, got \d+ from .*half.ckpt",
    )


@pytest.mark.slow
def test_a_start_takes_over_everything() -> None:
    """Without the parts of its file 270 of 373 tensors would stay random."""
    module = Detector(start="people")
    assert module.hparams["trunk"] == "mobilenet_v3_large_075"
    assert (module.card.input_height, module.card.input_width) == (480, 640)
    assert module.hparams["channels"] == 96
    assert [len(level) for level in module.hparams["anchors"]] == [3, 2, 3]
    module.eval()
    assert module.learning_rate == 1e-3


@pytest.mark.parametrize("kind", [Detector, Appearance, Action, Association])
def test_the_checkpoint_of_another_network(kind: Any, street: Path, acting_clips: Path, tmp_path: Path) -> None:
    other = detector() if kind is not Detector else Association()
    checkpoint = tmp_path / "other.ckpt"
    training = trainer(tmp_path)
    training.strategy.connect(other)
    training.save_checkpoint(checkpoint)
    name = type(other).__name__
    refused(
        lambda: kind.load_from_checkpoint(checkpoint), f"other.ckpt: expected one of {kind.__name__}, got one of {name}"
    )
    refused(lambda: kind(start=checkpoint), "other.ckpt: expected .*network")
    refused(lambda: kind(start=tmp_path / "none.ckpt"), "expected a checkpoint at .*none.ckpt, found none")
    refused(
        lambda: kind.load_from_checkpoint(tmp_path / "none.ckpt"), "expected a checkpoint at .*none.ckpt, found none"
    )
    broken = tmp_path / "broken.ckpt"
    broken.write_bytes(b"none")
    refused(lambda: kind(start=broken), "broken.ckpt: expected a checkpoint of `tsuiseki train`")
    data: dict[Any, Callable[[], Any]] = {
        Detector: lambda: DetectionData(street, workers=0, batches=1),
        Appearance: lambda: AppearanceData(street, val_share=0.3),
        Action: lambda: ActionData(acting_clips / "train", batches=1),
        Association: lambda: AssociationData(street),
    }
    small = {Detector: detector, Action: lambda: Action(size=16, streams=("rgb_local",), flow="dis_fast")}
    refused(
        lambda: trainer(tmp_path).fit(small.get(kind, kind)(), data[kind](), ckpt_path=checkpoint),
        f"the checkpoint: expected one of {kind.__name__}, got one of {name}",
    )


def test_the_checkpoint_of_another_size_of_the_network(street: Path, tmp_path: Path) -> None:
    training = trainer(tmp_path)
    training.strategy.connect(detector(channels=24))
    training.save_checkpoint(tmp_path / "other.ckpt")
    refused(
        lambda: trainer(tmp_path).fit(detector(), DetectionData(street, workers=0), ckpt_path=tmp_path / "other.ckpt"),
        r"got one of another network: \d+ of \d+ tensors fit",
    )


def test_a_frozen_network_and_a_training_without_an_end(street: Path, tmp_path: Path) -> None:
    data = DetectionData(street, workers=0, batches=2)
    frozen = detector()
    frozen.freeze()
    refused(
        lambda: trainer(tmp_path).fit(frozen, data), "expected weights that learn, got a network that is all frozen"
    )
    refused(lambda: trainer(tmp_path, max_epochs=-1).fit(detector(), data), "expected a training with an end")


def test_options_that_the_flow_does_not_take(street: Path, tmp_path: Path) -> None:
    refused(
        lambda: trainer(tmp_path, precision="bf16-true").fit(Association(), AssociationData(street)),
        "expected the precision 32-true or a mixed one",
    )


@pytest.mark.parametrize("views", [1])
def test_an_appearance_set_with_one_picture_a_person(views: int, tmp_path: Path) -> None:
    alone = crowd(tmp_path / "alone", frames=6, views=views)
    refused(
        lambda: trainer(tmp_path, limit_val_batches=1).fit(
            Appearance(height=32, width=16), AppearanceData(alone, val_share=0.3)
        ),
        "`train`: expected at least two people with two pictures each, got 0 of 4 people",
    )
    refused(
        lambda: trainer(tmp_path).validate(Appearance(height=32, width=16), AppearanceData(alone, alone)),
        "`val`: expected at least two people with two pictures each, 25 frames apart, got 0 of 6 people",
    )


def test_few_batches_in_which_nobody_is_seen_again_give_no_score(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, data = Appearance(height=32, width=16), AppearanceData(street, val_share=0.3)
    monkeypatch.setattr("tsuiseki.trainers.appearance.APART", 1000)
    with pytest.warns(InputWarning, match="expected a person who is in a query and again in the gallery, got none"):
        (scores,) = trainer(tmp_path, limit_val_batches=1).validate(module, data, verbose=False)
    assert scores == {}


def test_data_that_do_not_belong_to_the_module(street: Path, acting_clips: Path, tmp_path: Path) -> None:
    training = trainer(tmp_path)
    refused(
        lambda: training.fit(detector(), AppearanceData(street)),
        "expected a module for appearance data, got one of the detector network",
    )
    refused(
        lambda: training.fit(Association(), DetectionData(street)),
        "expected a module for detector data, got one of the association network",
    )
    refused(lambda: training.fit(detector(), DetectionData(street, height=32)), "`height`: expected data with that of")
    refused(
        lambda: training.fit(detector(), DetectionData(street, classes=["car"])), "`classes`: expected data with that"
    )
    streams = ActionData(acting_clips / "train", streams=("flow_local",))
    module = Action(size=16, streams=("rgb_local",), flow="dis_fast")
    refused(lambda: training.fit(module, streams), "`streams`: expected those of the module, rgb_local")
    refused(lambda: DetectionData(street).setup("fit"), "expected a Trainer with a module, or `height` and `width`")


@pytest.mark.parametrize("data", [DetectionData, AppearanceData, ActionData, AssociationData])
@pytest.mark.parametrize("share", [0.0, 1.0, -1.0])
def test_a_share_out_of_bounds(data: Any, share: float, street: Path) -> None:
    refused(lambda: data(street, val_share=share), "val_share")
    refused(lambda: data(street, batches=0), "batches")


@pytest.mark.slow
def test_options_of_lightning_that_cannot_work_are_one_line(
    street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["train", "detector", "--data", str(street), "--out", str(tmp_path / "out")]
    if not torch.cuda.is_available():
        assert main([*words, "--trainer.accelerator=gpu"]) == 2
        assert capsys.readouterr().err.strip() == "tsuiseki: No supported gpu backend found!"
    assert main([*words, "--trainer.max_epochs=-1", "--trainer.accelerator=cpu"]) == 2
    assert "expected a training with an end" in capsys.readouterr().err
    assert main([*words, f"--model.start={shipped('appearance_people')}"]) == 2
    assert "expected a detector of the architecture people, got" in capsys.readouterr().err
