"""The detector's heads through the flow: gradients, warm start, what goes together, checkpoints and export."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import lightning
import numpy as np
import pytest
import torch

from tsuiseki.tracking.association.evidence import DETECTION_FEATURES
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.trainers.association import Association, HeadsLearning, detector_of
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.exporting.export import ModelFile
from tsuiseki.trainers.exporting.export_networks import export_detector
from tsuiseki.trainers.fit import fit_association
from tsuiseki.trainers.flow import window_costs
from tsuiseki.trainers.flow.flow_loss import FlowLoss
from tsuiseki.trainers.flow.window_costs import FrozenTrunk, frames_of, own_loss, rescored, score_logits
from tsuiseki.trainers.flow.windows import AssociationData, EveryWindow, TrainingWindow
from tsuiseki.trainers.network_module import normalised

# A whole network is exported for them.
pytestmark = pytest.mark.slow

FRAMES = 10
SIZE = {"height": 96, "width": 128}
ANCHORS = [[(16.0, 40.0)], [(30.0, 70.0)], [(60.0, 90.0)]]


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people who walk past each other."""
    folder = tmp_path_factory.mktemp("street") / "street"
    for part in ("img1", "gt"):
        (folder / part).mkdir(parents=True)
    write_sequence_info(folder, "street", 5.0, FRAMES, SIZE["width"], SIZE["height"])
    labels = []
    for t in range(FRAMES):
        image = np.full((SIZE["height"], SIZE["width"], 3), 128, np.uint8)
        for k in range(2):
            x = 10 + 8 * t if k else 100 - 8 * t
            cv2.rectangle(image, (x, 20 + 20 * k), (x + 16, 60 + 20 * k), (30, 200 * k, 220), -1)
            labels.append(f"{t + 1},{k + 1},{x + 1},{21 + 20 * k},16,40,1,1,1")
        cv2.imwrite(str(folder / "img1" / f"{t + 1:06d}.png"), image)
    (folder / "gt/gt.txt").write_text("\n".join(labels) + "\n")
    return folder


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Checkpoint and file of a small detector as it begins: it finds people everywhere, and is sure of none."""
    folder = tmp_path_factory.mktemp("detector")
    torch.manual_seed(0)
    module = Detector(trunk="mobilenet_v3_small", anchors=ANCHORS, channels=16, loss="quality", **SIZE)
    # Normalisations that have seen nothing would leave the heads next to nothing to look at.
    for norm in module.modules():
        if isinstance(norm, torch.nn.BatchNorm2d):
            norm.momentum = 1.0
    with torch.no_grad():
        module.train()(torch.randint(0, 255, (4, SIZE["height"], SIZE["width"], 3), dtype=torch.uint8))
    trainer = lightning.Trainer(max_epochs=0, accelerator="cpu", logger=False, enable_progress_bar=False)
    trainer.strategy.connect(module)
    trainer.save_checkpoint(folder / "best.ckpt")
    export_detector(ModelFile(out=folder / "detector.onnx"), folder / "best.ckpt")
    return folder / "best.ckpt", folder / "detector.onnx"


def data_of(street: Path, exported: Path) -> AssociationData:
    data = AssociationData(
        [street], detector=exported, score_threshold=0.0, heads=True, val_share=0.1, seconds=1.0, batches=2
    )
    data.setup("fit")
    return data


@pytest.fixture(scope="module")
def batch(street: Path, detector: tuple[Path, Path]) -> TrainingWindow:
    data = data_of(street, detector[1])
    return EveryWindow(data.learnt, 1.0, data.images)[0]


@pytest.mark.parametrize("which", [0, 1], ids=["checkpoint", "exported"])
def test_the_scores_are_those_of_the_detections(batch: TrainingWindow, detector: tuple[Path, Path], which: int) -> None:
    """So training starts from the tracker's own costs, from a checkpoint as from the file."""
    module = Association(detector=HeadsLearning(detector[which]))
    with torch.no_grad():
        _, heads = module.outputs(batch)
        assert heads is not None
        assert batch.frames is not None
        assert batch.detections.origin is not None
        found = score_logits(heads[0], batch.frames, batch.detections).numpy()
        costs = module.costs(batch, None, heads).numpy()
    # The exported network computes in another order.
    np.testing.assert_allclose(found, batch.detections.origin.logits, atol=1e-3)
    np.testing.assert_allclose(costs, batch.detections.costs, atol=1e-2)


