"""The Siamese network through the flow: what the tracker compares, gradients, checkpoints and export."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import lightning
import numpy as np
import pytest
import torch

from tsuiseki.tracking.association.evidence import LINK_FEATURES
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.trainers.appearance import Appearance
from tsuiseki.trainers.association import AppearanceLearning, Association
from tsuiseki.trainers.exporting.export import ModelFile
from tsuiseki.trainers.exporting.export_networks import export_appearance
from tsuiseki.trainers.fit import fit_association
from tsuiseki.trainers.flow.flow_loss import FlowLoss
from tsuiseki.trainers.flow.window_costs import averaged, contrast_within, distances, with_new_distances
from tsuiseki.trainers.flow.windows import AssociationData, EveryWindow

# A whole network is exported for them.
pytestmark = pytest.mark.slow

FRAMES = 24
COLOURS = ((30, 30, 220), (30, 200, 30), (220, 120, 30))


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three coloured people who walk past each other, with det.txt and gt.txt."""
    folder, rng = tmp_path_factory.mktemp("street") / "street", np.random.default_rng(0)
    for part in ("img1", "gt", "det"):
        (folder / part).mkdir(parents=True)
    write_sequence_info(folder, "street", 12.0, FRAMES, 160, 120)
    labels, found = [], []
    for t in range(FRAMES):
        image = np.full((120, 160, 3), 128, np.uint8)
        for k, colour in enumerate(COLOURS):
            x = 10 + 5 * t if k % 2 else 130 - 5 * t
            cv2.rectangle(image, (x, 20 + 20 * k), (x + 16, 60 + 20 * k), colour, -1)
            labels.append(f"{t + 1},{k + 1},{x + 1},{21 + 20 * k},16,40,1,1,1")
            if rng.random() < 0.9:
                found.append(f"{t + 1},-1,{x + 1},{21 + 20 * k},16,40,0.9,-1,-1,-1")
        cv2.imwrite(str(folder / "img1" / f"{t + 1:06d}.png"), image)
    (folder / "gt/gt.txt").write_text("\n".join(labels) + "\n")
    (folder / "det/det.txt").write_text("\n".join(found) + "\n")
    return folder


@pytest.fixture(scope="module")
def siamese(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Checkpoint and file of a small network as it begins."""
    folder = tmp_path_factory.mktemp("siamese")
    torch.manual_seed(0)
    module = Appearance(height=32, width=16, feature_length=8)
    trainer = lightning.Trainer(max_epochs=0, accelerator="cpu", logger=False, enable_progress_bar=False)
    trainer.strategy.connect(module)
    trainer.save_checkpoint(folder / "best.ckpt")
    export_appearance(ModelFile(out=folder / "appearance.onnx"), folder / "best.ckpt")
    return folder / "best.ckpt", folder / "appearance.onnx"


def test_averages_look_back_along_the_track() -> None:
    past = averaged(np.array([0, 1, 1, 5]), np.array([0, 0, 1, 0]), 3)
    np.testing.assert_array_equal(past, [[1, 0, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_detections_of_no_track_are_averaged_with_nothing() -> None:
    np.testing.assert_array_equal(averaged(np.array([0, 1]), np.array([-1, -1]), 3), np.eye(2))


@pytest.mark.parametrize("which", [0, 1], ids=["checkpoint", "exported"])
def test_the_distances_are_those_of_the_tracker(street: Path, siamese: tuple[Path, Path], which: int) -> None:
    """The windows of the first network: inside a window that is the whole video, nothing is cut off."""
    checkpoint, exported = siamese[which], siamese[1]
    data = AssociationData([street], appearance=exported, seconds=10.0, val_share=0.01)
    data.setup("fit")
    module = Association(appearance=AppearanceLearning(checkpoint))
    batch = EveryWindow(data.learnt, 10.0, data.images)[0]
    with torch.no_grad():
        features, heads = module.outputs(batch)
        assert features is not None
        assert batch.crops is not None
        found = distances(features, batch.crops, batch.detections).numpy()
        costs = module.costs(batch, features, heads).numpy()
    known = batch.detections.links[:, LINK_FEATURES.index("appearance")]
    assert np.ptp(known) > 0.01
    # The exported network computes in another order.
    np.testing.assert_allclose(found, known, atol=1e-3)
    np.testing.assert_allclose(costs, batch.detections.costs, atol=0.03)


def test_a_distance_costs_what_the_tracker_takes_for_it() -> None:
    rows = torch.zeros(2, len(LINK_FEATURES))
    rows[1, LINK_FEATURES.index("appearance")], rows[1, LINK_FEATURES.index("appearance_known")] = 0.5, 1
    changed, dearer = with_new_distances(rows, torch.tensor([0.34, 0.4]), LinkCost())
    torch.testing.assert_close(dearer, torch.tensor([18 * 0.1, -18 * 0.1]))
    torch.testing.assert_close(changed[:, LINK_FEATURES.index("cost")], dearer)


def test_gradients_reach_the_siamese_network(street: Path, siamese: tuple[Path, Path]) -> None:
    checkpoint, exported = siamese
    data = AssociationData([street], appearance=exported)
    data.setup("fit")
    module = Association(appearance=AppearanceLearning(checkpoint, contrast=0.0), loss=FlowLoss(epsilon=3.0))
    module.standardise(data.learnt)
    objective, _ = module.losses(EveryWindow(data.learnt, 2.0, data.images)[0], np.random.default_rng(0))
    objective.backward()
    assert module.siamese is not None
    grads = [p.grad for p in module.siamese.network.parameters()]
    assert all(grad is not None and torch.isfinite(grad).all() for grad in grads)
    assert sum(float(grad.abs().sum()) for grad in grads if grad is not None) > 0
    assert not module.siamese.network.training


def test_the_own_loss_needs_two_people_seen_twice(street: Path) -> None:
    data = AssociationData([street])
    data.setup("fit")
    graph, features = data.learnt[0].detections, torch.nn.functional.normalize(torch.randn(200, 4), dim=1)
    assert contrast_within(features[: len(graph)], graph) > 0
    alone = replace(graph, nodes=replace(graph.nodes, owners=np.where(graph.nodes.owners == 1, 1, -1)))
    assert contrast_within(features[: len(graph)], alone) == 0


def test_one_without_the_other_is_refused(street: Path, siamese: tuple[Path, Path]) -> None:
    data = AssociationData([street])
    data.setup("fit")
    module = Association(appearance=AppearanceLearning(siamese[0]))
    with pytest.raises(RequestError, match=r"--model\.appearance\.file FILE and --data\.appearance ONNX together"):
        module.losses(EveryWindow(data.learnt, 2.0)[0], np.random.default_rng(0))


def test_trains_and_exports_both(street: Path, siamese: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = [f"--data.train=[{street}]", f"--data.appearance={siamese[1]}", f"--model.appearance.file={siamese[0]}",
             "--data.batches=2", "--data.seconds=1", "--trainer.max_epochs=1", "--trainer.accelerator=cpu",
             "--trainer.num_sanity_val_steps=0", "--model.optimisation.warmup_steps=1", "--model.loss.epsilon=3",
             f"--out={out}"]  # fmt: skip
    fit_association(words)
    assert (out / "association.onnx").is_file()
    crop, box = np.full((40, 20, 3), 90, np.uint8), np.array([[0, 0, 20.0, 40]])
    before, after = (exported.Appearance(path).describe(crop, box) for path in (siamese[1], out / "appearance.onnx"))
    assert after.shape == before.shape == (1, 8)
    assert np.abs(after - before).max() > 0
