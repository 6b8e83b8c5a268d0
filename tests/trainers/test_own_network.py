"""Networks that a user brings along train, load, export and detect as those of the toolkit do."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from tests.trainers.test_lightning import crowd, detector, trainer
from tsuiseki.models.detector import AnchorDetector
from tsuiseki.tracking.association.learnt_costs import CostNetwork
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.features.action import ActionRecogniser, StreamName, averaged
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.types.class_choice import ClassChoice
from tsuiseki.trainers.association import detector_of
from tsuiseki.trainers.detector import DetectorOptimisation
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.exporting.written_costs import TOLERANCE
from tsuiseki.trainers.exporting.written_networks import Decoded
from tsuiseki.trainers.fit import fit_action, fit_appearance, fit_association, fit_detector
from tsuiseki.trainers.own_network import try_appearance, try_detector
from tsuiseki.training import (
    Action,
    ActionClassifier,
    ActionData,
    Appearance,
    AppearanceData,
    AppearanceTrunk,
    Association,
    AssociationData,
    DetectionData,
    Detector,
    DetectorNetwork,
    LinkCosts,
    NetworkCard,
)

pytestmark = [
    pytest.mark.filterwarnings("ignore::UserWarning"),
    pytest.mark.filterwarnings("ignore::lightning.fabric.utilities.rank_zero.LightningDeprecationWarning"),
]
# What people of the clips do.
OKUTAMA_ACTIONS = tuple(f"action {n + 1}" for n in range(12))
# Width and height of a cell of `Cells`, pixels.
SIDE = 16


class Cells(nn.Module):
    """A box and scores in each cell of 16 x 16 pixels."""

    centres: Tensor

    def __init__(self, height: int = 64, width: int = 128, names: tuple[str, ...] = ("person",)) -> None:
        super().__init__()
        self.card = NetworkCard("cells", height, width, names)
        self.layers = nn.Sequential(nn.Conv2d(3, 8, SIDE, SIDE), nn.ReLU(), nn.Conv2d(8, 4 + len(names), 1))
        y, x = torch.meshgrid(torch.arange(height // SIDE), torch.arange(width // SIDE), indexing="ij")
        centres = SIDE * (torch.stack((x, y, x, y), dim=-1).reshape(-1, 4) + 0.5)
        self.register_buffer("centres", centres, persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        values: Tensor = self.layers(images)
        return values.flatten(2).transpose(1, 2)

    def decode(self, outputs: Tensor) -> tuple[Tensor, Tensor]:
        sides = torch.tensor([-6.0, -14.0, 6.0, 14.0], device=outputs.device)
        return self.centres + sides + outputs[..., :4].tanh(), outputs[..., 4:].sigmoid()

    def loss(self, outputs: Tensor, boxes: Tensor, labels: Tensor) -> dict[str, Tensor]:
        middle = self.centres[:, None, :2]
        inside = ((middle > boxes[:, None, :, :2]) & (middle < boxes[:, None, :, 2:])).all(dim=-1)
        kinds = (inside * labels.clamp(min=0)[:, None]).amax(dim=-1)
        target = functional.one_hot(kinds, len(self.card.class_names) + 1)[..., 1:].float()
        scores = functional.binary_cross_entropy_with_logits(outputs[..., 4:], target)
        return {"scores": scores, "shifts": outputs[..., :4].square().mean()}


class Stripes(nn.Module):
    """The means of four stripes of a crop, mixed."""

    def __init__(self, length: int = 8) -> None:
        super().__init__()
        self.card = NetworkCard("stripes", 32, 16)
        self.mix = nn.Linear(12, length)

    def forward(self, images: Tensor) -> Tensor:
        return functional.normalize(self.mix(functional.adaptive_avg_pool2d(images, (4, 1)).flatten(1)), dim=1)


class Means(nn.Module):
    """The means of a crop's channels, mixed."""

    def __init__(self, size: int = 16, channels: int = 3, actions: tuple[str, ...] = ()) -> None:
        super().__init__()
        self.card = NetworkCard("means", size, size, actions or OKUTAMA_ACTIONS)
        self.mix = nn.Linear(channels, len(self.card.class_names))

    def forward(self, images: Tensor) -> Tensor:
        logits: Tensor = self.mix(images.mean(dim=(2, 3)))
        return logits


class Layers(nn.Module):
    """Two layers from features of links to changes of their costs."""

    def __init__(self, width: int = 8) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(25, width), nn.ReLU(), nn.Linear(width, 1))

    def forward(self, features: Tensor) -> Tensor:
        changes: Tensor = self.layers(features)
        return changes[:, 0]


