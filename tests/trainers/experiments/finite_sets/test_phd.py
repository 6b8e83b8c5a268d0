"""The experiments of the finite-set filters, small; and the bars of the real scenarios on one run."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.experiments.finite_sets import phd
from tsuiseki.trainers.experiments.finite_sets.runs import run_filter, scenario_row, start_filter
from tsuiseki.trainers.experiments.finite_sets.scenarios import REQUIRED, generated_scenario, read_scenario


@pytest.mark.parametrize("method", ["phd", "labelled"])
def test_the_linear_scenario_meets_its_bar(data_folder, method):
    scenario = read_scenario(data_folder / "phd" / "phd_scenario_linear_dev.json")
    row = scenario_row(scenario, 0, method, particles=500, runs=2)
    # The bars hold for 10 runs; two standard errors of two runs, about 1, are added.
    bars = {"phd": (15.0, 22.0), "labelled": (12.0, 15.0)}[method]
    assert row.ospa1 <= bars[0]
    assert row.ospa2 <= bars[1]


def test_the_turning_scenario_beats_the_plain_filter(data_folder):
    scenario = read_scenario(data_folder / "phd" / "phd_scenario_ct_dev.json")
    row = scenario_row(scenario, 0, "labelled", particles=500, runs=2)
    assert row.ospa1 <= 0.9 * 32.2 + 1.0


def test_generated_scenarios_are_tracked():
    settings, measurements = generated_scenario(6, 5.0, 12, seed=0)
    found, seconds = run_filter(start_filter("labelled", settings, 5.0, 200, seed=0), measurements)
    assert len(seconds) == 12
    assert abs(np.sum(found.frames == 11) - 6) <= 2


def test_without_places_of_birth_the_measurements_drive_them():
    settings, measurements = generated_scenario(4, 3.0, 12, seed=1)
    for name in ("birth_m", "birth_w", "birth_sd"):
        del settings[name]
    found, _ = run_filter(start_filter("labelled", settings, 3.0, 500, seed=0), measurements)
    assert abs(np.sum(found.frames == 11) - 4) <= 1


def test_equalisation_reports_all_arms(tmp_path, capsys):
    words = [
        "--seeds",
        "1",
        "--unknown-seeds",
        "1",
        "--frames",
        "15",
        "--particles",
        "80",
        "--cache",
        str(tmp_path / "cache"),
    ]
    assert main(["reproduce", "phd-equalisation", *words, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "kept of 3" in printed
    values = json.loads((tmp_path / "out/results.json").read_text())
    assert set(values["kept"]) == {"as printed", "equalised", "equalised by the mean", "calibrated"}
    assert values["expected_count_at_end"]["as printed"] < 0.1
    assert values["expected_count_at_end"]["calibrated"] == pytest.approx(3.0, abs=0.5)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"results.json", "tables.md", "particles.png", "run.json"}
    for condition, arms in values["held"].items():
        # The ratio holds every target in view where it began near the truth, whatever its purity.
        if condition != "anywhere, births, survival 0.98":
            assert np.mean(arms["calibrated"]["shares"], axis=0).min() > 0.5, condition
            assert len(arms["calibrated"]["counts"]) == len(arms["calibrated"]["shares"])


@pytest.fixture
def small_scenario(tmp_path):
    """The folder ``phd`` with a scenario of three targets over ten steps, as the standard ones lie on disk."""
    settings, measurements = generated_scenario(3, 2.0, 10, seed=2)
    settings |= {"clutter_rates": [2.0], "runs": 1, "seed": 20061}
    arrays = {name: settings.pop(name).tolist() for name in ("birth_m", "birth_w", "birth_sd")}
    folder = tmp_path / "phd"
    folder.mkdir()
    (folder / "phd_scenario_small.json").write_text(json.dumps(settings | arrays))
    step = np.repeat(np.arange(10), [len(found) for found in measurements])
    # (steps, targets, states): straight on from where they were born.
    truth = np.repeat(np.array(arrays["birth_m"])[None], 10, axis=0)
    truth[:, :, [0, 2]] += np.arange(1, 11)[:, None, None] * truth[:, :, [1, 3]]
    np.savez(
        folder / "phd_scenario_small.npz", truth=truth, z=np.concatenate(measurements),
        z_run=0 * step, z_clut=0 * step, z_k=step,
    )  # fmt: skip
    return tmp_path


def test_the_finite_set_experiment_prints_writes_and_keeps(small_scenario, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(phd, "GROWN", (("clutter", [4, 8]), ("targets", [2, 4])))
    words = ["--data", str(small_scenario), "--particles", "150", "--runs", "1", "--cache", str(tmp_path / "cache")]
    assert main(["reproduce", "phd", *words, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "log-log slope over targets" in printed
    values = json.loads((tmp_path / "out/results.json").read_text())
    rows = {row["method"]: row for row in values["scenarios"]}
    assert set(rows) == {"phd-literal", "phd-printed", "phd-clusters", "phd", "labelled"}
    # Three targets that stay: a filter that shows nothing has an OSPA of 100.
    assert rows["labelled"]["ospa1"] < 50
    assert [one["sizes"] for one in values["scaling"]] == [[4, 8], [2, 4]] * 2
    assert {"ospa.png", "scaling.png", "tables.md", "run.json"} <= {p.name for p in (tmp_path / "out").iterdir()}
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.json")}
    assert main(["reproduce", "phd", *words, "--out", str(tmp_path / "again")]) == 0
    assert kept == {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.json")}
    # Times too: nothing was run again.
    assert (tmp_path / "again/results.json").read_text() == (tmp_path / "out/results.json").read_text()


def test_a_broken_scenario_gets_one_line(tmp_path):
    with pytest.raises(RequestError, match="expected a scenario file"):
        read_scenario(tmp_path / "none.json")
    settings, archive = tmp_path / "some.json", tmp_path / "some.npz"
    archive.write_bytes(b"")
    for text, expected in (
        ("{", "expected JSON"),
        (json.dumps({"kind": "cubic"}), "kind linear or ct, got 'cubic'"),
        (json.dumps({"kind": "linear"}), "expected the setting T"),
    ):
        settings.write_text(text)
        with pytest.raises(RequestError, match=expected):
            read_scenario(settings)
    settings.write_text(json.dumps(dict.fromkeys((*REQUIRED, "sigma_e"), 1) | {"kind": "linear"}))
    with pytest.raises(RequestError, match="expected a NumPy archive"):
        read_scenario(settings)
    np.savez(archive, truth=np.zeros((1, 1, 4)))
    with pytest.raises(RequestError, match="got no 'z is not"):
        read_scenario(settings)
