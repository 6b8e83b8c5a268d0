"""`tsuiseki track people` with a detector of others says how its file is read, and that it gave nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tracking.features.tiny_onnx import save_constant
from tsuiseki import DetectorOptions, RequestError, track_people
from tsuiseki.tracking.cli import main

NAMES = {"names": "['car', 'person']"}


def tracked(inputs: Any, out: Path, rows: np.ndarray, capsys: pytest.CaptureFixture[str]) -> tuple[str, dict[str, Any]]:
    detector = save_constant(out.parent / "rows.onnx", {"output0": rows}, metadata=NAMES)
    words = ["track", "people", str(inputs.images), "--detector", str(detector), "--view", "1", "--method", "sort"]
    assert main([*words, "--out", str(out)]) == 0
    return capsys.readouterr().out, json.loads((out / "run.json").read_text())["facts"]["detector"]


def test_how_the_file_is_read(inputs: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = np.zeros((300, 6), np.float32)
    rows[0] = [10, 10, 30, 50, 0.9, 1]
    said, facts = tracked(inputs, tmp_path / "o", rows, capsys)
    read_as = "rows.onnx is read as layout yolo-suppressed, people are class 1 'person'; pictures letterbox, RGB"
    assert said.splitlines()[0] == f"{read_as}, [0, 1], 96x64"
    assert (facts["layout"], facts["person"], facts["pixels"]) == ("yolo-suppressed", 1, "unit")
    assert "no box of any class" not in said


def test_a_file_that_gives_nothing(inputs: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said, _ = tracked(inputs, tmp_path / "o", np.zeros((300, 6), np.float32), capsys)
    assert "rows.onnx gave no box of any class for any picture; check that it is the right export" in said


def test_what_the_file_leaves_open_is_given_in_python_too(inputs: Any, tmp_path: Path) -> None:
    rows = np.zeros((300, 6), np.float32)
    rows[0] = [10, 10, 30, 50, 0.9, 4]
    detector = save_constant(tmp_path / "rows.onnx", {"output0": rows})
    with pytest.raises(RequestError, match=r"`detector_options.person`"):
        track_people(inputs.images, "sort", detector=detector, view="1")
    options = DetectorOptions(person=4, layout="yolo-suppressed")
    found = track_people(inputs.images, "sort", detector=detector, view="1", detector_options=options)
    assert len(found) == 1
