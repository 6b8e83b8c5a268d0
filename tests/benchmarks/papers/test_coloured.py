"""`python -m benchmarks.papers blobs` and `phd-equalisation` on short clips."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.papers import finite_sets
from benchmarks.papers.__main__ import main


def test_both_methods_are_scored_on_every_kind_of_clutter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short = {name: replace(scene, frames=12, width=240, height=180, objects=2, clutter=4) for name, scene in
             finite_sets.SCENES.items()}  # fmt: skip
    monkeypatch.setattr(finite_sets, "SCENES", short)
    words = ["--seeds", "1", "--particles", "100", "--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out")]
    assert main(["blobs", *words]) == 0
    values = json.loads((tmp_path / "out/results.json").read_text())
    assert {(row["scene"], row["method"]) for row in values} == {(s, m) for s in short for m in finite_sets.WAYS}
    # A tracker that shows nothing has the cut-off, 50, wherever something is.
    assert all(row["runs"][0]["ospa1"] < 40 for row in values if row["method"] == "track blobs")


@pytest.mark.slow
def test_equalisation_reports_all_updates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--seeds", "1", "--frames", "15", "--particles", "80", "--cache", str(tmp_path / "cache")]
    assert main(["phd-equalisation", *words, "--out", str(tmp_path / "out")]) == 0
    assert "kept of 3" in capsys.readouterr().out
    values = json.loads((tmp_path / "out/results.json").read_text())
    ends = {row["update"]: row["runs"][0]["expected_count_at_end"] for row in values}
    assert list(ends) == ["as printed", "equalised", "calibrated"]
    assert ends["as printed"] < 0.1
    assert ends["calibrated"] == pytest.approx(3.0, abs=0.5)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "results.json",
        "tables.md",
        "particles.png",
        "tables.json",
    }
