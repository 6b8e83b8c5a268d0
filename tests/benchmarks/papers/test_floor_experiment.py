"""The experiment of one floor on a few frames of the real labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.papers import one_floor
from benchmarks.papers.__main__ import main
from benchmarks.papers.one_floor import floor_detections, kept_ids, measure, simulated
from tsuiseki.tracking.cameras.multicamera import PlacedTruth, read_floor_folder

FRAMES = 10


def short_folder(folder):
    known = read_floor_folder(folder)
    frames, rate = (FRAMES, 2.0) if "wildtrack" in str(folder) else (60, known.cameras[0].frame_rate or 1.0)
    kept = known.truth.times < frames / rate
    truth = PlacedTruth(known.truth.times[kept], known.truth.ids[kept], known.truth.places[kept])
    return replace(known, people=[each[:frames] for each in known.people], truth=truth)


def three_cameras(folder):
    known = short_folder(folder)
    return replace(known, cameras=known.cameras[:3], people=known.people[:3])


@pytest.mark.slow
def test_rows_are_measured_and_drawn_anew(data_folder, monkeypatch):
    folder = data_folder / "multicamera/wildtrack"
    monkeypatch.setattr(one_floor, "read_floor_folder", short_folder)
    scores = {
        name: measure(folder, cameras, method, 0)
        for name, cameras, method in (
            ("all", tuple(range(7)), "flow"),
            ("one", (0,), "flow"),
            ("sort", tuple(range(7)), "nearest and SORT"),
            ("floor", (), "floor detections"),
        )
    }
    assert scores["all"]["idf1"] > max(scores["one"]["idf1"], scores["sort"]["idf1"])
    assert scores["floor"]["mota"] > 0.8


def test_an_id_is_kept_where_it_is_that_of_before_in_another_view():
    """One leaves the first view for the second and keeps the id; the other does so and gets a new one."""
    times = np.arange(8) * 0.5
    truth = PlacedTruth(np.tile(times, 2), np.repeat([1, 2], 8), np.repeat([[0.0, 0.0], [5.0, 5.0]], 8, axis=0))
    found = PlacedTruth(truth.times, np.where((truth.ids == 2) & (truth.times > 1.6), 7, truth.ids), truth.places + 0.1)
    first = np.arange(8) < 4
    views = {who: np.stack([first, ~first], axis=1) for who in (1, 2)}
    assert kept_ids(truth, found, views) == (1, 2)
    # Who is in no other view within a second does not change views.
    assert kept_ids(truth, found, {1: np.stack([first, np.zeros(8, bool)], axis=1)}) == (0, 0)


@pytest.mark.slow
def test_simulated_errors_are_as_many_as_said(data_folder):
    known = short_folder(data_folder / "multicamera/wildtrack")
    boxes = sum(len(each) for found in known.people for each in found)
    drawn = sum(len(each) for found in simulated(known, np.random.default_rng(0)) for each in found)
    assert abs(drawn - (0.7 * boxes + 2 * 7 * FRAMES)) < 4 * np.sqrt(boxes)
    positions = floor_detections(known, np.random.default_rng(0))
    assert abs(len(positions.times) - len(known.truth.times)) < 20


@pytest.mark.slow
def test_the_experiment_runs_to_its_tables(data_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(one_floor, "read_floor_folder", three_cameras)
    monkeypatch.setattr(one_floor, "FRAMES", 8)
    out = tmp_path / "out"
    words = [
        "--data",
        str(data_folder),
        "--seeds",
        "1",
        "--places",
        "1",
        "--out",
        str(out),
        "--cache",
        str(tmp_path / "cache"),
    ]
    assert main(["one-floor", *words]) == 0
    tables = (out / "tables.md").read_text()
    assert "| all cameras |" in tables
    assert "Shelf, given keypoints" in tables
    assert "| generated places |" in tables
    assert (out / "cameras.png").is_file()