# For a type checker: what the toolkit has and what a user brings along are such networks.
NETWORKS: tuple[Callable[..., DetectorNetwork], ...] = (AnchorDetector, Cells)
TRUNKS: tuple[Callable[..., AppearanceTrunk], ...] = (Stripes,)
CLASSIFIERS: tuple[Callable[..., ActionClassifier], ...] = (Means,)
COSTS: tuple[Callable[..., LinkCosts], ...] = (Layers,)


@pytest.fixture(autouse=True)
def seed() -> None:
    torch.manual_seed(0)


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return crowd(tmp_path_factory.mktemp("own") / "street")


def detection_data(street: Path) -> DetectionData:
    return DetectionData(street, batch_size=2, batches=2, workers=0)


def appearance_data(street: Path) -> AppearanceData:
    return AppearanceData(str(street), val_share=0.3, batch_size=8, views=2, batches=2)


def test_the_networks_of_the_toolkit_keep_the_contract_themselves() -> None:
    for module in (detector(), Detector(network=Cells())):
        assert try_detector(module.network) == module.card
    for appearance in (Appearance(height=32, width=16), Appearance(network=Stripes())):
        assert try_appearance(appearance.network) == appearance.card


@pytest.mark.slow
@pytest.mark.parametrize("names", [("person",), ("car", "dog")], ids=["people", "classes"])
def test_a_detector_of_ones_own_learns_and_its_file_detects_the_same(
    names: tuple[str, ...], street: Path, tmp_path: Path
) -> None:
    module, training = Detector(network=Cells(names=names)), trainer(tmp_path, fast_dev_run=True)
    before = module.network.layers[0].weight.clone()
    if names == ("person",):
        training.fit(module, detection_data(street))
        assert not torch.equal(before, module.network.layers[0].weight)
        assert {"train/scores", "train/shifts", "val/ap50"} <= training.callback_metrics.keys()
    assert module.export(tmp_path / "own.onnx", "a crowd") < 1e-3
    images = list(np.random.default_rng(0).integers(0, 256, (3, 128, 256, 3), dtype=np.uint8))
    choice = None if len(names) == 1 else ClassChoice(names)
    file = exported.Detector(tmp_path / "own.onnx", 0.3, classes=choice)
    assert file.model.card.class_names == names
    assert file.model.card.training_data == "a crowd"
    for mine, theirs in zip(module.eval().detect(images), file.detect(images), strict=True):
        # A training scores as many candidates as there are boxes, the file each class of a box.
        best = len(mine)
        assert 0 < best <= len(theirs)
        np.testing.assert_allclose(mine.boxes, theirs.boxes[:best], atol=1e-3)
        np.testing.assert_allclose(mine.scores, theirs.scores[:best], atol=1e-5)
        if len(names) > 1:
            np.testing.assert_array_equal(mine.classes, theirs.classes[:best])


class Corner(Cells):
    """One box of a score that is sure, and one of a score that is not."""

    def decode(self, outputs: Tensor) -> tuple[Tensor, Tensor]:
        boxes = torch.tensor([[8.0, 4.0, 20.0, 32.0], [60.0, 4.0, 72.0, 32.0]])
        nothing = 0 * outputs[:, :2]
        return boxes + nothing[..., :4], torch.tensor([[0.9], [0.2]]) + nothing[..., 4:]


@pytest.mark.slow
def test_boxes_of_a_file_are_in_pixels_of_the_image(tmp_path: Path) -> None:
    Detector(network=Corner()).export(tmp_path / "corner.onnx")
    (found,) = exported.Detector(tmp_path / "corner.onnx").detect([np.zeros((128, 256, 3), np.uint8)])
    np.testing.assert_allclose(found.boxes, [[16, 8, 40, 64]], atol=1e-4)
    np.testing.assert_allclose(found.scores, [0.9], atol=1e-6)


def test_calibrated_scores_are_those_of_a_shifted_logit() -> None:
    scores = Decoded(Corner(), (2.0, 0.5))(torch.zeros(1, 3, 64, 128))[1]
    logits = torch.logit(torch.tensor([[[0.9], [0.2]]]))
    torch.testing.assert_close(scores, torch.sigmoid(2 * logits + 0.5))


