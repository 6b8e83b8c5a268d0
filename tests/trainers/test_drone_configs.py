"""The thesis-size configurations of chapter 5: a step on generated data in its own folder layout, export, tracking."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
from tsuiseki.datamodules.scenes.people.person import render_person_sprite
from tsuiseki.models.backbones import build_trunk
from tsuiseki.models.detector import people_detector
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.trainers.detector_network import take_over
from tsuiseki.trainers.fit import fit_action, fit_appearance, fit_detector

CONFIGS = Path(str(resources.files("tsuiseki.configs")))
TINY = ["--trainer.accelerator=cpu", "--trainer.max_epochs=1", "--trainer.limit_val_batches=1", "--data.workers=0"]


@pytest.mark.slow
def test_ssd512_trains_on_okutamas_layout(tmp_path):
    settings = DroneSceneSettings(width=320, height=180, frames=4, people=3, clutter=0, layout="okutama")
    folder = write_clip(tmp_path / "okutama", DroneClip(settings, 0))
    sources = f"[{{folder: {folder}}}]"
    words = ["--config", str(CONFIGS / "detector_okutama.yaml"), "--out", str(tmp_path / "out"), *TINY]
    words += ["--trainer.precision=32", "--model.weights=null", "--data.train", sources, "--data.val", sources]
    best = fit_detector([*words, "--data.batch_size=1", "--data.batches=1"])
    state = torch.load(best, weights_only=True)
    assert state["global_step"] == 1
    assert all(torch.isfinite(value).all() for value in state["state_dict"].values())
    exported = tmp_path / "ssd512.onnx"
    assert main(["export", "detector", "--checkpoint", str(best), "--out", str(exported)]) == 0
    assert Detector(exported).model.card.input_height == 512
    # One step from scratch teaches little; what it finds goes all the way.
    (frames,) = (folder / "Drone1/Morning/Extracted-Frames-1280x720").iterdir()
    given = ["--detector", str(exported), "--score-threshold", "0.3", "--frames", "1-2", "--keep-camera-motion"]
    track(frames, tmp_path / "tracks", "flow", *given)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["appearance_mars", "appearance_thesis"])
def test_the_thesis_s_networks_train_on_mars(name, acting_clips, tmp_path):
    rng = np.random.default_rng(0)
    for person in ("0001", "0002", "0003", "0000"):
        for camera in (1, 2):
            sprite = render_person_sprite(rng, 60)
            for frame in (1, 2):
                path = tmp_path / "mars" / person / f"{person}C{camera}T0001F{frame:03d}.jpg"
                path.parent.mkdir(parents=True, exist_ok=True)
                cv2.imwrite(str(path), cv2.resize(sprite[..., 2::-1], (32, 64)))
    words = ["--config", str(CONFIGS / f"{name}.yaml"), "--out", str(tmp_path / "out"), *TINY]
    words += ["--trainer.precision=32", "--model.height=64", "--model.width=32", "--data.batches=1"]
    words += [f"--data.{part}=[{tmp_path / 'mars'}]" for part in ("train", "val")]
    best = fit_appearance([*words, "--data.batch_size=4", "--data.views=2"])
    assert torch.load(best, weights_only=True)["global_step"] == 1
    exported = tmp_path / "wide.onnx"
    assert main(["export", "appearance", "--checkpoint", str(best), "--out", str(exported)]) == 0
    clip = acting_clips / "validation/validation-0"
    given = ["--detections", str(clip / "gt/gt.txt"), "--appearance", str(exported)]
    assert len(track(clip, tmp_path / "tracks", "flow", *given)) == 5


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:(?s).*deprecated in v4")
@pytest.mark.parametrize(("name", "streams"), [("action_drone", ["rgb_global"]), ("action_thesis", ["flow_local"])])
def test_action_networks_train_on_okutamas_layout(name, streams, acting_clips, tmp_path):
    words = ["--config", str(CONFIGS / f"{name}.yaml"), "--out", str(tmp_path / "out"), *TINY, "--data.cutting.step=5"]
    words += ["--trainer.precision=32", "--model.weights=null", "--model.fused=false"]
    words += [f"--model.streams=[{','.join(streams)}]"]
    words += [f"--data.train=[{acting_clips / 'okutama'}]", "--data.batch_size=2", "--data.batches=1"]
    words += [f"--data.val=[{acting_clips / 'train'}]", f"--data.cache={tmp_path / 'cache'}"]
    best = fit_action(words)
    assert torch.load(best, weights_only=True)["global_step"] == 1
    exported = tmp_path / "a.onnx"
    assert main(["export", "action", "--checkpoint", str(best), "--out", str(exported)]) == 0
    files = ",".join(str(tmp_path / f"a_{stream}.onnx") for stream in streams)
    clip = acting_clips / "validation/validation-0"
    given = ["--detections", str(clip / "gt/gt.txt"), "--actions", files, "--frames", "1-3", "--keep-camera-motion"]
    people = track(clip, tmp_path / "tracks", "flow-maf", *given)
    assert len(people) == 5
    assert np.isfinite([probability for one in people for row in one["multi"] for probability in row]).all()


def track(source, out, method, *options):
    """The people that `tsuiseki track drone` writes; tracks of a few detections count, too."""
    short = [
        "--drone.flow.costs.entry=0",
        "--drone.flow.costs.exit=0",
        "--drone.flow.min-time=0",
    ]
    assert main(["track", "drone", str(source), "--method", method, "--out", str(out), *options, *short]) == 0
    return json.loads((out / "tracks.json").read_text())["tracks"]


def test_a_detector_starts_from_what_fits_of_another(tmp_path):
    torch.manual_seed(0)
    anchors = [[(9.0, 22.0)], [(25.0, 64.0)], [(52.0, 132.0)]]
    more = [[(9.0, 22.0), (20.0, 20.0)], [(25.0, 64.0)], [(52.0, 132.0)]]
    first, second = (people_detector(build_trunk("mobilenet_v3_small", None), (64, 64), a, 16) for a in (anchors, more))
    path = tmp_path / "a.ckpt"
    torch.save({"state_dict": {f"network.{k}": v for k, v in first.state_dict().items()}}, path)
    missing = take_over(second, path)
    assert missing  # the finest heads have another shape
    own, other = second.state_dict(), first.state_dict()
    same = [k for k in own if own[k].shape == other[k].shape]
    assert set(missing) == own.keys() - set(same)
    assert all(torch.equal(own[k], other[k]) for k in same)
    with pytest.raises(RequestError, match="expected a checkpoint at"):
        take_over(second, tmp_path / "none.ckpt")


@pytest.mark.slow
def test_broken_labels_are_one_line_on_the_command_line(tmp_path, capsys):
    settings = DroneSceneSettings(width=160, height=90, frames=2, people=2, clutter=0, layout="okutama")
    folder = write_clip(tmp_path / "okutama", DroneClip(settings, 0))
    (labels,) = (folder / "Labels" / "SingleActionTrackingLabels" / "3840x2160").iterdir()
    text = labels.read_text()
    words = ["train", "detector", "--config", str(CONFIGS / "detector_okutama.yaml"), "--out", str(tmp_path / "out")]
    words += [*TINY, "--model.weights=null", "--trainer.precision=32"]
    words += ["--data.train", f"[{{folder: {folder}}}]", "--data.val", f"[{{folder: {folder}}}]"]
    for broken, complaint in (
        (text.replace('"Person"', "Person"), f"{labels.name}:1: expected names in double quotes"),
        (text.replace(' "Person"', ' "Person" "Flying"'), f"{labels.name}:1: unknown action 'Flying'"),
        (text + text.splitlines()[0].replace(" 0 0 0 0 ", " 700 0 0 0 ") + "\n", "labels reach frame 700"),
    ):
        labels.write_text(broken)
        assert main([*words, "--overwrite=true"]) == 2
        (line,) = [x for x in capsys.readouterr().err.splitlines() if x.startswith("tsuiseki:")]
        assert complaint in line


def test_an_input_size_comes_whole(tmp_path, capsys):
    words = ["export", "detector", "--out", str(tmp_path / "a.onnx"), "--checkpoint", "a.ckpt", "--height", "64"]
    assert main(words) == 2
    assert "expected --height and --width together" in capsys.readouterr().err
