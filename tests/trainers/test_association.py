"""`tsuiseki train association`: learns, resumes, exports, and names what it cannot use."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tsuiseki.tracking.association.evidence import LINK_FEATURES
from tsuiseki.tracking.association.learnt_costs import CostNetwork
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.trainers.association import PLANNED, PLANNED_STEPS, Association
from tsuiseki.trainers.exporting import export_costs
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.exporting.export_costs import export_trained
from tsuiseki.trainers.exporting.written_costs import TOLERANCE
from tsuiseki.trainers.fit import ASSOCIATION, fit
from tsuiseki.trainers.flow.flow_loss import FlowLoss, FlowLossName
from tsuiseki.trainers.flow.windows import AssociationData, EveryWindow, RandomWindows, TrainingWindow

FRAMES = 90


def write_walk(folder: Path, people: int = 4, det: bool = True, extra: str = "", away: float = 0.0) -> Path:
    """People who cross, each detected in most frames, and clutter of low scores."""
    rng = np.random.default_rng(0)
    (folder / "gt").mkdir(parents=True)
    write_sequence_info(folder, folder.name, 30.0, FRAMES, 640, 480)
    labels, found = [], []
    for t in range(1, FRAMES + 1):
        for k in range(people):
            x = 40 + 5 * t if k % 2 else 500 - 5 * t
            row = f"{x:.1f},{80 + 30 * k},40,100"
            labels.append(f"{t},{k + 1},{row},1,1,1")
            if rng.random() < 0.85:
                x, y = np.array([x + away, 80 + 30 * k]) + rng.normal(0, 3, 2)
                found.append(f"{t},-1,{x:.1f},{y:.1f},40,100,{rng.uniform(0.6, 1):.2f},-1,-1,-1")
        if rng.random() < 0.5:
            x, y = rng.uniform(0, 400, 2) + away
            found.append(f"{t},-1,{x:.1f},{y:.1f},30,80,{rng.uniform(0.3, 0.7):.2f},-1,-1,-1")
    (folder / "gt" / "gt.txt").write_text("\n".join(labels) + "\n" + extra)
    if det:
        (folder / "det").mkdir()
        (folder / "det" / "det.txt").write_text("\n".join(found) + "\n")
    return folder


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_walk(tmp_path_factory.mktemp("walks") / "walk")


def options(walk: Path, out: Path, *more: str) -> list[str]:
    trainer = {"accelerator": "cpu", "max_epochs": 2, "num_sanity_val_steps": 0, "gradient_clip_val": 1.0}
    data = {"train": f"[{walk}]", "seconds": 1.0, "batches": 8}
    words = [f"--{g}.{k}={v}" for g, values in (("trainer", trainer), ("data", data)) for k, v in values.items()]
    return [*words, f"--out={out}", *more]


@pytest.fixture(scope="module")
def trained(walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("association") / "out"
    assert main(["train", "association", *options(walk, out, "--model.optimisation.warmup_steps=1")]) == 0
    return out


def column(out: Path, name: str, version: int = 0) -> list[float]:
    with (out / "metrics" / f"version_{version}" / "metrics.csv").open() as file:
        return [float(row[name]) for row in csv.DictReader(file) if row.get(name)]


def weights(checkpoint: Path) -> dict[str, torch.Tensor]:
    return dict(load_module(Association, checkpoint).network.state_dict())


@pytest.mark.slow
def test_logs_and_exports(trained: Path) -> None:
    objective = column(trained, "train/objective")
    assert objective[-1] < objective[0]
    assert 0.5 < column(trained, "val/agreement")[-1] <= 1
    assert {"val/mota", "val/switches"} <= set(
        (trained / "metrics/version_0/metrics.csv").read_text().split("\n")[0].split(",")
    )
    assert list((trained / "tensorboard").iterdir())
    network = load_module(Association, trained / "checkpoints" / "best.ckpt").network
    rows = np.random.default_rng(0).normal(size=(9, len(LINK_FEATURES)))
    with torch.no_grad():
        expected = network.links(torch.as_tensor(rows, dtype=torch.float32))[:, 0].numpy()
    assert expected.any()
    np.testing.assert_allclose(
        CostNetwork(trained / "association.onnx", threads=1).links(rows), expected, atol=TOLERANCE
    )


def test_the_same_seed_gives_the_same_weights(trained: Path, walk: Path, tmp_path: Path) -> None:
    words = options(walk, tmp_path / "again", "--model.optimisation.warmup_steps=1")
    fit(ASSOCIATION, words)
    one, other = weights(trained / "checkpoints/last.ckpt"), weights(tmp_path / "again/checkpoints/last.ckpt")
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_goes_on_where_it_was(trained: Path, walk: Path) -> None:
    before = weights(trained / "checkpoints/last.ckpt")["links.mean"]
    last = f"--ckpt_path={trained / 'checkpoints/last.ckpt'}"
    fit(ASSOCIATION, options(walk, trained, "--trainer.max_epochs=3", last))
    assert len(column(trained, "train/objective", version=1)) == 1
    torch.testing.assert_close(weights(trained / "checkpoints/last.ckpt")["links.mean"], before)
    # A training that had ended goes on at the rate it ended with.
    (schedule,) = torch.load(trained / "checkpoints/last.ckpt", weights_only=True)["lr_schedulers"]
    assert schedule["_last_lr"] == pytest.approx([0.01 * 3e-3] * 2)


def test_tracks_with_what_was_learnt(trained: Path, walk: Path, tmp_path: Path) -> None:
    words = ["track", "people", str(walk), "--detections", str(walk / "det/det.txt"), "--out", str(tmp_path / "out")]
    assert main([*words, "--affinity", str(trained / "association.onnx")]) == 0
    assert (tmp_path / "out" / "tracks.txt").read_text()


@pytest.mark.parametrize("loss", ["fenchel_young", "hinge", "both"])
def test_the_gradient_of_a_step_reaches_all_that_makes_costs(walk: Path, loss: FlowLossName) -> None:
    data = AssociationData([walk], seconds=1.0, batches=2)
    data.setup("fit")
    module = Association(loss=FlowLoss(loss, 3.0), joins=1.0)
    module.standardise(data.learnt)
    module.log = lambda *_, **__: None  # type: ignore[method-assign]
    for index in range(2):
        total = module.training_step(RandomWindows(data.learnt, 1.0, 2, lambda: (0, 0))[index], 0)
        assert total is not None
        total.backward()
    assert module.network.links.linear.weight.grad is not None
    assert module.network.links.linear.weight.grad.any()
    assert module.network.detections.linear.weight.grad is not None
    reached = module.network.detections.linear.weight.grad.abs().sum(dim=1) > 0
    # The hinge has no gradient in the costs that its one cheaper flow shares with the labelled one; noise reaches all.
    assert reached.all() if loss != "hinge" else reached.any()


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_a_step_on_the_gpu(walk: Path) -> None:
    data = AssociationData([walk], seconds=1.0, batches=1)
    data.setup("fit")
    batch = RandomWindows(data.learnt, 1.0, 1, lambda: (0, 0))[0]
    gradients = []
    for device in ("cpu", "cuda"):
        module = Association(joins=1.0).to(device)
        module.standardise(data.learnt)
        objective, others = module.losses(batch, np.random.default_rng(0))
        (objective + others).backward()  # type: ignore[no-untyped-call]
        found = module.network.links.linear.weight.grad
        assert found is not None
        assert found.device.type == device
        gradients.append(found.cpu().numpy())
    np.testing.assert_allclose(*gradients, atol=1e-4)


def test_windows_are_drawn_anew_every_epoch(walk: Path) -> None:
    data = AssociationData([walk], seconds=0.5, batches=6)
    data.setup("fit")
    names = [[w.detections.name for w in RandomWindows(data.learnt, 0.5, 6, lambda e=e: (0, e))] for e in (0, 0, 1)]
    assert names[0] == names[1] != names[2]
    held = EveryWindow(data.held, 0.5)
    assert sum(len(held[k].detections.people) for k in range(len(held))) == 4 * round(0.2 * FRAMES)


def test_a_window_without_detections_is_no_step(walk: Path) -> None:
    data = AssociationData([walk])
    data.setup("fit")
    graph = data.learnt[0].detections
    from tsuiseki.trainers.flow.graphs import window

    nothing = TrainingWindow(window(graph, 5000, 5010), data.learnt[0].tracklets)
    assert Association().training_step(nothing, 0) is None


def test_a_loss_that_is_no_number_names_its_window(walk: Path) -> None:
    data = AssociationData([walk])
    data.setup("fit")
    module = Association()
    module.log = lambda *_, **__: None  # type: ignore[method-assign]
    module.standardise(data.learnt)
    nothing = torch.full((2,), float("nan"), requires_grad=True)
    module.flow.forward = lambda *_, **__: SimpleNamespace(loss=nothing)  # type: ignore[assignment,method-assign]
    with pytest.raises(RunError, match=r"loss is nan on walk, frames \d+-\d+; lower"):
        module.training_step(EveryWindow(data.learnt, 1.0)[0], 0)


@pytest.mark.parametrize("part", ["links", "detections"])
def test_weights_that_ran_away_name_the_window(walk: Path, part: str) -> None:
    data = AssociationData([walk])
    data.setup("fit")
    module = Association()
    torch.nn.init.constant_(getattr(module.network, part).linear.weight, float("nan"))
    batch, rng = EveryWindow(data.learnt, 1.0)[0], np.random.default_rng(0)
    with pytest.raises(RunError, match=r"cost is nan on walk, .*; lower"):
        module.losses(batch, rng)


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that networks are exported to; nothing is converted."""
    files: list[Path] = []
    monkeypatch.setattr(export_costs, "export_association", lambda _, path, *__, **___: files.append(path) or 0.0)
    return files


