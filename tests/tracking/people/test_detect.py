"""`tsuiseki detect`, and the finite sets over what a network detects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.measurement_tables import read_points
from tsuiseki.tracking.formats.mot import read_detections, read_tracks

BOX = [8, 8, 24, 40]


def test_boxes_and_centres_of_the_frames_that_were_asked_for_are_written(
    inputs: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["detect", str(inputs.video), "--detector", str(inputs.detector), "--view", "1", "--frames", "3-6"]
    assert main([*words, "--out", str(tmp_path / "det.txt")]) == 0
    assert capsys.readouterr().out == f"4 detections in 4 frames: {tmp_path / 'det.txt'}\n"
    found = read_detections(tmp_path / "det.txt", 12)
    assert [len(one) for one in found] == [0, 0, 1, 1, 1, 1, *[0] * 6]
    assert np.abs(found[2].boxes - BOX).max() < 0.01
    assert main([*words, "--out", str(tmp_path / "points.csv")]) == 0
    assert read_points(tmp_path / "points.csv", 12)[2] == pytest.approx(np.array([[16, 24]]), abs=0.01)
    assert main([*words, "--out", str(tmp_path / "det.txt")]) == 2


def test_finite_sets_track_what_a_network_detects(inputs: Any, tmp_path: Path) -> None:
    words = [str(inputs.video), "--detector", str(inputs.detector), "--out"]
    assert main(["track", "blobs", *words, str(tmp_path / "blobs"), "--particles", "200"]) == 0
    (track,) = read_tracks(tmp_path / "blobs" / "tracks.txt")
    assert np.abs(track.boxes[-1] - BOX).max() < 3
    model = tmp_path / "model.yaml"
    model.write_text("sensor: {model: linear, dimensions: 2, deviation: 2}\n")
    assert main(["track", "points", *words, str(tmp_path / "points"), "--model", str(model)]) == 0
    rows = (tmp_path / "points" / "tracks.csv").read_text().splitlines()
    assert len(rows) > 6
    model.write_text("sensor: {model: bearing-range, deviation: [0.02, 2]}\n")
    assert main(["track", "points", *words, str(tmp_path / "other"), "--model", str(model)]) == 2
