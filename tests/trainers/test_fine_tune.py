"""`tsuiseki train detector --data FOLDER`, and configurations by name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from jsonargparse import Namespace

from tsuiseki.datamodules.labelled_images import LabelledPart, held_out, labelled_images
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.config import named_config
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.types.class_choice import ClassChoice
from tsuiseki.trainers import fit
from tsuiseki.trainers.detector import Detector, detections
from tsuiseki.trainers.detector_labels import anchor_choice
from tsuiseki.trainers.exporting.export import ModelFile
from tsuiseki.trainers.fine_tune import classes_of
from tsuiseki.trainers.request import TrainingRequest


def walk(folder: Path, frames: int = 10, size: tuple[int, int] = (48, 112)) -> Path:
    """A dark person walking over a light ground."""
    (folder / "img1").mkdir(parents=True)
    (folder / "gt").mkdir()
    rows = []
    for n in range(frames):
        image = np.full((240, 320, 3), 200, dtype=np.uint8)
        x = 10 + 20 * n
        image[60 : 60 + size[1], x : x + size[0]] = 30
        cv2.imwrite(str(folder / "img1" / f"{n + 1:06d}.png"), image)
        rows.append(f"{n + 1},1,{x + 1},61,{size[0]},{size[1]},1,1,1")
    (folder / "gt" / "gt.txt").write_text("\n".join(rows) + "\n")
    return folder


def of_two_classes(folder: Path) -> Path:
    """The walk of a person and a car that stands, as COCO keeps pictures: no tracks."""
    walk(folder)
    kinds = [{"id": 3, "name": "car"}, {"id": 1, "name": "person"}]
    images = [{"id": n, "file_name": f"img1/{n + 1:06d}.png"} for n in range(10)]
    rows = [{"image_id": n, "category_id": 1, "bbox": [10 + 20 * n, 60, 48, 112]} for n in range(10)]
    rows += [{"image_id": n, "category_id": 3, "bbox": [200, 200, 80, 30]} for n in range(10)]
    (folder / "annotations.json").write_text(json.dumps({"images": images, "categories": kinds, "annotations": rows}))
    (folder / "gt" / "gt.txt").unlink()
    return folder


@pytest.mark.slow
def test_classes_that_the_labels_name_are_learnt_and_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--trainer.max_epochs", "1", "--data.batches", "1", "--data.batch_size", "2"]
    words += ["--data.workers", "0", "--model.height", "96", "--model.width", "128", "--trainer.accelerator", "cpu"]
    out, folder = tmp_path / "out", of_two_classes(tmp_path / "set")
    assert main(["train", "detector", "--data", str(folder), "--out", str(out), *words]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("learning person, car")
    assert "on 1 held-out pictures, which chose " in shown
    assert ": shipped AP50 " in shown
    assert "; yours AP50 " in shown
    assert " (AP50 person " in shown.partition("; yours")[2]
    found = exported.Detector(out / "detector.onnx", classes=ClassChoice(["car"]))
    card = found.model.card
    assert (card.input_height, card.input_width, card.training_data) == (96, 128, "set, 90% of each video")
    assert card.class_names == ("person", "car")
    assert found.wanted == {2: "car"}
    again = ["export", "detector", "--checkpoint", str(out / "detector.onnx"), "--out", str(tmp_path / "again.onnx")]
    assert main([*again, "--calibrate", str(folder)]) == 2
    assert "expected a detector of one class, got person, car" in capsys.readouterr().err
    assert main(again) == 0
    assert exported.Detector(tmp_path / "again.onnx").model.card.class_names == ("person", "car")


def test_classes_are_those_that_labels_name_or_that_are_given(tmp_path: Path) -> None:
    folder = of_two_classes(tmp_path / "set")
    assert classes_of(folder) == ["person", "car"]
    assert classes_of(walk(tmp_path / "mot")) == ["person"]
    (first, *_) = labelled_images(folder, classes=["car", "person"])
    assert first.classes.tolist() == [1, 2]
    assert first.boxes.tolist() == [[200, 200, 280, 230], [10, 60, 58, 172]]
    assert [len(one.boxes) for one in labelled_images(folder, classes=["person"])] == [1] * 10


def test_every_class_starts_as_people(tmp_path: Path) -> None:
    anchors: list[list[tuple[float, float]]] = [[(12, 28)], [(20, 50)], [(30, 60)]]
    layout = {"trunk": "mobilenet_v3_small", "height": 64, "width": 64, "anchors": anchors, "channels": 16}
    one = Detector(**layout)
    torch.save({"state_dict": one.state_dict(), "hyper_parameters": dict(one.hparams)}, tmp_path / "one.ckpt")
    three = Detector(classes=["person", "car", "dog"], **layout, start=tmp_path / "one.ckpt")
    images = torch.zeros(1, 64, 64, 3, dtype=torch.uint8)
    people, every = one.eval()(images)[0], three.eval()(images)[0]
    torch.testing.assert_close(every, people[..., [0, 1, 1, 1]])
    more = Detector(
        classes=["person", "car"],
        **{**layout, "anchors": [[*level, (40, 20)] for level in anchors]},
        start=tmp_path / "one.ckpt",
    )
    wide, codes = more.eval()(images)
    for added in (0, 1):
        torch.testing.assert_close(wide[:, added::2], people[..., [0, 1, 1]])
        torch.testing.assert_close(codes[:, added::2], one(images)[1])
    assert three.card.class_names == ("person", "car", "dog")
    logits = torch.tensor([0.0, 1, 5, 1]).expand(1, len(three.network.anchors), 4)
    found = detections(*three.network.decode((logits, torch.zeros(1, len(three.network.anchors), 4))), three.card)
    assert set(found[0].classes.tolist()) == {2}


def test_parts_of_a_video_share_no_picture(tmp_path: Path) -> None:
    folder = walk(tmp_path / "walk", 13)
    parts = [part for (part,) in held_out([LabelledPart(str(folder))], 0.1)]
    learnt, later = ({frame.frame for frame in labelled_images(folder, part=part.part)} for part in parts)
    assert learnt | later == set(range(13))
    assert not learnt & later
    assert len(later) == 1
    with pytest.raises(RequestError, match="no frame lies within 90% to 90% of a video"):
        labelled_images(folder, part=(0.9, 0.9))


def test_anchors_are_those_of_the_start_unless_the_labels_are_of_another_kind(tmp_path: Path) -> None:
    start = [[(24.0, 56.0)], [(48.0, 112.0)]]
    labels = labelled_images(walk(tmp_path / "tall"))
    assert anchor_choice(labels, start, (240, 320))[0] == start
    flat = labelled_images(walk(tmp_path / "flat", size=(90, 12)))
    assert anchor_choice(flat, start, (240, 320)) == (
        start,
        "anchors of the start: mean IoU 0.13 with 10 labels, too few for others",
    )
    flat += labelled_images(walk(tmp_path / "flatter", size=(60, 10)))
    anchors, line = anchor_choice(flat, start, (240, 320))
    assert anchors == [[(60.0, 10.0)], [(90.0, 12.0)]]
    assert line.startswith("anchors of the labels: mean IoU 1.00 with 20 labels")
    # A class that is rare and does not fit gets some beside those of the start.
    cars = [replace(one, classes=np.full(len(one.boxes), 2)) for one in flat]
    assert anchor_choice([*labels, *labels, *labels, *cars], start, (240, 320)) == (
        [[*start[0], (60.0, 10.0)], [*start[1], (90.0, 12.0)]],
        "more anchors, for 20 of 50 labels: mean IoU 1.00, with those of the start 0.14",
    )


@pytest.mark.slow
def test_the_best_epoch_is_exported_and_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exported: list[tuple[Path, Path]] = []
    kept, folder = tmp_path / "out" / "checkpoints", walk(tmp_path / "set")

    def fitted(_: object, __: object, complete: Callable[[Namespace], None]) -> Path:
        model = {"classes": None, "start": "figures", "anchors": None, "height": 480, "width": 640}
        complete(Namespace(model=Namespace(**model), data=Namespace(val=None, val_share=0.1)))
        return kept / "best.ckpt"

    def loaded(_: object, checkpoint: Path) -> Namespace:
        return Namespace(export=lambda out, **_: exported.append((out, checkpoint)) or 0.0)

    chosen: list[int] = []
    monkeypatch.setattr(fit, "fit", fitted)
    monkeypatch.setattr(fit, "load_module", loaded)
    monkeypatch.setattr(fit, "compared", lambda *arguments: chosen.append(arguments[-1]) or "")
    monkeypatch.setattr(ModelFile, "report", lambda *_: None)
    for state in ({"epoch": 2, "global_step": 9}, {"epoch": 0, "global_step": 0}):
        monkeypatch.setattr(fit, "load_checkpoint", lambda _, state=state: state)
        assert fit.fit_detector(["--data", str(folder)]) == kept / "best.ckpt"
    assert exported == [(tmp_path / "out" / "detector.onnx", kept / "best.ckpt")] * 2
    assert chosen == [3, 0]


def test_a_folder_a_file_of_options_and_nothing_are_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (
        ["--data", str(tmp_path), "x"],
        [f"--data={tmp_path}", "x"],
        ["x", "--data", f"{tmp_path}/data.yaml"],
    ):
        request = TrainingRequest.of(words)
        assert (request.folder, request.others) == (tmp_path, ("x",))
    assert TrainingRequest.of(["--data", "options.yaml"]).data == Path("options.yaml")
    assert TrainingRequest.of(["--data.workers", "1"]).folder is None
    for words in (["--out", "x", "--data"], ["--data", "--out", "x"]):
        with pytest.raises(RequestError, match="got nothing"):
            TrainingRequest.of(words)
    with pytest.raises(RequestError, match="expected one argument"):
        TrainingRequest.of(["--config"])
    assert main(["train", "detector", "--data", str(tmp_path / "none"), "--out", str(tmp_path / "o")]) == 2
    for what in ("appearance", "association"):
        assert main(["train", what, "--data", str(tmp_path / "none"), "--out", str(tmp_path / "o")]) == 2
        assert f"expected labelled video at {tmp_path / 'none'}" in capsys.readouterr().err


def test_files_of_options_come_before_the_options_and_fit_is_the_command(tmp_path: Path) -> None:
    commands = ("fit", "validate", "test", "predict")
    recipe, own = (f"--config={named_config(f'detector_{name}')}" for name in ("fine_tune", "own"))
    folder = ["--data", str(tmp_path)]
    learnt = f"--data.train={tmp_path}"
    options = ["--trainer.max_epochs", "-1"]
    cases = [
        ([*options, *folder], ["fit", recipe, learnt, *options]),
        (["test", *folder, *options], ["test", recipe, learnt, *options]),
        (
            [*folder, "--model.network.class_path", "my.Net", "--model.network.init_args", "{}"],
            ["fit", own, learnt, "--model.network=my.Net", "--model.network.init_args", "{}"],
        ),
        (
            [*options, "--config", "a.yaml", *folder, "-c", "b.yaml"],
            ["fit", "--config=a.yaml", "--config=b.yaml", learnt, *options],
        ),
        (["predict", "--data=d.yaml"], ["predict", "--data=d.yaml"]),
    ]
    for words, expected in cases:
        assert TrainingRequest.of(words).words("detector", commands) == expected


def test_configurations_that_ship_go_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert named_config("detector_mot").is_file()
    assert named_config("own/detector.yaml") == Path("own/detector.yaml")
    assert main(["train", "affinity", "--config", "affinity_mots", "--out", "x.onnx"]) == 2
    assert "expected a YAML file or one of action_drone, " in capsys.readouterr().err
    assert main(["train", "detector", "--config", "detector_mots"]) == 2
    assert "affinity_mot," in capsys.readouterr().err


def test_more_anchors_begin_with_the_boxes_of_the_ones_like_them(tmp_path: Path) -> None:
    anchors: list[list[tuple[float, float]]] = [[(12, 28), (20, 44)], [(20, 50)], [(30, 60)]]
    layout = {"trunk": "mobilenet_v3_small", "height": 64, "width": 64, "channels": 16}
    first = Detector(anchors=anchors, **layout)
    for head in first.network.box_heads:
        torch.nn.init.normal_(head[-1].bias)  # type: ignore[index]
    torch.save({"state_dict": first.state_dict(), "hyper_parameters": dict(first.hparams)}, tmp_path / "first.ckpt")
    wider = [[(12.0, 28.0), (20.0, 44.0), (24.0, 24.0)], [(20.0, 50.0)], [(30.0, 60.0), (60.0, 60.0), (90.0, 40.0)]]
    more = Detector(anchors=wider, **layout, start=tmp_path / "first.ckpt")
    images = torch.randint(0, 255, (1, 64, 64, 3), dtype=torch.uint8)
    with torch.no_grad():
        before, after = (d.network.decode(d.eval()(images)) for d in (first, more))
    # (24, 24) begins as (20, 44): 8 x 8 cells of 2 anchors before, and of 3 after.
    for kind in (0, 1):
        old, new = before[kind][0], after[kind][0]
        torch.testing.assert_close(
            new[: 3 * 64].view(64, 3, -1)[:, [0, 1, 1, 2]], old[: 2 * 64].view(64, 2, -1)[:, [0, 1, 1, 1]]
        )
        torch.testing.assert_close(new[-4 * 3 :].view(4, 3, -1), old[-4:, None].expand(4, 3, old.shape[-1]))
