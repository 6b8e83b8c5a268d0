"""The projection of appearance: where it starts, what it learns, checkpoints, export, and its way into the tracker."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import lightning
import numpy as np
import pytest
import torch

from tests.trainers.association.crossing import crossing
from tsuiseki.models.association_network import AppearanceProjection
from tsuiseki.tracking.association.evidence import LINK_FEATURES
from tsuiseki.tracking.association.learnt_costs import CostNetwork
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import Detections
from tsuiseki.trainers.association.graphs import DetectedVideo, Graphs, no_others, window
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.association.training import AppearanceLearning, AssociationTraining
from tsuiseki.trainers.association.windows import TrainingWindow
from tsuiseki.trainers.experiments.end_to_end import fitted
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.exporting.export_costs import TOLERANCE, export_association

pytestmark = pytest.mark.slow

LENGTH = 6
DISTANCE, KNOWN = (LINK_FEATURES.index(name) for name in ("appearance", "appearance_known"))


def seen(found: Detections, rng: np.random.Generator) -> np.ndarray:
    """Features of which the first number says who it is, weakly, and the others vary much: light and background."""
    rows = rng.normal(0, 1.0, (len(found), LENGTH))
    rows[:, 0] = np.where(np.arange(len(found)) == 0, 0.6, -0.6) + rng.normal(0, 0.05, len(found))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def described(seed: int) -> DetectedVideo:
    """Two people who meet and turn round, with features."""
    video, rng = crossing(seed), np.random.default_rng(seed)
    return replace(video, detections=[found.with_features(seen(found, rng)) for found in video.detections])


@pytest.fixture(scope="module")
def graphs() -> list[Graphs]:
    return [sequence_graphs(described(seed)) for seed in range(6)]


def whole(graphs: Graphs) -> TrainingWindow:
    return TrainingWindow(window(graphs.detections, 0, 10_000), graphs.tracklets)


def test_the_distances_at_first_are_those_of_the_tracker(graphs: list[Graphs]) -> None:
    module = AssociationTraining(appearance=AppearanceLearning(projection=LENGTH))
    module.standardise(graphs)
    batch = whole(graphs[0])
    with torch.no_grad():
        found = module.makers().costs(batch).numpy()
    graph = batch.detections
    assert np.ptp(graph.links[:, DISTANCE]) > 0.1
    # float32, and 18 a unit of distance.
    np.testing.assert_allclose(found, graph.costs, atol=1e-3)
    # Averages go over detections that are not in the network, too.
    assert len(graph.others.frames) > 0
    with torch.no_grad():
        alone = module.makers().costs(replace(batch, detections=replace(graph, others=no_others()))).numpy()
    assert np.abs(alone - graph.costs).max() > 0.1


def test_detections_without_features_are_left_as_they_are(graphs: list[Graphs]) -> None:
    graph = graphs[0].detections
    assert graph.features is not None
    unknown = replace(graph, features=np.full_like(graph.features, np.nan), links=graph.links.copy())
    unknown.links[:, KNOWN] = 0
    module = AssociationTraining(appearance=AppearanceLearning(projection=2))
    module.standardise(graphs)
    costs = module.makers().costs(TrainingWindow(unknown, graphs[0].tracklets))
    np.testing.assert_allclose(costs.detach().numpy(), graph.costs, atol=1e-5)
    costs.sum().backward()
    assert module.network.projection is not None
    assert torch.isfinite(module.network.projection.matrix.grad).all()


def test_it_learns_which_numbers_tell_people_apart(graphs: list[Graphs]) -> None:
    """On meetings not seen, what it compares lies nearer for one person and farther for two than what came."""
    torch.manual_seed(0)
    module = AssociationTraining(
        appearance=AppearanceLearning(contrast=0.0, projection=LENGTH, projection_rate=10.0), joins=0.0
    )
    for part in (module.network.links, module.network.detections):
        part.requires_grad_(False)
    module.standardise(graphs)
    assert module.network.projection is not None
    before = module.network.projection.matrix.clone()
    fitted(module, graphs, 60, 4.0)
    assert (module.network.projection.matrix - before).abs().max() > 0.1
    other = sequence_graphs(described(100)).detections
    assert other.features is not None

    def apart(features: np.ndarray) -> float:
        likeness, same = features @ features.T, other.owners[:, None] == other.owners[None]
        people = np.ix_(other.owners >= 0, other.owners >= 0)
        return float(likeness[people][same[people]].mean() - likeness[people][~same[people]].mean())

    with torch.no_grad():
        after = module.network.projection(torch.as_tensor(other.features, dtype=torch.float32)).numpy()
    assert apart(after) > apart(other.features) + 0.4


@pytest.fixture(scope="module")
def learnt(graphs: list[Graphs]) -> AssociationTraining:
    """A training that projects features to two numbers and changes costs at random."""
    module = AssociationTraining(appearance=AppearanceLearning(projection=2))
    module.standardise(graphs)
    torch.nn.init.normal_(module.network.links.linear.weight, std=0.1)
    return module


@pytest.fixture(scope="module")
def exported(learnt: AssociationTraining, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of its network."""
    path = tmp_path_factory.mktemp("projection") / "a.onnx"
    assert export_association(learnt.network, path) <= TOLERANCE
    return path


