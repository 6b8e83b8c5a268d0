"""`python -m benchmarks.papers sphere-points` on one throw, and what a throw is made of."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.papers import sphere
from benchmarks.papers.__main__ import main
from benchmarks.papers.sphere import thrown


@pytest.mark.slow
def test_the_experiment_prints_every_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["sphere-points", "--seeds", "1", "--cache", str(tmp_path / "cache")]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in sphere.ROWS)
    found = json.loads((tmp_path / "out/results.json").read_text())
    # A pixel is 6 mm at 4 m; who knows how the ball flies is nearer than a centimetre and a half.
    assert np.mean(found["`--motion ballistic --drag --spin`"]) < 0.015


def test_a_throw_falls_by_gravity_and_spin_and_is_slowed_by_the_air() -> None:
    truth = thrown(3)[0]
    speed = np.diff(truth, axis=0) * sphere.RATE
    gained = np.diff(speed, axis=0)[:5].mean(axis=0) * sphere.RATE
    mean = speed[:6].mean(axis=0)
    drag = -sphere.DRAG * np.linalg.norm(mean) * mean
    expected = drag + np.cross(sphere.SPIN, mean) - [0.0, 0.0, sphere.GRAVITY]
    # The forces change over the six frames, so their mean is not that at the mean speed.
    np.testing.assert_allclose(gained, expected, atol=0.1)
    assert truth[:, 2].min() >= 0.5 * sphere.BALL


@pytest.mark.slow
def test_some_pixels_are_missing() -> None:
    lost = np.isnan(np.stack([thrown(seed)[1] for seed in range(10)])).any(axis=-1).mean()
    assert 0.02 < lost < 0.15
