"""Whether the correlation helps, in small: tiny clips, and densities with a closed form."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.trainers.bodies.motion import Steps
from tsuiseki.trainers.experiments.goldfish import fair_arms, fair_test
from tsuiseki.trainers.experiments.goldfish.step_density import density


def steps(increments, conditions):
    return Steps(*([increments] * 3), increments, *([increments] * 2), conditions)


def test_a_correlation_is_worth_its_mutual_information():
    rng = np.random.default_rng(0)
    factor = np.linalg.cholesky(np.array([[1.0, 0.8], [0.8, 1.0]]))
    pairs = rng.standard_normal((40_000, 2)) @ factor.T
    rows = np.concatenate([pairs, rng.standard_normal((40_000, 2))], axis=1)
    lag = np.concatenate([rng.standard_normal((40_000, 4)), rows[:, 2:]], axis=1)
    both = steps(rows, lag)
    gain = density(both, both, correlated=True, lag=False) - density(both, both, correlated=False, lag=False)
    # -log(1 - 0.8^2) / 2 of two correlated normals; 40,000 draws.
    assert gain == pytest.approx(-0.5 * np.log(1 - 0.64), abs=0.02)
    # What the frame before tells wholly leaves next to nothing of two columns.
    assert density(both, both, correlated=True, lag=True) > density(both, both, correlated=True, lag=False) + 2


def test_the_experiment_in_small(tmp_path, monkeypatch):
    for name in ("LEARNING", "DEVELOPMENT"):
        monkeypatch.setattr(fair_test, name, (1,))
    monkeypatch.setattr(fair_test, "TEST", (1, 1))
    monkeypatch.setattr(fair_test, "WIDTHS", (1.0, 1.5))
    monkeypatch.setattr(fair_test, "LEARNING_PARTICLES", 300)
    monkeypatch.setattr(fair_test, "GoldfishSettings", partial(fair_test.GoldfishSettings, frames=16))
    words = [
        "reproduce",
        "goldfish-correlation",
        "--particles",
        "20",
        "--seeds",
        "1",
        "--clips",
        "2",
        "--development",
        "1",
    ]
    assert main([*words, "--out", str(tmp_path / "out"), "--cache", str(tmp_path / "cache")]) == 0
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [row["arm"] for row in found["own"]] == list(fair_arms.ARMS)
    assert all(0 <= value <= 1 for row in found["own"] for value in row["survival"])
    assert [row["arm"] for row in found["as B"]] == ["B", "C", "conditional"]
    assert main([*words[:-1], "9", "--out", str(tmp_path / "no"), "--cache", str(tmp_path / "cache")]) == 2