def test_a_checkpoint_is_loaded_with_the_network_that_python_made(street: Path, tmp_path: Path) -> None:
    module, training = Detector(network=Cells()), trainer(tmp_path)
    training.fit(module, detection_data(street))
    training.save_checkpoint(tmp_path / "own.ckpt")
    with pytest.raises(RequestError, match=r"expected `network`, a .*test_own_network\.Cells as it was trained"):
        Detector.load_from_checkpoint(tmp_path / "own.ckpt")
    again = Detector.load_from_checkpoint(tmp_path / "own.ckpt", network=Cells())
    assert all(torch.equal(value, again.state_dict()[name]) for name, value in module.state_dict().items())
    resumed = trainer(tmp_path, max_epochs=2)
    resumed.fit(Detector(network=Cells()), detection_data(street), ckpt_path=tmp_path / "own.ckpt")
    assert resumed.global_step == 2 * training.global_step


@pytest.mark.slow
def test_an_appearance_network_of_ones_own_learns_and_its_file_describes_the_same(street: Path, tmp_path: Path) -> None:
    module, training = Appearance(network=Stripes()), trainer(tmp_path, fast_dev_run=True)
    training.fit(module, appearance_data(street))
    assert module.card.feature_length == 8
    assert module.export(tmp_path / "own.onnx") < 1e-3
    image = np.random.default_rng(0).integers(0, 256, (32, 16, 3), dtype=np.uint8)
    described = exported.Appearance(tmp_path / "own.onnx").describe(image, np.array([[0.0, 0, 16, 32]]))
    with torch.no_grad():
        expected = module.eval()(torch.from_numpy(image[None]))
    np.testing.assert_allclose(described, expected, atol=1e-5)


@pytest.mark.slow
def test_action_streams_of_ones_own_learn_and_recognise_by_their_files(acting_clips: Path, tmp_path: Path) -> None:
    streams: dict[StreamName, nn.Module] = {"rgb_local": Means(), "flow_global": Means(channels=2)}
    data = ActionData(acting_clips / "train", batch_size=4, batches=2)
    module, training = Action(network=streams, flow="dis_fast"), trainer(tmp_path)
    training.fit(module, data)
    assert {"val/map", "val/map_rgb_local", "val/map_flow_global"} <= training.callback_metrics.keys()
    files = [*module.export(tmp_path / "own.onnx", "clips")]
    assert [file.name for file in files] == ["own_rgb_local.onnx", "own_flow_global.onnx"]
    recogniser = ActionRecogniser(files)
    images = list(np.random.default_rng(0).integers(0, 256, (2, 48, 64, 3), dtype=np.uint8))
    recognised = recogniser.recognise(images, np.array([[10.0, 5, 30, 40]]))
    assert averaged(recognised).shape == (1, len(OKUTAMA_ACTIONS))
    for name, stream in module.network.streams.items():
        crops = torch.randn(3, module.inputs[name].channels, 16, 16)
        file = OnnxModel(tmp_path / f"own_{name}.onnx", "action")
        assert (file.card.name, file.card.class_names) == ("means", data.names)
        np.testing.assert_allclose(file.run(crops.numpy())[0], stream.eval()(crops).detach().sigmoid(), atol=1e-5)
    training.save_checkpoint(tmp_path / "own.ckpt")
    with pytest.raises(RequestError, match=r"expected `network`, a .*test_own_network\.Means as it was trained"):
        Action.load_from_checkpoint(tmp_path / "own.ckpt")
    fresh: dict[StreamName, nn.Module] = {"rgb_local": Means(), "flow_global": Means(channels=2)}
    again = Action.load_from_checkpoint(tmp_path / "own.ckpt", network=fresh)
    assert all(torch.equal(value, again.state_dict()[name]) for name, value in module.state_dict().items())


@pytest.mark.slow
def test_link_costs_of_ones_own_learn_and_their_file_gives_the_same(street: Path, tmp_path: Path) -> None:
    module, training = Association(network=Layers()), trainer(tmp_path)
    before = [weights.clone() for weights in module.network.links.linear.parameters()]
    training.fit(module, AssociationData(street, batches=4, seconds=0.5))
    assert not all(map(torch.equal, before, module.network.links.linear.parameters()))
    assert module.export(tmp_path / "own.onnx") < TOLERANCE
    rows = np.random.default_rng(0).normal(size=(9, 25))
    costs = CostNetwork(tmp_path / "own.onnx", threads=1).links(rows)
    expected = module.eval().network.links(torch.as_tensor(rows, dtype=torch.float32))[:, 0]
    np.testing.assert_allclose(costs, expected.detach(), atol=TOLERANCE)
    assert np.ptp(costs) > 0
    words = ["--detections", str(street / "det/det.txt"), "--affinity", str(tmp_path / "own.onnx")]
    assert main(["track", "people", str(street), *words, "--out", str(tmp_path / "out")]) == 0
    training.save_checkpoint(tmp_path / "own.ckpt")
    again = Association.load_from_checkpoint(tmp_path / "own.ckpt", network=Layers())
    assert all(torch.equal(value, again.state_dict()[name]) for name, value in module.state_dict().items())


