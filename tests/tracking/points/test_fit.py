"""A sensor's model by maximum likelihood: the filters' log evidence, and what is found in simulated recordings."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tsuiseki
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.evaluation.point_distances import PointTracks, evaluate_points
from tsuiseki.tracking.filters.finite_sets.pairs import association_evidence, association_marginals
from tsuiseki.tracking.filters.kalman import Gaussians, predict, update
from tsuiseki.tracking.filters.maximum_likelihood import FittedSetting, LogEvidence, Range
from tsuiseki.tracking.formats.measurement_tables import read_sensing_model, sensing_model
from tsuiseki.tracking.points import fit
from tsuiseki.tracking.points.fit import fit_model, model_text, with_settings
from tsuiseki.tracking.points.settings import SetMethod
from tsuiseki.tracking.points.tracker import MeasurementTracker
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.measurements import Scan
from tsuiseki.tracking.types.sensing_model import SensingModel

TRUE = {"sensor.deviation": 10.0, "motion.acceleration": 5.0, "clutter": 3.0, "births.rate": 0.2, "detection": 0.9}
SIDE = 1000.0
MODEL = sensing_model(
    {
        "sensor": {"deviation": 10.0},
        "motion": {"acceleration": 5.0},
        "detection": 0.9,
        "clutter": 3.0,
        "region": [[-SIDE, SIDE], [-SIDE, SIDE]],
        "births": {"rate": 0.2, "speed": 10.0},
    }
)
HAND_SET = with_settings(
    MODEL,
    {"sensor.deviation": 5.0, "motion.acceleration": 12.0, "clutter": 8.0, "births.rate": 0.6, "detection": 0.75},
)


def recording(seed: int, steps: int = 30, first: int = 4) -> tuple[PointTracks, list[Scan]]:
    """Targets of `MODEL`, of which some are there at the start, and what is measured of them."""
    rng, states, names, born = np.random.default_rng(seed), np.empty((0, 4)), np.empty(0, dtype=np.int64), 0
    rows, scans = [], []
    for k in range(steps):
        alive = rng.random(len(states)) < 0.99
        x, y = 5.0 * rng.standard_normal((2, len(states)))
        states = states + np.stack([states[:, 1] + x / 2, x, states[:, 3] + y / 2, y], axis=1)
        count = first if k == 0 else rng.poisson(0.2)
        place, speed = rng.uniform(-SIDE / 2, SIDE / 2, (2, count)), 10.0 * rng.standard_normal((2, count))
        new = np.stack([place[0], speed[0], place[1], speed[1]], axis=1)
        states = np.concatenate([states[alive], new])
        names, born = np.concatenate([names[alive], born + 1 + np.arange(count)]), born + count
        rows.append((np.full(len(states), k), names, states[:, ::2]))
        seen = states[rng.random(len(states)) < 0.9, ::2]
        false = rng.uniform(-SIDE, SIDE, (rng.poisson(3.0), 2))
        scans.append(Scan(float(k), np.concatenate([seen + 10.0 * rng.standard_normal(seen.shape), false])))
    frames, ids, places = (np.concatenate(column) for column in zip(*rows, strict=True))
    return PointTracks(frames, ids, places), scans


def all_associations(detected: FloatArray, missed: FloatArray, unclaimed: FloatArray) -> float:
    """Summed weight of all associations, one after the other."""
    tracks, count, total = *detected.shape, 0.0
    for choice in itertools.product(range(count + 1), repeat=tracks):
        taken = [column for column in choice if column < count]
        if len(set(taken)) == len(taken):
            weights = [missed[i] if c == count else detected[i, c] for i, c in enumerate(choice)]
            total += float(np.prod(weights) * np.prod([unclaimed[j] for j in range(count) if j not in taken]))
    return total


@pytest.mark.parametrize("shape", [(1, 4), (4, 1), (1, 1), (2, 0), (0, 2)])
def test_the_evidence_of_associations_without_loops_is_exact(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    weights = rng.random(shape), rng.random(shape[0]), rng.random(shape[1])
    evidence = association_evidence(*weights, *association_marginals(*weights, tolerance=1e-10))
    assert evidence == pytest.approx(np.log(all_associations(*weights)), abs=1e-8)


def test_with_loops_it_is_close_and_never_greater() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        weights = 3 * rng.random((3, 4)), rng.random(3), rng.random(4)
        error = association_evidence(*weights, *association_marginals(*weights, tolerance=1e-10)) - np.log(
            all_associations(*weights)
        )
        assert -0.5 < error < 1e-6


def test_zero_weights_give_a_finite_evidence() -> None:
    weights = np.eye(2), np.zeros(2), np.zeros(2)
    assert association_evidence(*weights, *association_marginals(*weights)) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("method", ["labelled", "phd"])
def test_the_evidence_of_one_sure_target_is_that_of_the_kalman_filter(method: SetMethod) -> None:
    rng, state = np.random.default_rng(3), np.array([0.0, 10.0, 0.0, -5.0])
    motion, noise = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]]), np.kron(np.eye(2), [[6.25, 12.5], [12.5, 25.0]])
    scans = []
    for k in range(25):
        state = motion @ state + rng.multivariate_normal(np.zeros(4), noise)
        scans.append(Scan(float(k), (state[::2] + 10.0 * rng.standard_normal(2))[None]))
    model = replace(MODEL, detection=1.0, survival=1.0, clutter=1e-9, births=replace(MODEL.births, rate=1e-9))
    tracker, evidence = MeasurementTracker(model, method, 2000, calm=False), []
    for scan in scans:
        before = tracker.log_evidence
        tracker.update(scan)
        evidence.append(tracker.log_evidence - before)
    measures, errors = np.eye(4)[::2], 100.0 * np.eye(2)
    first = np.array([[scans[0].measurements[0, 0], 0.0, scans[0].measurements[0, 1], 0.0]])
    known, expected = Gaussians(first, np.diag([100.0, 100.0, 100.0, 100.0])[None]), 0.0
    for scan in scans[1:]:
        known = predict(known, motion, noise)
        spread = measures @ known.covariance[0] @ measures.T + errors
        away = scan.measurements[0] - measures @ known.mean[0]
        expected -= 0.5 * float(away @ np.linalg.solve(spread, away)) + 0.5 * np.log(np.linalg.det(2 * np.pi * spread))
        known = update(known, scan.measurements, measures, errors)
    # PHD takes a sure target for a Poisson number of mean 1, exp(-1) less likely each time.
    poisson = len(scans[1:]) if method == "phd" else 0
    assert sum(evidence[1:]) + poisson == pytest.approx(expected, abs=2.0)


def mean_ospa(model: SensingModel, seeds: range) -> float:
    """Over recordings, by the tracker as it stands."""
    scores = []
    for seed in seeds:
        truth, scans = recording(seed)
        tracker = MeasurementTracker(model, particles=300)
        for scan in scans:
            tracker.update(scan)
        rows = [(track.scans, np.full(len(track), track.id), track.positions) for track in tracker.tracks()]
        frames, ids, places = (np.concatenate(column) for column in zip(*rows, strict=True))
        scores.append(evaluate_points(truth, PointTracks(frames, ids, places), len(scans), 100.0).ospa1)
    return float(np.mean(scores))


@pytest.mark.slow
def test_settings_of_a_simulated_recording_lie_about_their_intervals_and_track_unseen_ones_better() -> None:
    fitted, found = fit_model(HAND_SET, recording(1)[1], particles=300)
    # So few particles lower the evidence of small noise: a tenth beyond the intervals.
    near = {name for name, value in TRUE.items() if found[name].low / 1.1 <= value <= found[name].high * 1.1}
    assert near == set(TRUE)
    assert found["sensor.deviation"].high < 2 * found["sensor.deviation"].low
    unseen = range(100, 103)
    assert mean_ospa(fitted, unseen) < mean_ospa(HAND_SET, unseen)


def test_a_setting_of_zero_stays_and_ratios_are_kept() -> None:
    model = sensing_model(
        {
            "sensor": {"deviation": [2.0, 6.0]},
            "motion": [{"acceleration": 1.0}, {"acceleration": 5.0}],
            "clutter": 0.0,
            "births": {"places": [{"mean": [0, 0, 0, 0], "deviation": 1, "rate": r} for r in (0.1, 0.3)]},
        }
    )
    changed = with_settings(model, {"sensor.deviation": 4.0, "motion.acceleration": 0.5, "births.rate": 0.8})
    assert changed.sensor.deviation == (4.0, 12.0)
    assert [motion.acceleration for motion in changed.motions] == [0.5, 2.5]
    assert [place.rate for place in changed.births.places] == pytest.approx([0.2, 0.6])
    assert (changed.clutter, changed.detection) == (0.0, model.detection)


def at_the_start(log_evidence: LogEvidence, ranges: Mapping[str, Range], seed: int) -> dict[str, FittedSetting]:
    """Stands for `fit_settings`: one evaluation, where the search begins."""
    del seed
    assert np.isfinite(log_evidence({name: bounded.start for name, bounded in ranges.items()}))
    return {name: FittedSetting(bounded.start, bounded.low, bounded.high) for name, bounded in ranges.items()}


def test_the_command_writes_the_model_it_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit, "fit_settings", at_the_start)
    rows = [f"{scan.time:g},{x!r},{y!r}" for scan in recording(2, steps=6)[1] for x, y in scan.measurements.tolist()]
    (tmp_path / "radar.csv").write_text("\n".join(["time,x,y", *rows]) + "\n")
    (tmp_path / "start.yaml").write_text(model_text(HAND_SET, {}))
    words = ["--model", str(tmp_path / "start.yaml"), "--particles", "50", "--fit", "--out", str(tmp_path / "out")]
    assert main(["track", "points", str(tmp_path / "radar.csv"), *words]) == 0
    text = (tmp_path / "out/model.yaml").read_text()
    assert text.startswith("# sensor.deviation: ")
    facts = json.loads((tmp_path / "out/run.json").read_text())["facts"]
    assert facts["fitted"].keys() == TRUE.keys()
    assert np.isfinite(facts["log_evidence"])
    found = read_sensing_model(tmp_path / "out/model.yaml")
    assert found.detection == pytest.approx(facts["fitted"]["detection"]["value"])
    assert found.region == MODEL.region


def test_measurements_with_errors_of_their_own_keep_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit, "fit_settings", at_the_start)
    scans = [replace(scan, covariances=np.tile(100.0 * np.eye(2), (len(scan.measurements), 1, 1)))
             for scan in recording(4, steps=5)[1]]  # fmt: skip
    _, found = fit_model(MODEL, scans, particles=30)
    assert "sensor.deviation" not in found
    assert tsuiseki.track_measurements(scans, MODEL, particles=30).facts["log_evidence"] < 0
