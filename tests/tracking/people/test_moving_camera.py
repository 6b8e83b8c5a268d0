"""`tsuiseki track people --moving-camera`, on a generated flight."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks, write_detections
from tsuiseki.tracking.types import Detections


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Twenty frames with the labelled boxes as detections."""
    settings = DroneSceneSettings(width=320, height=180, frames=20, people=4, clutter=0, camera="violent")
    folder = write_clip(tmp_path_factory.mktemp("moving") / "clip", DroneClip(settings, 3))
    truth = read_ground_truth(folder / "gt" / "gt.txt")
    frames = [truth.between(k, k).boxes for k in range(20)]
    write_detections(folder / "det" / "det.txt", [Detections(b, np.full(len(b), 0.99)) for b in frames])
    return folder


def track(clip, out, *more):
    words = ["track", "people", str(clip), "--detections", str(clip / "det" / "det.txt"), "--out", str(out)]
    return main([*words, "--appearance", "none", "--flow.smoothing=false", *more])


@pytest.mark.slow
def test_tracks_come_back_in_pixels_of_their_own_frames(clip, tmp_path):
    assert track(clip, tmp_path / "a", "--moving-camera", "--flow.fill", "0") == 0
    truth = read_ground_truth(clip / "gt" / "gt.txt")
    tracks = read_tracks(tmp_path / "a" / "tracks.txt")
    assert sum(map(len, tracks)) > 0.5 * len(truth)
    for one in tracks:
        for frame, box in zip(one.frames.tolist(), one.boxes, strict=True):
            # The text file rounds to thousandths.
            assert np.abs(truth.between(frame, frame).boxes - box).max(axis=1).min() < 2e-3


def test_text_alone_does_not_tell_how_the_camera_moves(clip, tmp_path, capsys):
    bare = tmp_path / "bare"
    (bare / "gt").mkdir(parents=True)
    (bare / "gt" / "gt.txt").write_text((clip / "gt" / "gt.txt").read_text())
    (bare / "det").mkdir()
    (bare / "det" / "det.txt").write_text((clip / "det" / "det.txt").read_text())
    assert track(bare, tmp_path / "b", "--moving-camera") == 2
    assert "has no images to tell how the camera moves; leave --moving-camera out" in capsys.readouterr().err


@pytest.mark.slow
def test_the_flow_sees_that_a_camera_stands_still_and_other_methods_do_not_look(tmp_path):
    street = write_clip(tmp_path / "street", StreetClip(StreetSettings(frames=14), 100))
    told = {}
    for method, more in (("flow", ["--appearance", "none"]), ("sort", [])):
        out = tmp_path / method
        words = ["track", "people", str(street), "--frames", "3-14", "--method", method, "--out", str(out)]
        assert main([*words, "--view", "1", "--threads", "1", *more]) == 0
        told[method] = json.loads((out / "run.json").read_text())
    assert told["flow"]["facts"]["flow"]["camera_stood_still"] == 11
    assert "camera" in told["flow"]["seconds"]
    assert "camera" not in told["sort"]["seconds"]