@pytest.mark.parametrize(
    ("network", "arguments", "said"),
    [
        (nn.Identity(), {}, "expected Identity to have a tsuiseki.training.NetworkCard"),
        (Means(channels=2), {"streams": ("flow_local", "rgb_local")}, "`streams`: expected those of the `network`"),
        ({"rgb_local": Means(), "rgb_global": Means(size=32)}, {}, "expected one size and the same actions"),
        ({"rgb": Means()}, {}, "`network`: expected a stream of rgb_local"),
        (Means(), {"actions": 3}, "`actions`: expected none beside `network`"),
        (Means(), {"start": "drone"}, "`start`: expected none beside `network`"),
    ],
)
def test_what_is_no_action_network_is_refused(network: Any, arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(RequestError, match=said):
        Action(network=network, **arguments)


def test_shapes_of_action_networks_and_link_costs_are_tried() -> None:
    class Flat(Means):
        def forward(self, images: Tensor) -> Tensor:
            return super().forward(images)[:, :3]

    class Tall(Means):
        def __init__(self) -> None:
            super().__init__()
            self.card = NetworkCard("tall", 32, 16)

    class Pairs(Layers):
        def forward(self, features: Tensor) -> Tensor:
            return features[:, :2]

    for make, said in (
        (lambda: Action(network=Flat()), r"Flat to give logits \(2, 12\), one an action of its card; got \(2, 3\)"),
        (lambda: Action(network=Tall()), "expected Tall to take squares, as people are cropped, got 32x16"),
        (lambda: Association(network=Pairs()), r"Pairs to give a change of the cost of each link, \(2,\) .*\(2, 2\)"),
        (lambda: Association(network=Layers(), start="x.onnx"), "`start`: expected none beside `network`"),
    ):
        with pytest.raises(RequestError, match=said):
            make()


FILE = "from tests.trainers.test_own_network import Cells, Layers, Means, Stripes\n\n\n"
FILE += "class Net(Cells):\n    pass\n\n\nclass Trunk(Stripes):\n    pass\n\n\n"
FILE += "class Act(Means):\n    pass\n\n\nclass Links(Layers):\n    pass\n\n\nlayer = 3\n"
QUICK = ["--trainer.max_epochs=1", "--trainer.accelerator=cpu", "--data.batches=1", "--data.workers=0"]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a network in a file."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "mine_own", raising=False)
    (tmp_path / "mine_own.py").write_text(FILE)
    return tmp_path


@pytest.mark.slow
def test_a_command_trains_a_network_from_a_file_of_the_working_folder(street: Path, here: Path) -> None:
    folders = list(sys.path)
    words = ["--data", str(street), "--out", "out", *QUICK, "--data.batch_size=2"]
    best = fit_detector([*words, "--model.network.class_path=mine_own.Net", "--model.network.init_args.height=32"])
    assert best is not None
    assert exported.Detector(here / "out" / "detector.onnx").input_size == (32, 128)
    module = load_module(Detector, best)
    assert type(module.network).__name__ == "Net"
    assert sys.path == folders
    for read in (lambda: Detector(start=best), lambda: detector_of(best)):
        with pytest.raises(RequestError, match=r"of another network|with heads at anchors, got cells"):
            read()


@pytest.mark.slow
def test_a_command_trains_an_appearance_network_from_a_file(street: Path, here: Path) -> None:
    words = ["--data", str(street), "--out", "out", *QUICK, "--data.batch_size=8", "--data.views=2"]
    words += ["--data.val_share=0.3", "--model.network=mine_own.Trunk", "--model.network.length=6"]
    best = fit_appearance(words)
    assert best is not None
    assert exported.Appearance(here / "out" / "appearance.onnx").model.card.feature_length == 6
    assert load_module(Appearance, best).network.mix.out_features == 6


@pytest.mark.slow
def test_commands_train_an_action_network_and_link_costs_from_a_file(
    street: Path, acting_clips: Path, here: Path
) -> None:
    words = ["--data", str(acting_clips / "train"), "--out", "act", *QUICK, "--data.batch_size=4"]
    best = fit_action([*words, "--model.network=mine_own.Act", "--model.network.size=24", "--model.flow=dis_fast"])
    assert best is not None
    assert OnnxModel(here / "act" / "action_rgb_local.onnx", "action").card.input_height == 24
    assert load_module(Action, best).inputs.keys() == {"rgb_local"}
    words = ["--data", str(street), "--out", "links", "--trainer.max_epochs=1", "--data.batches=2"]
    best = fit_association([*words, "--model.network=mine_own.Links", "--model.network.width=4"])
    assert best is not None
    assert load_module(Association, best).network.links.linear.layers[0].out_features == 4
    assert (here / "links" / "association.onnx").is_file()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nowhere.Net", "No module named 'nowhere'"),
        ("mine_own.Missing", "has no attribute 'Missing'"),
        ("mine_own.layer", r"got mine_own\.layer$"),
        ("pathlib.Path", r"got pathlib\.Path$"),
    ],
)
def test_a_name_of_no_network_is_one_line(name: str, said: str, street: Path, here: Path) -> None:
    with pytest.raises(RequestError, match=f"`network`: expected a class of torch modules.*{said}"):
        fit_detector(["--data", str(street), "--out", str(here / "out"), f"--model.network={name}"])
    assert not (here / "out").exists()


