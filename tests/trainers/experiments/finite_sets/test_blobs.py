"""`tsuiseki reproduce blobs` on short clips."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.trainers.experiments.finite_sets import blobs


def test_both_methods_are_scored_on_every_kind_of_clutter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short = {name: replace(scene, frames=12, width=240, height=180, objects=2, clutter=4) for name, scene in
             blobs.SCENES.items()}  # fmt: skip
    monkeypatch.setattr(blobs, "SCENES", short)
    words = ["--seeds", "1", "--particles", "100", "--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out")]
    assert main(["reproduce", "blobs", *words]) == 0
    values = json.loads((tmp_path / "out/results.json").read_text())
    assert {(row["scene"], row["method"]) for row in values} == {(s, m) for s in short for m in blobs.METHODS}
    # A tracker that shows nothing has the cut-off, 50, wherever something is.
    assert all(row["runs"][0]["ospa1"] < 40 for row in values if row["method"] == "track blobs")