def test_an_unfinished_training_is_exported_only_where_asked(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], written: list[Path]
) -> None:
    best, out = trained / "checkpoints" / "best.ckpt", tmp_path / "part.onnx"
    whole = ["export", "association", "--checkpoint", str(best), "--out", str(tmp_path / "whole.onnx")]
    assert main(whole) == 0
    assert "--ckpt_path" not in capsys.readouterr().out
    held = torch.load(best, weights_only=True)
    assert held[PLANNED] >= 2
    first = tmp_path / "first.ckpt"
    torch.save({**held, PLANNED: 6, "epoch": 0}, first)
    words = ["export", "association", "--checkpoint", str(first), "--out", str(out)]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert "expected a training that has ended, got one that has had 1 of 6 epochs" in told
    assert "with --unfinished" in told
    assert written == [tmp_path / "whole.onnx"]
    assert main([*words, "--unfinished"]) == 0
    assert "of a training that has had 1 of 6 epochs; --ckpt_path goes on with it" in capsys.readouterr().out
    assert written[1:] == [out]


def test_a_training_that_had_all_its_steps_has_ended(trained: Path, tmp_path: Path, written: list[Path]) -> None:
    held = torch.load(trained / "checkpoints" / "best.ckpt", weights_only=True)
    taken = held["global_step"]
    assert held[PLANNED_STEPS] == -1
    for steps, ended in ((taken, True), (taken + 1, False)):
        torch.save({**held, PLANNED: 1000, PLANNED_STEPS: steps}, tmp_path / "steps.ckpt")
        if ended:
            export_trained(checkpoint=tmp_path / "steps.ckpt", out=tmp_path / "steps.onnx")
        else:
            with pytest.raises(RequestError, match=r"has had \d of 1000 epochs; go on with --ckpt_path .*steps\.ckpt"):
                export_trained(checkpoint=tmp_path / "steps.ckpt", out=tmp_path / "more.onnx")
    assert written == [tmp_path / "steps.onnx"]


