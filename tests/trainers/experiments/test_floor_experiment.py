"""The experiment of one floor on a few frames of the real labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.cameras.multicamera import PlacedTruth, read_floor_folder
from tsuiseki.tracking.cli import main
from tsuiseki.trainers.experiments import one_floor
from tsuiseki.trainers.experiments.one_floor import FollowedBy, floor_detections, measure, simulated

FRAMES = 10


def short_folder(folder):
    known = read_floor_folder(folder)
    frames, rate = (FRAMES, 2.0) if "wildtrack" in str(folder) else (60, known.cameras[0].frame_rate or 1.0)
    kept = known.truth.times < frames / rate
    truth = PlacedTruth(known.truth.times[kept], known.truth.ids[kept], known.truth.places[kept])
    return replace(known, found=[each[:frames] for each in known.found], truth=truth)


def three_cameras(folder):
    known = short_folder(folder)
    return replace(known, cameras=known.cameras[:3], found=known.found[:3])


@pytest.mark.slow
def test_rows_are_measured_and_drawn_anew(data_folder, monkeypatch):
    folder = data_folder / "multicamera/wildtrack"
    monkeypatch.setattr(one_floor, "read_floor_folder", short_folder)
    scores = {
        name: measure(FollowedBy(folder, cameras, method), 0)
        for name, cameras, method in (
            ("all", tuple(range(7)), "flow"),
            ("one", (0,), "flow"),
            ("sort", tuple(range(7)), "nearest and SORT"),
            ("floor", (), "floor detections"),
        )
    }
    assert scores["all"]["idf1"] > max(scores["one"]["idf1"], scores["sort"]["idf1"])
    assert scores["floor"]["mota"] > 0.8


def test_simulated_errors_are_as_many_as_said(data_folder):
    known = short_folder(data_folder / "multicamera/wildtrack")
    boxes = sum(len(each) for found in known.found for each in found)
    drawn = sum(len(each) for found in simulated(known, np.random.default_rng(0)) for each in found)
    assert abs(drawn - (0.7 * boxes + 2 * 7 * FRAMES)) < 4 * np.sqrt(boxes)
    positions = floor_detections(known, np.random.default_rng(0))
    assert abs(len(positions.times) - len(known.truth.times)) < 20


@pytest.mark.slow
def test_the_experiment_runs_to_its_tables(data_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(one_floor, "read_floor_folder", three_cameras)
    out = tmp_path / "out"
    words = ["--data", str(data_folder), "--seeds", "1", "--out", str(out), "--cache", str(tmp_path / "cache")]
    assert main(["reproduce", "one-floor", *words]) == 0
    tables = (out / "tables.md").read_text()
    assert "| all cameras |" in tables
    assert "Shelf, given keypoints" in tables
    assert (out / "cameras.png").is_file()
