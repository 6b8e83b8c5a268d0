"""Several cameras over one floor: boxes against the cameras' geometry, and the files read back and tracked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes.room_clip import FloorClipSettings
from tsuiseki.tracking.cameras.camera_files import read_cameras
from tsuiseki.tracking.cameras.multicamera import read_placed_truth
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.video.source import open_source

FRAMES, PEOPLE, NAMES = 4, 3, ("camera1", "camera2", "camera3")
WORDS = [
    "--cameras", "3", "--people", str(PEOPLE), "--frames", str(FRAMES), "--frame-rate", "5", "--width", "240",
    "--height", "180", "--seed", "2",
]  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("place") / "clip"
    assert main(["simulate", "floor", "--out", str(folder), *WORDS]) == 0
    return folder


@pytest.mark.slow
def test_everybody_is_true_and_stands_in_the_boxes(place: Path) -> None:
    truth = read_placed_truth(place)
    assert np.allclose(np.unique(truth.times), np.arange(FRAMES) / 5)
    assert np.bincount(truth.ids).tolist() == [0, *[FRAMES] * PEOPLE]
    placed = read_cameras(place / "cameras.yaml")
    assert [isinstance(one.camera, PinholeCamera) for one in placed] == [True, False, True]
    for one, name in zip(placed, NAMES, strict=True):
        camera, labels = one.camera, read_ground_truth(place / name / "gt" / "gt.txt")
        size = np.array([camera.width, camera.height])
        assert (one.name, open_source(place / name).length, len(labels.ids) > 0) == (name, FRAMES, True)
        for frame, number, box in zip(labels.frames, labels.ids, labels.boxes, strict=True):
            spot = truth.places[np.isclose(truth.times, frame / 5) & (truth.ids == number)][0]
            pixels = camera.project(np.array([[*spot, 0.1], [*spot, 1.3]]))[0]
            pixels = pixels[((pixels > 0) & (pixels < size)).all(axis=1)]
            assert len(pixels)
            assert (pixels > box[:2] - 3).all()
            assert (pixels < box[2:] + 3).all()


@pytest.mark.slow
def test_tracked_from_true_boxes_they_keep_their_ids(place: Path, tmp_path: Path) -> None:
    out, scores = tmp_path / "out", tmp_path / "scores.json"
    boxes = ",".join(str(place / name / "gt" / "gt.txt") for name in NAMES)
    given = ["--cameras", str(place / "cameras.yaml"), "--detections", boxes]
    assert main(["track", "floor", *(str(place / name) for name in NAMES), *given, "--out", str(out)]) == 0
    assert main(["evaluate", "floor", str(place), str(out), "--json", str(scores)]) == 0
    ((_, score),) = json.loads(scores.read_text()).items()
    assert score["idf1"] >= 0.9


def test_the_same_seed_gives_the_same_bytes(place: Path, tmp_path: Path) -> None:
    assert main(["simulate", "floor", "--out", str(tmp_path / "again"), *WORDS]) == 0
    files = [p.relative_to(place) for p in sorted(place.rglob("*")) if p.is_file() and p.name != "run.json"]
    assert len(files) == 3 * (FRAMES + 3) + 2
    for file in files:
        assert (place / file).read_bytes() == (tmp_path / "again" / file).read_bytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cameras": 2}, "greater than or equal to 3"),
        ({"cameras": 8}, "less than or equal to 7"),
        ({"repeated": 1.5}, "less than or equal to 1"),
    ],
)
def test_settings_out_of_range_are_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        FloorClipSettings(**change)
