"""`tsuiseki simulate goldfish` through the real command line."""

from __future__ import annotations

import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.body_states import read_silhouettes, read_states


@pytest.mark.parametrize(
    ("body", "count", "fields", "rate"),
    [("goldfish", 2, ("a", "b", "theta", "phi"), "15"), ("ball", 1, ("a", "b", "theta", "squash"), "30")],
)
def test_a_clip_comes_with_states_and_silhouettes(tmp_path, capsys, body, count, fields, rate):
    out = tmp_path / "clip"
    words = ["simulate", "goldfish", "--body", body, "--frames", "3", "--out", str(out)]
    assert main([*words, "--count", str(count)]) == 0
    assert "3 frames of 640x480" in capsys.readouterr().out
    tracks = read_states(out / "states.csv", fields)
    assert [len(track) for track in tracks] == [3] * count
    assert read_silhouettes(out).shape == (3, 480, 640)
    assert sorted(path.name for path in (out / "img1").iterdir()) == [f"00000{n}.jpg" for n in (1, 2, 3)]
    assert f"frameRate={rate}" in (out / "seqinfo.ini").read_text()


@pytest.mark.slow
def test_the_seed_decides(tmp_path):
    for name, seed in (("one", "4"), ("same", "4"), ("other", "5")):
        words = ["simulate", "goldfish", "--frames", "1", "--seed", seed, "--out", str(tmp_path / name)]
        assert main(words) == 0
    one, same, other = ((tmp_path / name / "states.csv").read_text() for name in ("one", "same", "other"))
    assert one == same != other


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--count", "0"], "--count: expected a number greater than or equal to 1, got 0"),
        (["--count", "6", "--body", "ball"], "--count: expected a number less than or equal to 5, got 6"),
        (["--body", "whale"], "whale"),
        (["--frames", "0"], "--frames: expected a number greater than or equal to 1, got '0'"),
        (["--frame-rate", "0"], "--frame-rate: expected a number greater than 0"),
        (["--width", "100"], "--width: expected a number greater than or equal to 224, got 100"),
    ],
)
def test_wrong_requests_are_refused_in_one_line(tmp_path, capsys, words, message):
    assert main(["simulate", "goldfish", "--out", str(tmp_path / "clip"), *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.strip().count("\n") == 0
    assert not (tmp_path / "clip").exists()


def test_an_earlier_clip_is_kept(tmp_path, capsys):
    words = ["simulate", "goldfish", "--frames", "1", "--out", str(tmp_path / "clip")]
    assert main(words) == 0
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err
