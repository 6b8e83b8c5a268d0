"""`tsuiseki reproduce phd-motions` on a short scenario; targets that are calm and agile by turns."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.trainers.experiments.finite_sets import motions
from tsuiseki.trainers.experiments.finite_sets.unseen_scenarios import UnseenSettings, unseen_scenario


def test_the_experiment_prints_every_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motions, "SCENARIO", replace(motions.SCENARIO, steps=20, first=2))
    words = ["reproduce", "phd-motions", "--seeds", "2", "--particles", "200", "--cache", str(tmp_path / "cache")]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in motions.MOTIONS)
    values = json.loads((tmp_path / "out/results.json").read_text())
    assert {name: len(runs) for name, runs in values.items()} == dict.fromkeys(motions.MOTIONS, 2)


def test_targets_are_calm_and_agile_half_of_the_time_each_and_change_as_often_as_told() -> None:
    settings = UnseenSettings(steps=3000, side=1e9, first=4, births=0.0, survival=1.0, bends=0.0, agile=1.0, speed=0.0)
    truth = unseen_scenario(replace(settings, clutter=0.0), seed=1).truth
    moves = []
    for target in range(1, 5):
        path = truth.positions[truth.ids == target]
        # Without a change of speed the second difference is 0, half of that of two steps otherwise.
        moves.append(np.abs(np.diff(path, 2, axis=0)).max(axis=1) > 1e-6)
    # A calm scan before or after an agile one shows in the second difference, too: three of four are moved.
    share = np.mean(moves)
    rate = 0.5 * (1 - np.exp(-2 * settings.switching))
    assert share == pytest.approx(0.5 + 0.5 * rate, abs=0.05)
