"""`tsuiseki reproduce stereo-sphere` on a film of three moments."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.trainers.experiments.sphere import stereo_sphere
from tsuiseki.trainers.experiments.sphere.films import configurations


@pytest.fixture
def fewer_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    """One configuration of every group but section 3, and fifty particles."""
    every = configurations()
    rows = [row for row in every if row.group == "section 3"]
    rows += [next(row for row in every if row.group == group) for group in ("particles", "cameras", "covered")]
    small = [replace(row, particles=50, cameras=min(row.cameras, 2)) for row in rows]
    monkeypatch.setattr(stereo_sphere, "configurations", lambda: small)


@pytest.mark.usefixtures("fewer_particles")
def test_the_experiment_prints_writes_and_keeps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["reproduce", "stereo-sphere", "--seeds", "1", "--frames", "3", "--cache", str(tmp_path / "cache")]
    assert main([*words, "--out", str(tmp_path / "first")]) == 0
    printed = capsys.readouterr().out
    # The paper's row stands below ours.
    assert printed.index("contour, random walk, weighed at once") < printed.index("contour, the paper")
    assert "3.20" in printed
    rows = json.loads((tmp_path / "first/results.json").read_text())
    assert [row["group"] for row in rows] == ["section 3"] * 4 + ["particles", "cameras", "covered"]
    by_name = {row["name"]: row["films"]["0"]["to_position"] for row in rows[:4]}
    assert all(scores["count"] == 3 for scores in by_name.values())
    # It starts where the ball is and moves by hand: a ball's width away would be 0.2 m.
    assert by_name["contour, random walk"]["mean"] < 0.1
    assert {p.name for p in (tmp_path / "first").iterdir()} == {"results.json", "tables.md", "errors.png", "run.json"}
    (kept,) = (tmp_path / "cache").rglob("*.json")
    written = kept.stat().st_mtime_ns
    assert main([*words, "--out", str(tmp_path / "second")]) == 0
    assert kept.stat().st_mtime_ns == written
    assert json.loads((tmp_path / "second/results.json").read_text()) == rows


@pytest.mark.parametrize("words", [["--frames", "1"], ["--seeds", "0"], ["--seed", "-1"]])
def test_wrong_requests_get_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    assert main(["reproduce", "stereo-sphere", "--out", str(tmp_path / "out"), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "expected at least" in line
