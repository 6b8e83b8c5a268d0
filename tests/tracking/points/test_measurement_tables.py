"""A sensor's measurements in, tracks out: uneven times, covariances, 3D, several motions, and what cannot be."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import tsuiseki
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.types.sensing_model import MotionName

MODEL = {
    "sensor": {"model": "linear", "deviation": 5},
    "motion": {"acceleration": 1.0},
    "detection": 0.95,
    "clutter": 3,
    "region": [[-500, 500], [-500, 500]],
    "births": {"rate": 0.2, "speed": 10},
}
STARTS = np.array([[-200.0, -200.0, 0.0], [200.0, 100.0, 50.0]])
SPEEDS = np.array([[8.0, 4.0, 1.0], [-6.0, 5.0, -2.0]])


def scans(dimensions: int = 2, own: bool = False, steps: int = 25, seed: int = 0) -> list[tsuiseki.Scan]:
    """Two targets at uneven times in clutter; ``own`` gives each measurement a covariance."""
    rng, time, made = np.random.default_rng(seed), 0.0, []
    for _ in range(steps):
        time += rng.uniform(0.4, 1.6)
        places = (STARTS + SPEEDS * time)[:, :dimensions]
        deviation = rng.uniform(2, 20, (2, 1)) if own else np.full((2, 1), 5.0)
        seen = rng.random(2) < 0.95
        false = rng.uniform(-500, 500, (rng.poisson(3), dimensions))
        measured = np.concatenate([(places + deviation * rng.standard_normal(places.shape))[seen], false])
        spread = np.concatenate([deviation[seen, 0], np.full(len(false), 5.0)])
        made.append(tsuiseki.Scan(time, measured, spread[:, None, None] ** 2 * np.eye(dimensions) if own else None))
    return made


def model(dimensions: int = 2, **more: object) -> dict[str, object]:
    changed = {**MODEL, **more}
    if dimensions == 3:
        changed |= {"sensor": {"deviation": 5, "dimensions": 3}, "region": [[-500, 500]] * 3}
    return changed


@pytest.mark.parametrize("method", ["labelled", "phd"])
@pytest.mark.parametrize(("dimensions", "own"), [(2, False), (2, True), (3, False)])
def test_two_targets_are_followed_at_uneven_times(method: str, dimensions: int, own: bool) -> None:
    measured = scans(dimensions, own)
    found = tsuiseki.track_measurements(measured, model(dimensions), method=method, particles=300, shortest=10)  # type: ignore[arg-type]
    assert len(found) == 2
    for track in found:
        truth = STARTS[:, None, :dimensions] + SPEEDS[:, None, :dimensions] * track.times[:, None]
        away = np.linalg.norm(track.positions - truth, axis=2)
        mine = int(away.mean(axis=1).argmin())
        # A single measurement is off by 5 (own: 11) times the root of the dimensions.
        assert away[mine, 5:].mean() < 8
        assert np.abs(track.velocities[-5:] - SPEEDS[mine, :dimensions]).max() < 6
        assert track.covariances.shape == (len(track), 2 * dimensions, 2 * dimensions)
        assert (np.linalg.eigvalsh(track.covariances) > -1e-9).all()
        # The normalised squared error of a consistent filter has the mean `dimensions`.
        error = track.positions - truth[mine]
        position = track.covariances[:, ::2, ::2]
        nees = np.einsum("td,tde,te->t", error, np.linalg.inv(position), error)[5:]
        assert 0.3 * dimensions < nees.mean() < 3 * dimensions


@pytest.mark.parametrize("motion", get_args(MotionName))
@pytest.mark.parametrize("dimensions", [2, 3])
def test_targets_are_followed_by_a_motion_of_any_name(motion: str, dimensions: int) -> None:
    chosen = model(dimensions, motion={"model": motion})
    found = tsuiseki.track_measurements(scans(dimensions), chosen, particles=300, shortest=10)  # type: ignore[arg-type]
    assert len(found) == 2


def test_the_motion_in_force_is_told() -> None:
    rng, made, place, speed = np.random.default_rng(0), [], np.zeros(2), np.array([10.0, 0.0])
    for k in range(40):
        # A sharp turn from 20 on.
        turn = 0.5 if 20 <= k < 28 else 0.0
        speed = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ speed
        place = place + speed
        made.append(tsuiseki.Scan(float(k), (place + rng.normal(0, 2, 2))[None]))
    motions = [{"acceleration": 0.2}, {"acceleration": 8.0}]
    chosen = {**MODEL, "sensor": {"deviation": 2}, "motion": motions, "switching": 0.1, "clutter": 0.1}
    (track,) = tsuiseki.track_measurements(made, chosen, particles=1000, shortest=20)
    np.testing.assert_allclose(track.modes.sum(axis=1), 1.0)
    agile = dict(zip(track.scans.tolist(), track.modes[:, 1], strict=True))
    assert np.mean([agile[k] for k in range(22, 28)]) > np.mean([agile[k] for k in range(10, 19)]) + 0.3


def test_bearings_and_ranges_from_a_standing_sensor() -> None:
    rng, made, origin = np.random.default_rng(1), [], np.array([10.0, -300.0])
    for k in range(20):
        away = np.array([-150.0, 100.0]) + k * np.array([8.0, 2.0]) - origin
        polar = [np.arctan2(away[1], away[0]) + rng.normal(0, 0.01), np.hypot(*away) + rng.normal(0, 3)]
        made.append(tsuiseki.Scan(0.5 * k, np.array([polar])))
    sensor = {"model": "bearing-range", "deviation": [0.01, 3], "position": origin.tolist()}
    chosen = {**MODEL, "sensor": sensor, "region": [[-3.14159, 3.14159], [0, 1000]], "clutter": 0.1}
    (track,) = tsuiseki.track_measurements(made, chosen, particles=500, shortest=10)
    assert np.abs(track.positions[-1] - [2.0, 138.0]).max() < 10
    assert np.abs(track.velocities[-1] - [16.0, 4.0]).max() < 6


def test_live_targets_are_those_of_the_whole_run() -> None:
    measured = scans(steps=8)
    chosen = model()
    live = list(tsuiseki.follow_measurements(measured, chosen, particles=200))
    whole = tsuiseki.track_measurements(measured, chosen, particles=200)
    assert sum(len(each.ids) for each in live) == sum(len(track) for track in whole)
    np.testing.assert_allclose(live[-1].time, measured[-1].time)


def test_a_scan_of_lag_answers_every_scan_once_and_places_targets_better() -> None:
    measured = scans(steps=25)
    at_once, later = (
        tsuiseki.track_measurements(measured, model(), particles=300, shortest=10, lag=lag) for lag in (0, 1)
    )
    assert len(at_once) == len(later) == 2

    def error(tracks: list[tsuiseki.SensedTrack]) -> float:
        away = []
        for track in tracks:
            places = STARTS[:, None, :2] + SPEEDS[:, None, :2] * track.times[:, None]
            away.append(np.linalg.norm(track.positions - places, axis=2)[:, 5:-1].mean(axis=1).min())
        return float(np.mean(away))

    assert error(later) < error(at_once)
    live = list(tsuiseki.follow_measurements(measured, model(), particles=300, lag=1))
    assert [each.time for each in live] == [scan.time for scan in measured]
    whole = tsuiseki.track_measurements(measured, model(), particles=300, lag=1)
    assert sum(len(each.ids) for each in live) == sum(len(track) for track in whole)
    with pytest.raises(RequestError, match="`lag`: expected 0"):
        tsuiseki.track_measurements(measured, model(), method="phd", lag=1)


def write_csv(path: Path, header: str, rows: list[str]) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_the_command_writes_what_the_function_finds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    measured = scans(own=True, steps=12)
    rows = [
        f"{scan.time!r},{m[0]!r},{m[1]!r},{float(c[0, 0])!r},0,{float(c[1, 1])!r}"
        for scan in measured
        for m, c in zip(scan.measurements.tolist(), np.asarray(scan.covariances), strict=True)
    ]
    file = write_csv(tmp_path / "radar.csv", "time,x,y,cov_x_x,cov_x_y,cov_y_y", rows)
    chosen = tmp_path / "model.yaml"
    chosen.write_text(json.dumps(model()))
    words = ["track", "points", str(file), "--model", str(chosen), "--particles", "200", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert "2 targets in 12 scans" in capsys.readouterr().out
    with (tmp_path / "out/tracks.csv").open() as text:
        written = list(csv.DictReader(text))
    found = tsuiseki.track_measurements(file, chosen, particles=200, shortest=3)
    assert len(written) == sum(len(track) for track in found)
    first = next(row for row in written if int(row["id"]) == found[0].id)
    assert float(first["x"]) == pytest.approx(found[0].positions[0, 0], rel=1e-5)
    assert float(first["cov_vx_vx"]) == pytest.approx(found[0].covariances[0, 1, 1], rel=1e-5)
    assert {"tracks.csv", "tracks.png", "run.json"} == {path.name for path in (tmp_path / "out").iterdir()}
    assert main(["evaluate", "points", str(tmp_path / "out/tracks.csv"), str(tmp_path / "out/tracks.csv")]) == 0


def test_empty_rows_and_missing_frames_are_scans_without_measurements(tmp_path: Path) -> None:
    from tsuiseki.tracking.formats.measurement_tables import read_scans

    timed = read_scans(write_csv(tmp_path / "a.csv", "time,x,y", ["0.5,1,2", "1.5,,", "2,3,4", "2,5,6"]), ("x", "y"))
    assert [(scan.time, len(scan.measurements)) for scan in timed] == [(0.5, 1), (1.5, 0), (2.0, 2)]
    framed = read_scans(write_csv(tmp_path / "b.csv", "frame,x,y", ["1,1,2", "4,3,4"]), ("x", "y"), period=0.1)
    assert [len(scan.measurements) for scan in framed] == [1, 0, 0, 1]
    np.testing.assert_allclose([scan.time for scan in framed], [0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize(
    ("header", "rows", "reason"),
    [
        ("time,x,y", ["1,2,3", "0.5,2,3"], "radar.csv:3: expected rows in order of time, got 0.5 after 1; sort"),
        ("time,x", ["1,2"], "expected the columns time,x,y in its first line, found no y"),
        ("x,y", ["1,2"], "expected the columns frame,x,y"),
        ("time,x,y", ["1,2,a"], "radar.csv:2: expected a finite number in column y, got 'a'"),
        ("time,x,y", [], "expected at least one row"),
        ("time,x,y,sd_x", ["1,2,3,4"], "found no sd_y"),
        ("time,x,y,sd_x,sd_y", ["1,2,3,4,0"], "expected standard deviations above 0, got 0"),
        ("time,x,y,cov_x_x,cov_x_y,cov_y_y", ["1,2,3,1,2,1"], "expected a positive definite covariance"),
        ("frame,x,y", ["1.5,2,3"], "expected whole numbers in column frame"),
    ],
)
def test_a_broken_file_gets_one_line(tmp_path: Path, header: str, rows: list[str], reason: str) -> None:
    file = write_csv(tmp_path / "radar.csv", header, rows)
    with pytest.raises(RequestError, match=reason):
        tsuiseki.track_measurements(file, MODEL)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"sensor": {"model": "sonar"}}, "`sensor.model`: expected 'linear' or 'bearing-range', got 'sonar'"),
        ({"sensor": {"dimensions": 4}}, "`sensor.dimensions`: expected 2 or 3, got 4"),
        ({"sensor": {"deviation": [1, 2, 3]}}, "`sensor.deviation`: expected 1 or 2 numbers, got"),
        ({"noise": 3}, "`noise`: there is no such setting"),
        ({"motion": {"speed": 3}}, "`motions.speed`: there is no such setting"),
        ({"motion": {"acceleration": "fast"}}, "`motions.acceleration`: expected a valid number, .* got 'fast'"),
        ({"sensor": {"deviation": float("inf")}}, "`sensor.deviation`: expected a finite number, got inf"),
        ({"clutter": 1e300}, "`clutter`: expected a number less than or equal to 10{20}, got 1e"),
        ({"detection": 1.5}, "`detection`: expected a number less than or equal to 1, got 1.5"),
        ({"region": [[0, 1]]}, "`region`: expected 2 pairs"),
        ({"region": [[1, 0], [0, 1]]}, "`region`: expected each low below its high"),
        ({"births": {"places": [{"mean": [0, 0, 0, 0]}]}}, "`births.places.deviation`: expected a value, got none"),
        ({"births": {"places": [{"mean": [0, 0], "deviation": 1, "rate": 1}]}}, "expected a mean of 4 or 6 numbers"),
    ],
)
def test_a_broken_model_gets_one_line(change: dict[str, object], reason: str) -> None:
    with pytest.raises(RequestError, match=reason):
        tsuiseki.track_measurements(scans(steps=3), {**MODEL, **change})


def test_measurements_outside_the_region_are_told() -> None:
    with pytest.warns(InputWarning, match=r"\d+ of \d+ measurements lie outside the model's region"):
        tsuiseki.track_measurements(scans(steps=3), {**MODEL, "region": [[-1, 1], [-1, 1]]})


def test_known_places_of_birth_and_a_late_scan() -> None:
    places = [{"mean": [-200, 8, -200, 4], "deviation": [20, 4, 20, 4], "rate": 0.1}]
    found = tsuiseki.track_measurements(scans(steps=10), model(births={"places": places}), particles=300, shortest=5)
    # The second target appears far from the only place of birth.
    assert len(found) == 1
    late = [*scans(steps=2), tsuiseki.Scan(0.1, np.zeros((1, 2)))]
    with pytest.raises(RequestError, match="expected scans in order of time"):
        tsuiseki.track_measurements(late, MODEL)


def test_a_calm_target_is_placed_better_than_the_whole_acceleration_allows() -> None:
    rng, k = np.random.default_rng(0), np.arange(60.0)
    truth = np.array([-300.0, -200.0]) + k[:, None] * [10.0, 6.0]
    made = [tsuiseki.Scan(t, (place + rng.normal(0, 5, 2))[None]) for t, place in zip(k, truth, strict=True)]
    away = []
    # Two motions that are the same are the one alone.
    for motion in ({"acceleration": 5.0}, [{"acceleration": 5.0}] * 2):
        (track,) = tsuiseki.track_measurements(made, {**MODEL, "motion": motion, "clutter": 0.1}, shortest=20)
        away.append(np.linalg.norm(track.positions - truth[track.scans], axis=1)[10:].mean())
    assert away[0] < 0.9 * away[1]
