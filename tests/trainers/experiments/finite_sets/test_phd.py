"""The experiments of the finite-set filters, small; and the bars of the real scenarios on one run."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.experiments.finite_sets.equalisation import reproduce_equalisation
from tsuiseki.trainers.experiments.finite_sets.phd import run_filter, scenario_rows, start_filter
from tsuiseki.trainers.experiments.finite_sets.scenarios import REQUIRED, generated_scenario, read_scenario


@pytest.mark.parametrize("method", ["phd", "labelled"])
def test_the_linear_scenario_meets_its_bar(data_folder, method):
    scenario = read_scenario(data_folder / "phd" / "phd_scenario_linear_dev.json")
    scenario.settings["clutter_rates"] = scenario.settings["clutter_rates"][:1]
    (row,) = scenario_rows(scenario, [method], particles=500, runs=2)
    # The bars hold for 10 runs; two standard errors of two runs, about 1, are added.
    bars = {"phd": (15.0, 22.0), "labelled": (12.0, 15.0)}[method]
    assert row.ospa1 <= bars[0]
    assert row.ospa2 <= bars[1]


def test_the_turning_scenario_beats_the_plain_filter(data_folder):
    scenario = read_scenario(data_folder / "phd" / "phd_scenario_ct_dev.json")
    scenario.settings["clutter_rates"] = scenario.settings["clutter_rates"][:1]
    (row,) = scenario_rows(scenario, ["labelled"], particles=500, runs=2)
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


def test_equalisation_reports_both_arms(tmp_path):
    values = reproduce_equalisation(tmp_path, seeds=1, frames=25, density=80)
    assert set(values["kept"]) == {"as printed", "equalised", "equalised by the mean", "calibrated"}
    assert values["expected_count_at_end"]["as printed"] < 0.1
    assert values["expected_count_at_end"]["calibrated"] == pytest.approx(3.0, abs=0.5)
    assert (tmp_path / "particles.png").is_file()


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
