"""The exported association network: parity with torch, its metadata, and its way into the tracker."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from tests.tracking.features.faulty_onnx import spoil_batch
from tsuiseki.models.association import AssociationNetwork
from tsuiseki.tracking.association.learnt_costs import CostNetwork, FeatureNames
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.onnx import METADATA_KEY
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.tracker_choice import people_affinity, people_tracker
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.trainers.exporting.written_costs import TOLERANCE, export_association

pytestmark = pytest.mark.slow

NAMES = FeatureNames()


def network(scale: float, seed: int = 0) -> AssociationNetwork:
    torch.manual_seed(seed)
    made = AssociationNetwork(len(NAMES.links), len(NAMES.detections), len(NAMES.joins))
    for weight in made.parameters():
        torch.nn.init.normal_(weight, std=max(scale, 1e-9))
    return made


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("association")
    paths = {name: folder / f"{name}.onnx" for name in ("zero", "large", "wild")}
    assert export_association(network(0.0), paths["zero"], "nothing") <= TOLERANCE
    assert export_association(network(0.3), paths["large"], "noise") <= TOLERANCE
    export_association(network(1.5, seed=2), paths["wild"], "much noise")
    return paths


def crossing() -> list[Detections]:
    """Two people who cross, a third one who stands, and one false box."""
    rng = np.random.default_rng(0)
    frames = []
    for t in range(40):
        left = np.array([[20 + 8 * t, 100], [340 - 8 * t, 105], [200, 160]]) + rng.normal(0, 1, (3, 2))
        boxes = np.concatenate([left, left + np.array([30, 80])], axis=1)
        if t == 10:
            boxes = np.concatenate([boxes, [[400, 20, 420, 60]]])
        frames.append(Detections(boxes, np.full(len(boxes), 0.9)))
    return frames


def tracked(path: Path | None) -> list[Track]:
    learnt = people_affinity("flow", "none" if path is None else path, 1, known_scores=False)
    return run_tracker(crossing(), people_tracker("flow", affinity=learnt))


def test_zero_weights_are_the_tracker_by_default(exported: dict[str, Path]) -> None:
    for ours, default in zip(tracked(exported["zero"]), tracked(None), strict=True):
        np.testing.assert_array_equal(ours.frames, default.frames)
        np.testing.assert_allclose(ours.boxes, default.boxes, atol=1e-6)


def test_other_weights_are_another_tracker(exported: dict[str, Path]) -> None:
    ours, default = tracked(exported["wild"]), tracked(None)
    assert [len(track.frames) for track in ours] != [len(track.frames) for track in default]


def test_gives_the_costs_of_torch(exported: dict[str, Path]) -> None:
    rows = np.random.default_rng(1).normal(size=(50, len(NAMES.links)))
    with torch.no_grad():
        expected = network(0.3).links(torch.as_tensor(rows, dtype=torch.float32))[:, 0].numpy()
    assert np.ptp(expected) > 1
    np.testing.assert_allclose(CostNetwork(exported["large"], threads=1).links(rows), expected, atol=TOLERANCE)


def test_says_what_it_was_trained_on(exported: dict[str, Path]) -> None:
    card = CostNetwork(exported["large"]).card
    assert card.training_data == "noise"
    assert tuple(card.settings["links"]) == NAMES.links


def test_a_network_of_other_features_is_refused(exported: dict[str, Path], tmp_path: Path) -> None:
    model = onnx.load(exported["zero"])
    card = json.loads(model.metadata_props[0].value)
    card["settings"]["links"][0] = "weather"
    assert model.metadata_props[0].key == METADATA_KEY
    model.metadata_props[0].value = json.dumps(card)
    onnx.save(model, tmp_path / "other.onnx")
    with pytest.raises(RequestError, match=r"expected some of the 25 features of links .*, got weather; train"):
        CostNetwork(tmp_path / "other.onnx")


def test_features_are_taken_by_their_names(exported: dict[str, Path], tmp_path: Path) -> None:
    """So a file from before a feature was added goes on working."""
    model = onnx.load(exported["large"])
    card = json.loads(model.metadata_props[0].value)
    order = np.random.default_rng(0).permutation(len(NAMES.links))
    card["settings"]["links"] = [NAMES.links[k] for k in order]
    model.metadata_props[0].value = json.dumps(card)
    onnx.save(model, tmp_path / "other.onnx")
    rows = np.random.default_rng(1).normal(size=(20, len(NAMES.links)))
    expected = CostNetwork(exported["large"], threads=1).links(rows[:, order])
    assert np.ptp(expected) > 1
    np.testing.assert_array_equal(CostNetwork(tmp_path / "other.onnx", threads=1).links(rows), expected)


def test_the_tracker_decides_while_it_goes_with_it(exported: dict[str, Path]) -> None:
    from tsuiseki.tracking.people.flow_input import FlowSettings

    changes = CostNetwork(exported["large"], threads=1)
    tracker = FlowTracker(FlowSettings(decide_every=0.5), frame_rate=25.0, changes=changes)
    assert run_tracker(crossing() * 4, tracker)
    assert FlowTracker(changes=changes, frame_rate=25.0).tracks() == []


def test_a_network_that_is_wrong_in_a_batch_gets_one_row_at_a_time_and_that_is_said(
    exported: dict[str, Path], tmp_path: Path
) -> None:
    rows = np.random.default_rng(1).normal(size=(5, len(NAMES.links)))
    expected = CostNetwork(exported["large"], threads=1).links(rows)
    path = spoil_batch(shutil.copyfile(exported["large"], tmp_path / "spoilt.onnx"), "first only")
    with pytest.warns(InputWarning, match="gives for two rows at once something else"):
        network = CostNetwork(path, threads=1)
    np.testing.assert_allclose(network.links(rows), expected, atol=TOLERANCE)