def test_a_checkpoint_and_a_file_have_it(learnt: AssociationTraining, exported: Path, tmp_path: Path) -> None:
    module = learnt
    trainer = lightning.Trainer(max_epochs=0, accelerator="cpu", logger=False, enable_progress_bar=False)
    trainer.strategy.connect(module)
    trainer.save_checkpoint(tmp_path / "last.ckpt")
    network = load_module(AssociationTraining, tmp_path / "last.ckpt").network
    assert module.network.projection is not None
    assert network.projection is not None
    assert torch.equal(network.projection.matrix, module.network.projection.matrix)
    costs, (found,) = CostNetwork(exported, threads=1), [described(9).detections[3]]
    assert costs.card.feature_length == LENGTH
    projected = costs.projected(found).features
    assert projected is not None
    assert network.projection is not None
    with torch.no_grad():
        expected = network.projection(torch.as_tensor(found.features, dtype=torch.float32)).numpy()
    assert projected.shape == (len(found), 2)
    np.testing.assert_allclose(projected, expected, atol=TOLERANCE)


def test_the_tracker_compares_what_was_projected(graphs: list[Graphs], tmp_path: Path) -> None:
    """As if the features had come projected; and other tracks than from the features as they came."""
    module = AssociationTraining(appearance=AppearanceLearning(projection=1))
    module.standardise(graphs)
    network, video = module.network.eval(), described(3)
    assert network.projection is not None
    with torch.no_grad():
        network.projection.matrix.copy_(torch.eye(1, LENGTH))
    found: dict[str, list[Detections]] = {"raw": list(video.detections)}
    plain = copy.deepcopy(network)
    plain.projection = None
    costs = {}
    for name, one in (("network", network), ("plain", plain)):
        export_association(one, tmp_path / f"{name}.onnx")
        costs[name] = CostNetwork(tmp_path / f"{name}.onnx", threads=1)
    found["projected"] = [costs["network"].projected(one) for one in video.detections]

    def boxes(changes: str, given: str) -> list[list[float]]:
        tracker = FlowTracker(frame_rate=25.0, size=video.size, changes=costs[changes])
        for one in found[given]:
            tracker.update(one)
        return [track.boxes.round(6).tolist() for track in tracker.tracks()]

    assert boxes("network", "raw") == boxes("plain", "projected") != boxes("plain", "raw")


@pytest.mark.parametrize("length", [None, 4])
def test_other_features_are_refused(exported: Path, length: int | None) -> None:
    changes, (box,) = CostNetwork(exported, threads=1), [np.array([[0, 0, 10.0, 20]])]
    found = Detections(box, np.ones(1), None if length is None else np.ones((1, length)))
    assert len(changes.projected(Detections.empty())) == 0
    got = "none" if length is None else "4 numbers"
    with pytest.raises(RequestError, match=f"expected appearance features of 6 numbers, which it projects, got {got}"):
        FlowTracker(changes=changes).update(found)


def test_what_cannot_be_projected_is_said(graphs: list[Graphs]) -> None:
    plain = [sequence_graphs(crossing(0))]
    with pytest.raises(RequestError, match=r"expected --data\.appearance ONNX with --model\.appearance\.projection"):
        AssociationTraining(appearance=AppearanceLearning(projection=2)).standardise(plain)
    with pytest.raises(RequestError, match=r"projection up to 6, the length of a feature, got 7"):
        AssociationTraining(appearance=AppearanceLearning(projection=7)).standardise(graphs)
    assert AppearanceProjection(4, 2).matrix.shape == (2, 4)
