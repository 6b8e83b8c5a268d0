"""What a training refuses before its first batch: images that cannot be read, epochs of nothing, wrong checkpoints."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from tsuiseki.datamodules.detector import DetectionData
from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.fit import fit_detector
from tsuiseki.trainers.refusals import CHECKPOINT_PARTS, check_checkpoint, in_one_line


@pytest.fixture
def coco(tmp_path: Path) -> Path:
    """Six images of 64x64 with a person in each."""
    folder = tmp_path / "labelled"
    (folder / "images").mkdir(parents=True)
    images, annotations = list[dict[str, Any]](), list[dict[str, Any]]()
    for number in range(6):
        name = f"{number:04}.jpg"
        picture = np.random.default_rng(number).integers(0, 255, (64, 64, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / "images" / name), picture)
        images.append({"id": number + 1, "file_name": name, "width": 64, "height": 64})
        box = {"bbox": [4 + 8 * number, 18, 12, 28], "area": 336, "iscrowd": 0}
        annotations.append({"id": number + 1, "image_id": number + 1, "category_id": 1, "track_id": 1, **box})
    labels = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "person"}]}
    (folder / "coco.json").write_text(json.dumps(labels))
    return folder


def arguments(coco: Path, out: Path, *more: str, settings: str = "") -> list[str]:
    source = f"[{{folder: {coco / 'coco.json'}{settings}}}]"
    network = ["--model.trunk=mobilenet_v3_small", "--model.height=64", "--model.width=64"]
    quick = ["--trainer.max_steps=2", "--trainer.accelerator=cpu", "--data.batch_size=2"]
    return [*network, *quick, f"--data.train={source}", f"--data.val={source}", f"--out={out}", *more]


def test_whole_images_are_taken(coco: Path) -> None:
    assert [label.picture.name for label in labelled_images(coco / "coco.json")] == [f"{n:04}.jpg" for n in range(6)]


@pytest.mark.parametrize("settings", ["", ", fixed_camera: true"])
def test_a_missing_image_is_named(coco: Path, tmp_path: Path, settings: str) -> None:
    (coco / "images" / "0003.jpg").unlink()
    with pytest.raises(RequestError, match=r"images/0003\.jpg: expected an image, found none"):
        fit_detector(arguments(coco, tmp_path / "out", settings=settings))


def test_a_missing_image_is_not_made_up_for_by_another(coco: Path) -> None:
    (coco / "images" / "0003.jpg").rename(coco / "images" / "other.jpg")
    with pytest.raises(RequestError, match=r"images/0003\.jpg: expected an image, found none"):
        labelled_images(coco / "coco.json")


@pytest.mark.slow
@pytest.mark.parametrize("content", ["truncated", "text", "nothing", "link"])
def test_an_image_that_cannot_be_read_is_named(coco: Path, tmp_path: Path, content: str) -> None:
    image = coco / "images" / "0003.jpg"
    whole = image.read_bytes()
    image.unlink()
    if content == "link":
        image.symlink_to("nowhere.jpg")
    else:
        image.write_bytes({"truncated": whole[: len(whole) // 2], "text": b"no picture", "nothing": b""}[content])
    with pytest.raises(RequestError, match=r"images/0003\.jpg: expected an image") as refused:
        fit_detector(arguments(coco, tmp_path / "out"))
    assert "\n" not in str(refused.value)


def test_of_a_sequence_the_first_number_without_an_image_is_told(tmp_path: Path) -> None:
    (tmp_path / "walk" / "img1").mkdir(parents=True)
    (tmp_path / "walk" / "gt").mkdir()
    for number in (1, 2, 3, 5, 6):
        cv2.imwrite(str(tmp_path / "walk" / "img1" / f"{number:06}.png"), np.zeros((64, 64, 3), np.uint8))
    (tmp_path / "walk" / "gt" / "gt.txt").write_text("\n".join(f"{n},1,5,19,12,28,1,1,1" for n in range(1, 7)))
    with pytest.raises(RequestError, match=r"1 images are left out, the first after 000003\.png; labels go by the num"):
        labelled_images(tmp_path / "walk")


def test_what_a_process_that_prepares_images_refuses_is_one_line() -> None:
    reason = "images/7.jpg: expected an image, got something that cannot be decoded; replace or remove it"
    text = f"Caught RequestError in DataLoader worker process 0.\nOriginal Traceback:\n  File\nx.RequestError: {reason}"
    assert str(in_one_line(RequestError(text))) == reason
    assert in_one_line(ValueError("something else")) is None


def test_an_epoch_without_a_batch_is_refused(coco: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # As where one batch is shared out to two devices.
    monkeypatch.setattr(DetectionData, "train_dataloader", lambda _: DataLoader(list[int]()))
    with pytest.raises(RequestError, match=r"^an epoch has no batch; give a smaller --data\.batch_size"):
        fit_detector(arguments(coco, tmp_path / "out"))
    assert json.loads((tmp_path / "out" / "run.json").read_text())["partial"] is True


@pytest.mark.parametrize("content", [b"just text\n", b"", b"\x80\x02}q\x00.", b"PK\x03\x04", bytes(range(256))])
def test_a_file_that_is_no_checkpoint_is_refused_in_one_line(coco: Path, tmp_path: Path, content: bytes) -> None:
    wrong = tmp_path / "wrong.ckpt"
    wrong.write_bytes(content)
    with pytest.raises(RequestError, match=r"wrong\.ckpt: expected a checkpoint of a training, [^\n]*$"):
        fit_detector(arguments(coco, tmp_path / "out", f"--ckpt_path={wrong}"))
    assert not (tmp_path / "out").exists()


def test_weights_alone_a_list_and_an_archive_are_no_checkpoints(tmp_path: Path) -> None:
    path = tmp_path / "wrong.ckpt"
    for value, reason in (({"state_dict": {}}, "no loops"), ([1, 2], "no parts of a training"), (3, "no parts")):
        torch.save(value, path)
        with pytest.raises(RequestError, match=f"expected a checkpoint of a training, found {reason}"):
            check_checkpoint(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("text", "text")
    with pytest.raises(RequestError, match="got something else"):
        check_checkpoint(path)


def test_a_checkpoint_of_another_network_is_refused_in_one_line(coco: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.ckpt"
    held: dict[str, Any] = {part: {} for part in CHECKPOINT_PARTS}
    held |= {"state_dict": {"other.weight": torch.zeros(2)}, "pytorch-lightning_version": "2.6.1"}
    torch.save(held, other)
    with pytest.raises(
        RequestError, match=r"^expected a checkpoint of this Detector, got one of another network: [^\n]*$"
    ):
        fit_detector(arguments(coco, tmp_path / "out", f"--ckpt_path={other}"))


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("case", ["missing_image", "trunc"])
def test_the_image_of_the_cases_is_named(data_folder: Path, tmp_path: Path, case: str) -> None:
    place = data_folder / "cases/round2/06-training"
    assert len(labelled_images(place / "ok" / "coco.json")) == 6
    with pytest.raises(RequestError, match=r"images/0003\.jpg: expected an image"):
        fit_detector(arguments(place / case, tmp_path / "out"))


@pytest.mark.slow
def test_the_help_lists_no_class_of_torchvision(capsys):
    with pytest.raises(SystemExit):
        fit_detector(["--help"])
    printed = capsys.readouterr().out
    assert "fine-tunes on labelled video" in printed
    assert "torchvision.models" not in printed
