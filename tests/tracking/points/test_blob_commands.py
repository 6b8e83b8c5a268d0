"""The commands about points and coloured objects, end to end and with wrong requests."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.points.settings import PointSettings
from tsuiseki.tracking.points.tracker import PointTracker
from tsuiseki.tracking.types import Detections


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blobs") / "clip"
    words = ["--frames", "20", "--width", "320", "--height", "240", "--objects", "2", "--clutter", "2", "--seed", "3"]
    assert main(["simulate", "blobs", "--out", str(folder), *words]) == 0
    return folder


@pytest.mark.slow
def test_a_clip_is_tracked_and_scored(clip, tmp_path, capsys):
    out, scores = tmp_path / "out", tmp_path / "scores.json"
    assert main(["track", "blobs", str(clip), "--out", str(out), "--colour", "red", "--overlay"]) == 0
    assert {p.name for p in out.iterdir()} >= {"tracks.txt", "points.csv", "run.json", "overlay.webm"}
    assert len(json.loads((out / "run.json").read_text())["frames"]["expected_count"]) == 20
    found = [str(out / "tracks.txt"), str(out / "points.csv")]
    truth = str(clip / "gt" / "gt.txt")
    assert main(["evaluate", "points", truth, *found, "--cutoff", "50", "--json", str(scores)]) == 0
    assert "OSPA" in capsys.readouterr().out
    first, second = json.loads(scores.read_text()).values()
    assert first["ospa1"] == pytest.approx(second["ospa1"], abs=0.01)
    assert first["ospa1"] < 25.0


@pytest.mark.parametrize(("preset", "said"), [("calibrated", "expected number of objects"), ("paper", "no count")])
def test_the_command_says_what_the_weights_sum_to(clip, tmp_path, capsys, preset, said):
    words = ["--colour", "red", "--preset", preset, "--particles", "100", "--frames", "1-5"]
    assert main(["track", "blobs", str(clip), "--out", str(tmp_path / "out"), *words]) == 0
    assert said in capsys.readouterr().out


@pytest.mark.slow
def test_points_and_boxes_are_tracked_alike(clip, tmp_path):
    rng = np.random.default_rng(0)
    way = np.array([[50 + 4 * k, 60 + 2 * k] for k in range(20)]) + rng.standard_normal((20, 2))
    (tmp_path / "points.csv").write_text("frame,x,y\n" + "".join(f"{k + 1},{x},{y}\n" for k, (x, y) in enumerate(way)))
    (tmp_path / "det.txt").write_text(
        "".join(f"{k + 1},-1,{x - 9},{y - 9},20,20,0.9,-1,-1,-1\n" for k, (x, y) in enumerate(way))
    )
    for name in ("points.csv", "det.txt"):
        out = tmp_path / f"out-{name}"
        words = ["--detections", str(tmp_path / name), "--size", "20,20", "--particles", "200"]
        assert main(["track", "blobs", str(clip), "--out", str(out), *words]) == 0
        (track,) = read_tracks(out / "tracks.txt")
        middle = (track.boxes[:, :2] + track.boxes[:, 2:]) / 2
        assert len(track) >= 15
        assert np.abs(middle - way[track.frames]).max() < 8.0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "expected one of --colour"),
        (["--colour", "red", "--detections", "x"], "expected one of --colour"),
        (["--colour", "reddish"], "expected a colour"),
        (["--colour-box", "0,0,0,5"], "width and height above 0"),
        (["--colour-box", "9000,9000,5,5"], "expected a box inside the image"),
        (["--detections", "missing.csv"], "found no such file"),
        (["--colour", "red", "--particles", "0"], "--particles: expected a number greater than 0"),
    ],
)
def test_wrong_requests_get_one_line(clip, tmp_path, capsys, words, expected):
    assert main(["track", "blobs", str(clip), "--out", str(tmp_path / "out"), *words]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert expected in lines[-1]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("frame,x,y\n1,nan,3\n", "finite number in column x"),
        ("frame,x,y\n0,1,3\n", "whole number from 1"),
        ("frame,x\n1,3\n", "found no y"),
        ("frame,x,y\n99,1,3\n", "another video"),
    ],
)
def test_broken_points_get_one_line(clip, tmp_path, capsys, text, expected):
    path = tmp_path / "points.csv"
    path.write_text(text)
    assert main(["track", "blobs", str(clip), "--out", str(tmp_path / "out"), "--detections", str(path)]) == 2
    assert expected in capsys.readouterr().err


def test_points_need_truth_and_single_ids(tmp_path, capsys):
    truth, twice = tmp_path / "truth.csv", tmp_path / "twice.csv"
    truth.write_text("frame,id,x,y\n")
    twice.write_text("frame,id,x,y\n1,1,0,0\n1,1,5,5\n")
    assert main(["evaluate", "points", str(truth), str(twice)]) == 2
    assert "at least one labelled point" in capsys.readouterr().err
    assert main(["evaluate", "points", str(twice), str(twice)]) == 2
    assert "twice in frame 1" in capsys.readouterr().err


@pytest.mark.parametrize("bad", [{"method": "jpda"}, {"detection": 2.0}, {"particles": 0}, {"clutter": -1.0}])
def test_point_settings_out_of_range_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        PointSettings(**bad)


@pytest.mark.parametrize("method", ["labelled", "phd"])
def test_trackers_wait_for_the_first_measurement_and_outlast_silence(method):
    tracker = PointTracker(PointSettings(method=method, particles=100), (320.0, 240.0))
    for _ in range(3):
        tracker.update(Detections.empty())
    for step in range(8):
        boxes = np.array([[250.0, 50, 270, 90], [50.0 + 3 * step, 50, 70 + 3 * step, 90]])[1 - step % 2 :]
        given = Detections(boxes, np.full(len(boxes), 0.9), classes=np.full(len(boxes), 3), names={3: "ship"})
        tracker.update(given)
    for _ in range(30):
        tracker.update(Detections.empty())
    track = tracker.tracks()[0]
    assert track.frames[0] <= 6
    assert track.frames[-1] < 30
    seen = track.frames < 11
    np.testing.assert_array_equal(track.detection[seen], (track.frames[seen] - 3) % 2)
    assert (track.detection[~seen] == -1).all()
    assert track.class_name == "ship"


def test_a_stretch_is_scored_by_itself(tmp_path, capsys):
    truth, found, scores = tmp_path / "gt.csv", tmp_path / "found.csv", tmp_path / "s.json"
    truth.write_text("frame,id,x,y\n" + "".join(f"{t},1,5,5\n" for t in range(91, 101)))
    found.write_text("frame,id,x,y\n" + "".join(f"{t},1,5,{9 if t > 95 else 7}\n" for t in range(91, 101)))
    expected = {None: 10 * 3 / 100, "91-100": 3.0, "96-": 4.0, "96-99": 4.0}
    for frames, error in expected.items():
        words = ["evaluate", "points", str(truth), str(found), "--json", str(scores), "--overwrite"]
        assert main([*words, "--frames", frames] if frames else words) == 0
        (values,) = json.loads(scores.read_text()).values()
        assert values["ospa1"] == pytest.approx(error)
    assert main(["evaluate", "points", str(truth), str(found), "--frames", "1-90"]) == 2
    assert "at least one labelled point in the frames to score" in capsys.readouterr().err


def test_a_gap_of_ten_million_frames_takes_no_time(tmp_path):
    (tmp_path / "gt.csv").write_text("frame,id,x,y\n1,1,5,5\n10000000,1,9,9\n")
    (tmp_path / "found.csv").write_text("frame,id,x,y\n1,1,5,5\n10000000,1,9,12\n")
    scores = tmp_path / "s.json"
    words = ["evaluate", "points", str(tmp_path / "gt.csv"), str(tmp_path / "found.csv"), "--json", str(scores)]
    assert main(words) == 0
    (values,) = json.loads(scores.read_text()).values()
    assert values["frames"] == 10_000_000
    assert values["ospa1"] == pytest.approx(3e-7)