def changed(**methods: Any) -> nn.Module:
    """`Cells` with other methods."""
    return type("Changed", (Cells,), methods)()  # type: ignore[no-any-return]


def boxes_and_scores(self: Cells, outputs: Tensor, columns: int = 1, high: float = 1.0) -> tuple[Tensor, Tensor]:
    return self.centres.expand(len(outputs), -1, -1), torch.full((*outputs.shape[:2], columns), high)


@pytest.mark.parametrize(
    ("network", "said"),
    [
        (nn.Identity(), "expected Identity to be a DetectorNetwork, it has no method decode"),
        (changed(loss=None), "it has no method loss"),
        (changed(decode=lambda self, _: self.centres), r"decode to give boxes \(2, N, 4\) and scores.*got \(32, 4\)"),
        (
            changed(decode=lambda self, x: boxes_and_scores(self, x, columns=2)),
            r"\(2, N, 1\).*got .*\(2, 32, 2\)",
        ),
        (changed(decode=lambda self, x: boxes_and_scores(self, x, high=7)), r"in \[0, 1\], got scores from 7 to 7"),
        (changed(loss=lambda *_: torch.zeros(())), r"dict of scalar tensors, got \(\)"),
        (changed(loss=lambda *_: {"a": torch.zeros(2)}), r"dict of scalar tensors, got \{a: \(2,\)\}"),
        (changed(loss=lambda *_: {}), "dict of scalar tensors"),
    ],
)
def test_what_is_no_detector_network_is_refused_before_the_first_batch(network: nn.Module, said: str) -> None:
    with pytest.raises(RequestError, match=said):
        Detector(network=network)


def test_a_network_without_a_card_is_refused() -> None:
    network: Any = Cells()
    network.card = {"height": 3}
    with pytest.raises(RequestError, match=r"expected Cells to have a tsuiseki\.training\.NetworkCard .*got dict"):
        Detector(network=network)


def test_features_that_are_not_of_unit_length_are_refused() -> None:
    class Long(Stripes):
        def forward(self, images: Tensor) -> Tensor:
            return 2 * super().forward(images)

    with pytest.raises(RequestError, match=r"Long to give features of unit length, got length 2; end it with"):
        Appearance(network=Long())


@pytest.mark.parametrize(
    ("name", "value"),
    [("start", "people"), ("height", 64), ("classes", ["dog"]), ("trunk", "resnet18"), ("loss", "multibox"),
     ("weights", "imagenet"), ("optimisation", DetectorOptimisation(box_weight=3.0))],
)  # fmt: skip
def test_what_the_network_decides_is_not_asked_for_beside_it(name: str, value: object) -> None:
    with pytest.raises(RequestError, match=f"`{name}.*`: expected none beside `network`"):
        Detector(network=Cells(), **{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"input_height": 0}, "sides of 1 pixel or more"),
        ({"class_names": "person"}, "a tuple of names"),
        ({"class_names": ()}, "a tuple of names"),
        ({"resize": "crop"}, "letterbox or stretch"),
        ({"std": (0, 1, 1)}, "deviation above 0"),
    ],
)
def test_a_card_says_what_is_wrong_with_it(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        NetworkCard(**{"name": "cells", "input_height": 64, "input_width": 64, **change})