def test_an_unfinished_training_is_not_exported(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="expected a checkpoint at"):
        export_trained(checkpoint=tmp_path / "best.ckpt", out=tmp_path / "a.onnx")
    import lightning

    trainer = lightning.Trainer(max_epochs=0, accelerator="cpu", logger=False, enable_progress_bar=False)
    module = Association()
    trainer.strategy.connect(module)
    trainer.save_checkpoint(tmp_path / "first.ckpt")
    with pytest.raises(RequestError, match="expected a trained network, but it changes no cost"):
        export_trained(checkpoint=tmp_path / "first.ckpt", out=tmp_path / "a.onnx")


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ({"det": False}, r"expected det/det.txt beside the labels of odd"),
        ({"people": 1}, r"expected a sequence with two people, .* got odd"),
        ({"extra": "3,1,5,5,40,100,1,1,1\n"}, r"id 1 stands twice in frame 3"),
        ({"away": 3000.0}, r"odd: expected detections on labelled people, but none of \d+ overlaps one by half"),
    ],
    ids=["no detections", "one person", "an id twice", "on nobody"],
)
def test_unusable_sequences_are_named(tmp_path: Path, what: dict[str, object], message: str) -> None:
    folder = write_walk(tmp_path / "odd", **what)  # type: ignore[arg-type]
    with pytest.raises(RequestError, match=message):
        AssociationData([folder]).setup("fit")


