"""`tsuiseki train detector --data FOLDER`, and configurations by name."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.parser import named_config
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.trainers.networks.detector_labels import anchor_choice
from tsuiseki.trainers.networks.fine_tune import HELD_OUT, LEARNT, folder_of


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


@pytest.mark.slow
def test_a_folder_of_labels_becomes_a_detector(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--trainer.max_epochs", "1", "--data.examples_per_epoch", "2", "--data.batch_size", "2"]
    words += ["--data.workers", "0", "--model.height", "96", "--model.width", "128", "--trainer.accelerator", "cpu"]
    out = tmp_path / "out"
    assert main(["train", "detector", "--data", str(walk(tmp_path / "walk")), "--out", str(out), *words]) == 0
    shown = capsys.readouterr().out
    assert "on 1 held-out pictures: shipped AP50" in shown
    card = Detector(out / "detector.onnx").model.card
    assert (card.input_height, card.input_width, card.training_data) == (96, 128, "walk, 90% of each video")


def test_parts_of_a_video_share_no_picture(tmp_path: Path) -> None:
    folder = walk(tmp_path / "walk", 13)
    learnt, held_out = ({one.frame for one in labelled_images(folder, part=part)} for part in (LEARNT, HELD_OUT))
    assert learnt | held_out == set(range(13))
    assert not learnt & held_out
    assert len(held_out) == 1
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


def test_a_folder_a_file_of_options_and_nothing_are_told_apart(tmp_path: Path) -> None:
    assert folder_of(["--data", str(tmp_path)]) == folder_of([f"--data={tmp_path}"]) == tmp_path
    assert folder_of(["--data", "data.yaml"]) is folder_of(["--data.workers", "1"]) is None
    with pytest.raises(RequestError, match="got nothing"):
        folder_of(["--out", "x", "--data"])
    assert main(["train", "detector", "--data", str(tmp_path / "none"), "--out", str(tmp_path / "o")]) == 2


def test_configurations_that_ship_go_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert named_config("detector_mot").is_file()
    assert named_config("own/detector.yaml") == Path("own/detector.yaml")
    assert main(["train", "affinity", "--config", "affinity_mots", "--out", "x.onnx"]) == 2
    assert "expected a YAML file or one of action_drone, " in capsys.readouterr().err
    assert main(["train", "detector", "--config", "detector_mots"]) == 2
    assert "affinity_mot," in capsys.readouterr().err
