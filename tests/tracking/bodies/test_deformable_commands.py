"""`tsuiseki track deformable` and `tsuiseki train motion`, from the generated clip to the files, and wrong requests."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.body_states import read_states, write_states
from tsuiseki.tracking.types.tracks import exact_track

FIELDS = ("a", "b", "theta", "phi")
COLOUR = ["--colour", "10-42,0.42-1,0.6-1"]


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips") / "fish"
    assert main(["simulate", "goldfish", "--out", str(folder), "--frames", "30", "--count", "1", "--seed", "4"]) == 0
    return folder


@pytest.fixture(scope="module")
def motion(clip, tmp_path_factory):
    path = tmp_path_factory.mktemp("motions") / "motion.json"
    assert main(["train", "motion", str(clip), "--out", str(path)]) == 0
    return path


def start(clip):
    state = read_states(clip / "states.csv", FIELDS)[0].states[0]
    return ",".join(f"{value:.4f}" for value in state)


@pytest.mark.slow
def test_a_clip_is_tracked_by_what_was_learnt(clip, motion, tmp_path):
    out = tmp_path / "out"
    words = ["track", "deformable", str(clip), "--out", str(out), "--motion", str(motion), *COLOUR, "--overlay"]
    assert main([*words, "--init", start(clip), "--deformable.particles", "600"]) == 0
    assert {p.name for p in out.iterdir()} == {"states.csv", "states.png", "overlay.webm", "run.json"}
    (track,) = read_states(out / "states.csv", FIELDS)
    (truth,) = read_states(clip / "states.csv", FIELDS)
    assert np.linalg.norm(track.states[:, :2] - truth.states[:, :2], axis=1).max() < 10.0
    run = json.loads((out / "run.json").read_text())
    assert run["facts"]["frame_rate"] == 15.0
    assert run["frames"]["frame"] == list(range(1, 31))
    assert len(run["frames"]["score_1"]) == 30
    assert set(run["seconds"]) == {"draw", "edges", "particles"}


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["paper", "conditional", "independent", "velocity", "walk"])
def test_every_preset_tracks(clip, motion, tmp_path, preset):
    words = ["track", "deformable", str(clip), "--out", str(tmp_path / "out"), "--motion", str(motion), *COLOUR]
    assert main([*words, "--preset", preset, "--widen", "1.3", "--frames", "1-8", "--init", start(clip)]) == 0
    assert len(read_states(tmp_path / "out" / "states.csv", FIELDS)[0]) == 8


def test_without_motion_the_wide_run_finds_the_fish_and_teaches(clip, tmp_path):
    out = tmp_path / "wide"
    words = ["track", "deformable", str(clip), "--out", str(out), *COLOUR, "--deformable.particles", "3000"]
    assert main([*words, "--frames", "1-20"]) == 0
    (track,) = read_states(out / "states.csv", FIELDS)
    truth = read_states(clip / "states.csv", FIELDS)[0]
    assert np.linalg.norm(track.states[:20, :2] - truth.states[:20, :2], axis=1).max() < 15.0
    assert main(["train", "motion", str(out), "--out", str(tmp_path / "motion.json")]) == 0
    learnt = json.loads((tmp_path / "motion.json").read_text())
    assert (learnt["body"], learnt["frame_rate"], learnt["columns"]) == ("goldfish", 15.0, list(FIELDS))


@pytest.mark.slow
def test_an_empty_picture_is_lost_and_goes_on(motion, tmp_path):
    folder = tmp_path / "grey"
    folder.mkdir()
    for number in range(6):
        cv2.imwrite(str(folder / f"{number:03d}.png"), np.full((240, 320, 3), 90, np.uint8))
    words = ["track", "deformable", str(folder), "--out", str(tmp_path / "out"), "--motion", str(motion)]
    assert main([*words, "--init", "160,120,0,0"]) == 0
    (track,) = read_states(tmp_path / "out" / "states.csv", FIELDS)
    assert set(track.statuses) == {"lost"}
    assert np.isfinite(track.states).all()
    assert not np.allclose(track.states[0], track.states[-1])
    # Nothing to find is no error either.
    assert main([*words[:3], "--out", str(tmp_path / "none")]) == 0
    assert (tmp_path / "none" / "states.csv").read_text().splitlines() == ["frame,id,a,b,theta,phi,score,status"]


def test_init_is_given_once_for_each_body(clip, motion, tmp_path):
    words = ["track", "deformable", str(clip), "--out", str(tmp_path / "out"), "--motion", str(motion), *COLOUR]
    assert main([*words, "--frames", "1-3", "--init", start(clip), "--init=-0,9.5,-3.1,0.2"]) == 0
    one, two = read_states(tmp_path / "out" / "states.csv", FIELDS)
    assert (one.id, two.id) == (1, 2)
    np.testing.assert_allclose(two.states[0], [0.0, 9.5, -3.1, 0.2], atol=1e-3)


def refused(words, capsys, expected):
    assert main(words) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert expected in lines[-1]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--init", "700,100,0,0"], "--init: expected a place in the image of 640x480, got 700,100"),
        (["--init", "-1,100,0,0"], "expected a place in the image"),
        (["--init", "100,100,0"], "--init: expected a,b,theta,phi as 4 finite numbers"),
        (["--init", "100,100,0,nan"], "--init: expected a finite number, got 'nan'"),
        (["--init", "100,100,0,3"], "--init: expected phi from -1.57 to 1.57, got 3"),
        (["--init", "here"], "--init: expected a valid number"),
        (["--preset", "learnt"], "--preset learnt needs --motion"),
        (["--motion", "none.json"], "found no none.json"),
        (["--body", "shark"], "expected a body of goldfish"),
        (["--colour", "fishy"], "expected a colour"),
        (["--deformable.particles", "0"], "--deformable.particles: expected a number greater than or equal to 1"),
        (["--deformable.smooth", "2"], "odd number of pixels"),
        (["--widen", "0"], "--widen: expected a number greater than 0"),
        (["--deformable.spread", "0"], "--deformable.spread: expected a number greater than 0"),
    ],
)
def test_wrong_requests_get_one_line(clip, tmp_path, capsys, words, expected):
    refused(["track", "deformable", str(clip), "--out", str(tmp_path / "out"), *words], capsys, expected)
    assert not (tmp_path / "out").exists()


def test_motion_of_another_body_or_dimension_is_refused(clip, motion, tmp_path, capsys):
    words = ["track", "deformable", str(clip), "--out", str(tmp_path / "out"), "--motion"]
    refused([*words, str(motion), "--body", "ball"], capsys, "expected motion of the body ball, got that of goldfish")
    values = json.loads(motion.read_text()) | {"columns": ["a", "b", "theta"]}
    (tmp_path / "three.json").write_text(json.dumps(values))
    refused([*words, str(tmp_path / "three.json")], capsys, "expected motion of 4 columns, as goldfish has, got 3")
    refused([*words, str(motion), "--preset", "wide"], capsys, "--preset wide uses no --motion")


def test_what_cannot_be_learnt_from_gets_one_line(tmp_path, capsys):
    rng = np.random.default_rng(0)
    states = np.cumsum(rng.normal(size=(40, 4)), axis=0) * [3, 3, 0.1, 0.1]
    path, out = tmp_path / "states.csv", ["--out", str(tmp_path / "motion.json")]
    rate = ["--frame-rate", "25"]
    write_states(path, [exact_track(1, np.arange(11), states[:11])], FIELDS)
    refused(["train", "motion", str(path), *out, *rate], capsys, "at least 10 steps to learn from, got 9")
    refused(["train", "motion", str(path), *out], capsys, "give --frame-rate")
    refused(
        ["train", "motion", str(path), *out, "--frame-rate", "0"],
        capsys,
        "--frame-rate: expected a number greater than 0",
    )
    refused(["train", "motion", str(path), *out, *rate, "--body", "ball"], capsys, "expected the columns")
    states[:, 3] = 0.5 * states[:, 2]
    write_states(path, [exact_track(1, np.arange(40), states)], FIELDS)
    refused(["train", "motion", str(path), *out, *rate], capsys, "singular covariance")
    refused(["train", "motion", str(tmp_path / "no"), *out, *rate], capsys, "found no such file")
    assert not (tmp_path / "motion.json").exists()
