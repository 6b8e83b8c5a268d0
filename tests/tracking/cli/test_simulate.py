"""`tsuiseki simulate`: what cannot be drawn is refused in a line, before anything is drawn."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tsuiseki.tracking.cli import main

SCENES = ("street", "blobs", "drone", "goldfish", "sphere")


@pytest.mark.parametrize("scene", SCENES)
def test_a_seed_below_nought_is_refused(scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", scene, "--out", str(tmp_path / "clip"), "--seed", "-1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "tsuiseki: --seed: expected a number greater than or equal to 0, got '-1'"
    assert not (tmp_path / "clip").exists()


@pytest.mark.parametrize("scene", SCENES[:-1])
@pytest.mark.parametrize(("option", "value"), [("width", "100000"), ("height", "0"), ("frames", "1000000000")])
def test_sizes_that_no_machine_draws_are_refused(
    scene: str, option: str, value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", scene, "--out", str(tmp_path / "clip"), f"--{option}", value]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"tsuiseki: --{option}: expected ")
    assert line.endswith(f"got '{value}'")


def test_a_clip_is_the_same_for_the_same_seed(tmp_path: Path) -> None:
    words = ["simulate", "goldfish", "--frames", "2", "--count", "1", "--seed", "3"]
    first, second = tmp_path / "first" / "clip", tmp_path / "second" / "clip"
    for folder in (first, second):
        assert main([*words, "--out", str(folder)]) == 0
    files = sorted(path.relative_to(first) for path in first.rglob("*") if path.is_file() and path.name != "run.json")
    assert len(files) == 6  # two images, two silhouettes, states.csv and seqinfo.ini
    for path in files:
        assert (first / path).read_bytes() == (second / path).read_bytes(), path


def test_the_record_of_a_clip_makes_it_again(tmp_path: Path) -> None:
    words = ["simulate", "goldfish", "--frames", "2", "--count", "1", "--seed", "3", "--out", str(tmp_path / "a")]
    assert main(words) == 0
    again = ["simulate", "goldfish", "--config", str(tmp_path / "a" / "run.json"), "--out", str(tmp_path / "b")]
    assert main(again) == 0
    assert (tmp_path / "a" / "states.csv").read_bytes() == (tmp_path / "b" / "states.csv").read_bytes()
    record = json.loads((tmp_path / "b" / "run.json").read_text())
    assert (record["seed"], record["partial"]) == (3, False)
