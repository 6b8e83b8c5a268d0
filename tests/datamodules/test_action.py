"""Crops of acting people: cutting, drawing, changing."""

from __future__ import annotations

import gc
import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.action import ActionBatches, ActionData, changed, draw_changes
from tsuiseki.datamodules.action_crops import CropSettings, action_sequences, cut_clip, has_crops, load_crops
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import NO_MOTION, STREAMS

SETTINGS = CropSettings(size=16, margin=0.125, step=2)


def test_crops_show_the_labelled_people(acting_clips: Path, tmp_path: Path) -> None:
    clip = action_sequences(acting_clips / "train")[0]
    cut_clip(clip, SETTINGS, tmp_path / "c")
    crops = load_crops([tmp_path / "c"], STREAMS)
    labels = clip.labels
    wanted = (labels.frames % 2 == 0) & (labels.frames > 0) & ~labels.occluded
    assert len(crops) == wanted.sum()
    assert crops.images["rgb_local"][0].shape[1:] == (20, 20, 3)
    assert crops.images["flow_global"][0].shape[1:] == (20, 20, 2)
    middle = crops.crops("rgb_local", np.arange(len(crops)))[:, 9:11, 9:11].mean(axis=(1, 2))
    # In the generated clips walkers are red and sitters green; JPEG and the interpolation blur that a little.
    walking, sitting = (crops.actions[:, labels.class_names.index(name)] for name in ("Walking", "Sitting"))
    assert (middle[walking].argmax(axis=1) == 0).all()
    assert (middle[sitting].argmax(axis=1) == 1).all()
    flow = crops.crops("flow_local", np.flatnonzero(walking))[:, 8:12, 8:12, 0].astype(int) - NO_MOTION
    assert np.median(flow) == pytest.approx(3 * 127 / 20, abs=3)


def test_clips_are_cut_once_and_anew_when_the_settings_change(acting_clips: Path, tmp_path: Path) -> None:
    folders = [str(acting_clips / part) for part in ("train", "validation")]
    data = ActionData(folders[:1], folders[1:], cache=tmp_path, cutting=SETTINGS)
    data.prepare_data()
    folder = tmp_path / "train-0"
    first = (folder / "rows.npz").stat().st_mtime_ns
    data.prepare_data()
    assert (folder / "rows.npz").stat().st_mtime_ns == first
    other = ActionData(
        [acting_clips / "train"], [acting_clips / "validation"], cache=tmp_path, cutting=replace(SETTINGS, size=24)
    )
    other.prepare_data()
    assert (folder / "rows.npz").stat().st_mtime_ns != first
    (clip, _) = action_sequences(acting_clips / "train")
    assert not has_crops(folder, clip, SETTINGS)


def test_crops_without_a_cache_are_gone_with_their_data_in_silence(acting_clips: Path) -> None:
    data = ActionData([acting_clips / "train"], [acting_clips / "validation"], cutting=SETTINGS)
    data.prepare_data()
    folder = data._temporary
    assert folder is not None
    assert (folder / "train-0" / "rows.npz").is_file()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        del data
        gc.collect()
    assert not folder.exists()