def test_what_teaches_nothing_beside_others_is_left_out_by_name(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = write_walk(tmp_path / "alone", people=1)
    late = write_walk(tmp_path / "late")
    rows = (late / "gt" / "gt.txt").read_text().splitlines()
    (late / "gt" / "gt.txt").write_text("\n".join(row for row in rows if int(row.split(",")[0]) > 80) + "\n")
    data = AssociationData([walk, alone, late])
    data.setup("fit")
    assert [one.detections.name for one in data.learnt] == ["walk"]
    told = capsys.readouterr().out
    assert "alone: left out, for its detections in the frames to learn from show one person who is labelled" in told
    assert "late: left out, for its detections in the frames to learn from show no person who is labelled" in told


def test_labels_of_half_of_the_people_look_foreign(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    some = write_walk(tmp_path / "some", people=5)
    rows = (some / "gt" / "gt.txt").read_text().splitlines()
    (some / "gt" / "gt.txt").write_text("\n".join(row for row in rows if row.split(",")[1] in "12") + "\n")
    AssociationData([walk, some]).setup("fit")
    told = capsys.readouterr().out
    assert re.search(r"some: 6\d% of its detections are false positives; are all labelled, and of the same class", told)
    assert "walk" not in told


def test_how_far_changes_are_trusted_is_as_asked_and_not_as_it_was(trained: Path) -> None:
    checkpoint = trained / "checkpoints" / "best.ckpt"
    assert Association().network.detections.trust.tolist() == [0.5, 1, 1]
    loaded = Association.load_from_checkpoint(checkpoint, trust=0.25, weights_only=True)
    assert loaded.network.detections.trust.tolist() == [0.25, 1, 1]
    assert loaded.network.links.linear.weight.any()


def test_labels_of_other_classes_are_named(tmp_path: Path) -> None:
    folder = write_walk(tmp_path / "cars")
    labels = (folder / "gt" / "gt.txt").read_text().replace(",1,1,1\n", ",1,3,1\n")
    (folder / "gt" / "gt.txt").write_text(labels)
    with pytest.raises(RequestError, match="cars"):
        AssociationData([folder]).setup("fit")


def test_a_wrong_setting_is_one_line(capsys: pytest.CaptureFixture[str], walk: Path, tmp_path: Path) -> None:
    words = ["train", "association", *options(walk, tmp_path / "out", "--model.loss.epsilon=0")]
    assert main(words) == 2
    assert "epsilon above 0" in capsys.readouterr().err
