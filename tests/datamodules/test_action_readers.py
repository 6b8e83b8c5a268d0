"""Drone-Action and Okutama-Action as what `tsuiseki train action` learns from."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tsuiseki.datamodules.action import ActionData
from tsuiseki.datamodules.action_crops import CropSettings, action_sequences, frame_reader
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.drone_action import DRONE_ACTION_CLASSES

SETTINGS = CropSettings(size=16, margin=0.125, step=2)
FRAMES = 7


def drawn(number: int) -> np.ndarray:
    """A red person on grey who goes 4 pixels a frame to the right; brighter from frame to frame."""
    image = np.full((48, 64, 3), 90 + 8 * number, dtype=np.uint8)
    image[10:34, 6 + 4 * number : 18 + 4 * number] = (0, 0, 230)
    return image


def write_boxes(path: Path, frames: int = FRAMES) -> None:
    rows = [f"{7 + 4 * n},11,12,24" if n != 4 else "nan,nan,nan,nan" for n in range(frames)]
    path.write_text("\n".join(rows) + "\n")


@pytest.fixture
def drone_action(tmp_path: Path) -> Path:
    """A clip of images and one as a video, in two classes, and another to validate on."""
    folder = tmp_path / "drone_action"
    images = folder / "clapping" / "S1_clapping_HD"
    images.mkdir(parents=True)
    for number in range(FRAMES):
        cv2.imwrite(str(images / f"{number + 1}.png"), drawn(number))
    write_boxes(folder / "clapping" / "S1_clapping_HD.txt")
    (folder / "jogging_f_b").mkdir()
    video = cv2.VideoWriter(
        str(folder / "jogging_f_b" / "S2_jogging_HD.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48)
    )
    for number in range(FRAMES):
        video.write(drawn(number))
    video.release()
    write_boxes(folder / "jogging_f_b" / "S2_jogging_HD.txt")
    other = tmp_path / "other" / "kicking"
    shutil.copytree(images, other / "S3_kicking_HD")
    write_boxes(other / "S3_kicking_HD.txt")
    return folder


def test_clips_of_images_and_of_video_have_their_one_action(drone_action: Path) -> None:
    clapping, jogging = action_sequences(drone_action)
    for clip, action in ((clapping, "clapping"), (jogging, "jogging_front_back_view")):
        assert clip.labels.class_names == DRONE_ACTION_CLASSES
        assert clip.labels.frames.tolist() == [0, 1, 2, 3, 5, 6]
        np.testing.assert_array_equal(clip.labels.actions.sum(axis=0) > 0, np.array(DRONE_ACTION_CLASSES) == action)
        assert clip.labels.boxes[1].tolist() == [10, 10, 22, 34]
    still, moving = frame_reader(clapping), frame_reader(jogging)
    for number in (0, 1, 4):
        image, decoded, person = still(number), moving(number), np.s_[14:30, 10 + 4 * number : 14 + 4 * number]
        np.testing.assert_array_equal(image, drawn(number)[:, :, ::-1])
        # JPEG keeps flat areas to a few grey levels; neighbouring frames differ by 8.
        np.testing.assert_allclose(decoded[40:].mean(), image[40:].mean(), atol=3)
        np.testing.assert_allclose(decoded[person].mean(axis=(0, 1)), (230, 0, 0), atol=12)


def test_drone_action_trains_an_action_network(drone_action: Path, tmp_path: Path) -> None:
    data = ActionData([drone_action], [tmp_path / "other"], cache=tmp_path / "cache", cutting=SETTINGS)
    data.prepare_data()
    data.setup("fit")
    assert data.names == DRONE_ACTION_CLASSES
    # Of the frames 2, 4 and 6 the person is out of view in the fourth.
    assert data.train_crops.row.tolist() == [0, 1, 0, 1]
    middle = data.train_crops.crops("rgb_local", np.arange(4))[:, 9:11, 9:11].mean(axis=(1, 2))
    np.testing.assert_allclose(middle, np.tile([230, 0, 0], (4, 1)), atol=12)


@pytest.mark.slow
def test_the_command_line_trains_on_drone_action(
    drone_action: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = {
        "out": tmp_path / "out", "overwrite": "true", "data.train": f"[{drone_action}]",
        "data.val": f"[{tmp_path / 'other'}]", "data.cache": tmp_path / "cache", "data.batches": 1,
        "data.batch_size": 2, "data.cutting": "{step: 2}", "trainer.max_epochs": 1, "trainer.accelerator": "cpu",
        "model.trunk": "mobilenet_v3_small", "model.size": 32, "model.streams": "[rgb_local]",
    }  # fmt: skip
    words = ["train", "action", *(f"--{name}={value}" for name, value in values.items())]
    assert main(words) == 2
    assert "expected clips with 12 actions, got 13: clapping, hitting_bottle" in capsys.readouterr().err
    assert main([*words, "--model.actions=13"]) == 0
    best = tmp_path / "out/checkpoints/best.ckpt"
    state = torch.load(best, weights_only=True)
    assert tuple(state["action_names"]) == DRONE_ACTION_CLASSES
    assert main(["export", "action", "--checkpoint", str(best), "--out", str(tmp_path / "action.onnx")]) == 0


def test_another_clip_of_the_same_name_is_cut_anew(drone_action: Path, tmp_path: Path) -> None:
    def crops() -> np.ndarray:
        data = ActionData([drone_action], [tmp_path / "other"], cache=tmp_path / "cache", cutting=SETTINGS)
        data.prepare_data()
        data.setup("fit")
        return data.train_crops.crops("rgb_local", np.arange(4))

    first = crops()
    boxes = drone_action / "clapping" / "S1_clapping_HD.txt"
    boxes.write_text(boxes.read_text().replace(",11,12,24", ",20,12,24"))
    assert not np.array_equal(crops()[:2], first[:2])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (9, r"S2_jogging_HD\.avi: expected at least 8 frames, got fewer; are its labels another video's"),
        (0, r"S2_jogging_HD\.avi: expected its boxes in .*S2_jogging_HD\.txt, found none"),
    ],
)
def test_boxes_that_do_not_belong_to_the_video_are_named(
    drone_action: Path, tmp_path: Path, rows: int, message: str
) -> None:
    labels = drone_action / "jogging_f_b" / "S2_jogging_HD.txt"
    labels.unlink()
    if rows:
        write_boxes(labels, rows)
    data = ActionData([drone_action], [tmp_path / "other"], cache=tmp_path / "cache", cutting=SETTINGS)
    with pytest.raises(RequestError, match=message):
        data.prepare_data()
