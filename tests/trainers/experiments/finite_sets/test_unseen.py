"""`tsuiseki reproduce phd-unseen` on short scenarios; what a scenario is made of."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.trainers.experiments.finite_sets import unseen
from tsuiseki.trainers.experiments.finite_sets.unseen_scenarios import (
    STANDARD_PLACES,
    UnseenSettings,
    unseen_scenario,
)


def test_the_experiment_prints_both_kinds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    short = {kind: replace(settings, steps=12) for kind, settings in unseen.KINDS.items()}
    monkeypatch.setattr(unseen, "KINDS", short)
    words = ["--seeds", "1", "--seed", "7", "--particles", "100", "--cache", str(tmp_path / "cache")]
    assert main(["reproduce", "phd-unseen", *words, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "births anywhere" in printed
    assert "births known places" in printed
    values = json.loads((tmp_path / "out/results.json").read_text())
    found = {(row["births"], row["filter"]): row["runs"][0]["scores"]["ospa1"] for row in values}
    assert {kind for kind, _ in found} == set(short)
    # A filter that shows nothing has 100.
    assert found["anywhere", "labelled"] < 80


def test_an_environment_without_the_peers_gets_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "phd-unseen", "--peer", sys.executable, "--out", str(tmp_path / "out")]) == 2
    assert "environment with stonesoup and multisensor-lmb-filters-rs" in capsys.readouterr().err


def test_a_scenario_has_the_births_clutter_and_misses_that_it_is_told() -> None:
    settings = UnseenSettings(steps=400, first=0, births=0.2, places=STANDARD_PLACES, clutter=5.0, detection=0.9)
    scenario = unseen_scenario(settings, seed=3)
    truth, scans = scenario.truth, scenario.scans
    _, first = np.unique(truth.ids, return_index=True)
    # 0.2 a scan over 400 scans: 80, four standard deviations.
    assert abs(len(first) - 80) < 4 * np.sqrt(80)
    born = np.linalg.norm(truth.positions[first][:, None] - np.array(STANDARD_PLACES), axis=2).min(axis=1)
    assert born.max() < 6 * settings.place_spread
    measured = sum(len(scan.measurements) for scan in scans)
    expected = 0.9 * len(truth.ids) + 5.0 * 400
    assert abs(measured - expected) < 4 * np.sqrt(expected)
    assert np.abs(truth.positions).max() <= 1000


def test_sources_name_the_target_that_was_measured() -> None:
    settings = UnseenSettings(steps=50, first=4)
    scenario = unseen_scenario(settings, seed=5)
    for number, (scan, source) in enumerate(zip(scenario.scans, scenario.sources, strict=True)):
        there = scenario.truth.frames == number
        places = dict(zip(scenario.truth.ids[there].tolist(), scenario.truth.positions[there], strict=True))
        for place, name in zip(scan.measurements, source.tolist(), strict=True):
            assert name == 0 or np.linalg.norm(place - places[name]) < 6 * settings.deviation


@pytest.mark.parametrize("kind", unseen.KINDS)
def test_a_filter_that_is_told_the_associations_is_better(kind: str) -> None:
    settings = replace(unseen.KINDS[kind], steps=40)
    told = [unseen.run_told(settings, seed).scores.ospa1 for seed in (11, 12)]
    ours = [unseen.run_ours(settings, seed, "labelled", 200).scores.ospa1 for seed in (11, 12)]
    assert np.mean(told) < np.mean(ours)