def test_clips_without_people_are_left_out_by_name(
    acting_clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [line.split(" ") for line in (acting_clips / "train/train-0/gt/actions.txt").read_text().splitlines()]
    for name, lost in (("seen", "0"), ("empty", "1")):
        (tmp_path / name / "gt").mkdir(parents=True)
        (tmp_path / name / "img1").symlink_to(acting_clips / "train/train-0/img1")
        text = "\n".join(" ".join([*row[:6], lost, *row[7:]]) for row in rows)
        (tmp_path / name / "gt/actions.txt").write_text(text)
    data = ActionData([tmp_path], [acting_clips / "validation"], cache=tmp_path / "cut", cutting=SETTINGS)
    data.prepare_data()
    data.setup("fit")
    assert "left out, since no person is labelled there:  empty" in capsys.readouterr().err
    assert len(data.train_crops.images["rgb_local"]) == 1
    nobody = ActionData([tmp_path / "empty"], [acting_clips / "validation"], cache=tmp_path / "cut", cutting=SETTINGS)
    with pytest.raises(RequestError, match="expected labelled people with a frame before in the train clips"):
        nobody.prepare_data()


@pytest.mark.parametrize("part", ["rows.npz", "flow_global.npy"])
def test_damaged_crops_are_cut_anew_with_a_warning(
    acting_clips: Path, tmp_path: Path, part: str, capsys: pytest.CaptureFixture[str]
) -> None:
    data = ActionData([acting_clips / "train"], [acting_clips / "validation"], cache=tmp_path, cutting=SETTINGS)
    data.prepare_data()
    damaged = tmp_path / "train-1" / part
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[: len(whole) // 2])
    data.prepare_data()
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{tmp_path / 'train-1'}: expected crops of a clip" in error
    assert error.endswith("; cut anew\n")
    data.setup("fit")
    # Frames 2, 4, … 20 of five people in either clip, one of whom is hidden in frame 4.
    assert len(data.train_crops) == 2 * (10 * 5 - 1)


def test_a_clip_that_breaks_off_leaves_nothing(acting_clips: Path, tmp_path: Path) -> None:
    clip = action_sequences(acting_clips / "train")[0]
    (tmp_path / "crops").mkdir()
    (tmp_path / "broken.jpg").write_bytes(b"no image")
    files = (*clip.files[:3], tmp_path / "broken.jpg", *clip.files[4:])
    with pytest.raises(RequestError, match=r"broken.jpg: expected an image"):
        cut_clip(replace(clip, files=files), SETTINGS, tmp_path / "crops" / "c")
    assert list((tmp_path / "crops").iterdir()) == []


def loaded(acting_clips: Path, folder: Path, rarity: float = 0.5) -> ActionBatches:
    data = ActionData([acting_clips / "train"], [acting_clips / "validation"], cache=folder, cutting=SETTINGS)
    data.prepare_data()
    data.setup("fit")
    return ActionBatches(data.train_crops, STREAMS, 16, 8, 5, rarity, lambda: (0, 1))


def test_batches_are_decided_by_epoch_and_number(acting_clips: Path, tmp_path: Path) -> None:
    batches = loaded(acting_clips, tmp_path)
    again, other = batches[2], batches[3]
    for name in STREAMS:
        assert again.crops[name].shape == (8, 16, 16, 3 if name.startswith("rgb") else 2)
        np.testing.assert_array_equal(batches[2].crops[name], again.crops[name])
    assert not np.array_equal(again.crops["rgb_local"], other.crops["rgb_local"])
    with pytest.raises(IndexError):
        batches[5]


def test_rare_actions_are_drawn_more_often(acting_clips: Path, tmp_path: Path) -> None:
    even, rare = (loaded(acting_clips, tmp_path, rarity=r) for r in (0.0, 1.0))
    share = even.crops.actions.mean(axis=0)
    rarest = int(np.flatnonzero(share > 0)[share[share > 0].argmin()])
    performed = even.crops.actions[:, rarest]
    np.testing.assert_allclose(even.chances, 1 / len(even.crops))
    assert rare.chances[performed].sum() > 1.5 * even.chances[performed].sum()


def test_mirrors_turn_the_flow_round() -> None:
    rng = np.random.default_rng(0)
    images = rng.integers(1, 256, (2, 12, 12, 4)).astype(np.uint8)
    change = draw_changes(rng, 2)
    change["shift"][:] = 0.5
    change["left_right"][:] = change["top_bottom"][:] = True
    found = changed(images, change, 10, is_flow=True)
    np.testing.assert_array_equal(found, 2 * NO_MOTION - images[:, 10:0:-1, 10:0:-1].astype(int))
    sideways = changed(images, change | {"top_bottom": np.zeros(2, bool)}, 10, is_flow=True)
    np.testing.assert_array_equal(sideways[..., 1::2], images[:, 1:11, 10:0:-1, 1::2])
    np.testing.assert_array_equal(sideways[..., ::2], 2 * NO_MOTION - images[:, 1:11, 10:0:-1, ::2].astype(int))


def test_colours_change_a_sample_as_a_whole() -> None:
    change = draw_changes(np.random.default_rng(1), 3)
    images = np.full((3, 10, 10, 3), 100, dtype=np.uint8)
    found = changed(images, change, 8, is_flow=False)
    assert (np.ptp(found.reshape(3, -1, 3), axis=1) == 0).all()
    assert len(np.unique(found[:, 0, 0], axis=0)) == 3


def test_request_errors(acting_clips: Path, tmp_path: Path) -> None:
    train = acting_clips / "train"
    with pytest.raises(RequestError, match="different names"):
        ActionData([train], [train], cache=tmp_path).prepare_data()
    with pytest.raises(RequestError, match="`val`: expected at least one folder of labelled video"):
        ActionData([train], [], cache=tmp_path)
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "gt").symlink_to(train / "train-0" / "gt")
    (broken / "img1").mkdir()
    cv2.imwrite(str(broken / "img1" / "000001.jpg"), np.zeros((18, 32, 3), np.uint8))
    with pytest.raises(RequestError, match="labels reach frame 21"):
        action_sequences(broken)
