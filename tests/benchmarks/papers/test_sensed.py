"""`python -m benchmarks.papers phd-unseen` on short scenarios; what a scenario is made of, and the peers' program."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.papers import finite_sets
from benchmarks.papers.__main__ import main
from benchmarks.papers.finite_sets import STANDARD_PLACES, Scenarios, drawn_scenario, peer_rows, run_sensed
from benchmarks.papers.peers import Peer


@pytest.mark.slow
def test_the_experiment_prints_every_kind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    short = {kind: replace(settings, steps=12) for kind, settings in finite_sets.KINDS.items()}
    monkeypatch.setattr(finite_sets, "KINDS", short)
    words = ["--seeds", "1", "--seed", "7", "--particles", "100", "--cache", str(tmp_path / "cache")]
    assert main(["phd-unseen", *words, "--out", str(tmp_path / "out")]) == 0
    assert "known places" in capsys.readouterr().out
    values = json.loads((tmp_path / "out/results.json").read_text())
    found = {(row["births"], row["filter"]): row["runs"][0]["ospa1"] for row in values}
    assert {kind for kind, _ in found} == set(short)
    # A filter that shows nothing has 100.
    assert found["anywhere", "labelled"] < 80


def test_an_environment_without_the_peers_gets_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["phd-unseen", "--peer", sys.executable, "--out", str(tmp_path / "out")]) == 2
    assert "environment with the packages stonesoup and multisensor-lmb-filters-rs" in capsys.readouterr().err


def test_a_scenario_has_the_births_clutter_and_misses_of_its_settings() -> None:
    settings = Scenarios(steps=400, first=0, births=0.2, places=STANDARD_PLACES, clutter=5.0, detection=0.9)
    truth, scans = drawn_scenario(settings, seed=3)
    _, first = np.unique(truth.ids, return_index=True)
    # 0.2 a scan over 400 scans: 80, four standard deviations.
    assert abs(len(first) - 80) < 4 * np.sqrt(80)
    born = np.linalg.norm(truth.positions[first][:, None] - np.array(STANDARD_PLACES), axis=2).min(axis=1)
    assert born.max() < 6 * settings.place_spread
    measured = sum(len(scan.measurements) for scan in scans)
    expected = 0.9 * len(truth.ids) + 5.0 * 400
    assert abs(measured - expected) < 4 * np.sqrt(expected)
    assert np.abs(truth.positions).max() <= 1000


def test_what_a_peer_reports_outside_the_region_or_twice_is_dropped(tmp_path: Path) -> None:
    stand_in, python = tmp_path / "stand_in.py", tmp_path / "python"
    stand_in.write_text(
        "import json, sys\n"
        "scans = json.load(sys.stdin)['scans']\n"
        "rows = [[k, n, *z] for k, scan in enumerate(scans) for n, z in enumerate(scan, 1)]\n"
        "rows += [[0, 1, 0.0, 0.0], [0, 99, 5000.0, 0.0]]\n"
        "print(json.dumps({'rows': rows, 'milliseconds': [2.0] * len(scans)}))\n"
    )
    python.write_text(f"#!/bin/sh\nexec {sys.executable} {stand_in}\n")
    python.chmod(0o755)
    settings = Scenarios(steps=10, clutter=0.0, births=0.0, survival=1.0, detection=1.0, deviation=0.0, speed=0.0)
    found = run_sensed(settings, partial(peer_rows, Peer("points", str(python), "1"), "all measurements"), 1)
    # Exact measurements of every target: nothing is wrong but the identities.
    assert found["ospa1"] == pytest.approx(0.0, abs=1e-9)
    assert (found["false"], found["milliseconds"]) == (0.0, 2.0)