def test_surer_detections_are_cheaper(batch: TrainingWindow) -> None:
    graph = batch.detections
    assert graph.origin is not None
    rows = torch.as_tensor(graph.detections, dtype=torch.float64)
    found = torch.as_tensor(graph.origin.logits) + 2.0
    changed, dearer = rescored(rows, found, graph)
    assert graph.origin.cost_slope < 0 < graph.origin.slope
    torch.testing.assert_close(dearer, torch.full_like(dearer, 2 * graph.origin.slope * graph.origin.cost_slope))
    cost, logit = (DETECTION_FEATURES.index(name) for name in ("cost", "logit"))
    torch.testing.assert_close(changed[:, cost] - rows[:, cost], dearer)
    torch.testing.assert_close(changed[:, logit] - rows[:, logit], torch.full_like(dearer, 2 * graph.origin.slope))
    others = [k for k in range(rows.shape[1]) if k not in (cost, logit)]
    torch.testing.assert_close(changed[:, others], rows[:, others])


def test_the_gradient_is_that_of_finite_differences(
    batch: TrainingWindow, detector: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one perturbation the loss is a straight line near by, so differences know its slope but for rounding."""
    torch.manual_seed(1)
    module = Association(
        loss=FlowLoss("fenchel_young", 0.7), detector=HeadsLearning(detector[0], weight=0.0), joins=0.0
    ).double()
    assert module.detector is not None
    module._tensor = lambda values: torch.as_tensor(values, dtype=torch.float64)  # type: ignore[method-assign]
    monkeypatch.setattr(window_costs, "normalised", lambda *given: normalised(*given).double())
    torch.nn.init.normal_(module.network.detections.linear.weight, std=0.1)
    module.train()

    def objective() -> torch.Tensor:
        return module.losses(batch, np.random.default_rng(3))[0]

    objective().backward()
    weight = module.detector.network.class_heads[0][1].weight
    assert weight.grad is not None
    largest = weight.grad.abs().flatten().argsort(descending=True)[:4]
    assert weight.grad.abs().max() > 1e-4
    step = 1e-5
    for place in largest.tolist():
        values = []
        for sign in (1, -1):
            with torch.no_grad():
                weight.view(-1)[place] += sign * step
                values.append(objective().item())
                weight.view(-1)[place] -= sign * step
        assert (values[0] - values[1]) / (2 * step) == pytest.approx(float(weight.grad.view(-1)[place]), rel=1e-4)


def test_the_trunk_is_asked_once_an_image(batch: TrainingWindow, detector: tuple[Path, Path]) -> None:
    module, trunk = Association(detector=HeadsLearning(detector[0])).detector, FrozenTrunk(frames_at_most=3)
    assert module is not None
    assert batch.frames is not None
    images = batch.frames.batch.images[:3]
    with torch.no_grad():
        whole = module(images)
        asked = []
        module.network.features.register_forward_hook(lambda *_: asked.append(1))
        for _ in range(2):
            for one, other in zip(trunk.heads(module, images), whole, strict=True):
                torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-4)
        assert len(asked) == 3
        trunk.heads(module, batch.frames.batch.images[3:4])
        trunk.heads(module, images[:1])
        assert len(asked) == 5


def test_only_the_heads_learn(batch: TrainingWindow, detector: tuple[Path, Path]) -> None:
    module = Association(detector=HeadsLearning(detector[0]), loss=FlowLoss(epsilon=3.0))
    assert module.detector is not None
    objective, others = module.losses(batch, np.random.default_rng(0))
    (objective + others).backward()
    network = module.detector.network
    assert all(p.grad is None for p in network.features.parameters())
    assert all(head[1].weight.grad is not None for head in (*network.class_heads, *network.box_heads))
    assert network.class_heads[0][1].weight.grad.abs().sum() > 0
    assert not any(part.training for part in module.detector.modules())
    learnt = sum(p.numel() for group in module.parameter_groups()[2:] for p in group["params"])
    assert learnt == sum(p.numel() for h in (network.class_heads, network.box_heads) for p in h.parameters())


def test_the_own_loss_falls_on_its_own_steps(batch: TrainingWindow, detector: tuple[Path, Path]) -> None:
    module = Association(detector=HeadsLearning(detector[0]))
    assert module.detector is not None
    assert batch.frames is not None
    optimiser = torch.optim.Adam([p for p in module.detector.parameters() if p.requires_grad], lr=1e-2)
    losses = []
    for _ in range(8):
        _, heads = module.outputs(batch)
        assert heads is not None
        loss = own_loss(module.detector, heads, batch.frames)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[-1] < 0.9 * losses[0]


def test_detections_of_a_branch_keep_their_scores(batch: TrainingWindow) -> None:
    origin, frames = batch.detections.origin, batch.frames
    assert origin is not None
    assert frames is not None
    anchors = int(origin.anchors.max()) + 1
    logits = torch.randn(len(frames.batch.images), anchors, 2)
    of_branch = np.arange(len(origin.anchors)) % 2 == 0
    moved = replace(origin, anchors=np.where(of_branch, origin.anchors + anchors, origin.anchors))
    branched = score_logits(logits, frames, replace(batch.detections, origin=moved)).numpy()
    plain = score_logits(logits, frames, batch.detections).numpy()
    np.testing.assert_allclose(branched, np.where(of_branch, origin.logits, plain), rtol=1e-6)


def test_what_does_not_go_together_is_refused(
    street: Path, batch: TrainingWindow, detector: tuple[Path, Path], tmp_path: Path
) -> None:
    together = r"--model\.detector\.file FILE, --data\.detector ONNX and --data\.heads true together"
    with pytest.raises(RequestError, match=together):
        Association().losses(batch, np.random.default_rng(0))
    with pytest.raises(RequestError, match=together):
        Association(detector=HeadsLearning(detector[0])).outputs(replace(batch, frames=None))
    with pytest.raises(RequestError, match=r"expected --data\.detector ONNX with --data\.heads"):
        AssociationData([street], heads=True)
    with pytest.raises(RequestError, match="expected detections of --data"):
        frames_of(replace(batch.detections, origin=None), Detector(anchors=ANCHORS, **SIZE).card)
    with pytest.raises(RequestError, match="expected a checkpoint at"):
        detector_of(tmp_path / "none.ckpt")
    with pytest.raises(RequestError, match=r"expected an exported network at .*none.onnx, found none"):
        detector_of(tmp_path / "none.onnx")
    assert detector_of(Path("street"))[1]["trunk"] == "mobilenet_v3_small"


def test_trains_and_exports(street: Path, detector: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = [f"--data.train=[{street}]", f"--data.detector={detector[1]}", f"--model.detector.file={detector[1]}",
             "--data.heads=true", "--data.score_threshold=0", "--data.batches=2", "--data.seconds=1",
             "--data.val_share=0.2", "--trainer.accelerator=cpu", "--trainer.num_sanity_val_steps=0",
             "--model.optimisation.warmup_steps=1", "--model.detector.rate=1", "--model.loss.epsilon=3",
             f"--out={out}"]  # fmt: skip
    fit_association([*words, "--trainer.max_epochs=1"])
    image = np.random.default_rng(0).integers(0, 255, (SIZE["height"], SIZE["width"], 3)).astype(np.uint8)
    before, after = (exported.Detector(path, 0.0).detect([image])[0] for path in (detector[1], out / "detector.onnx"))
    assert len(after)
    assert len(before) != len(after) or np.abs(before.scores - after.scores).max() > 1e-4
