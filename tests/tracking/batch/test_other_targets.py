"""A batch of each command beside people: good input gives what the command gives by itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tracking.floor.conftest import boxes_of, pinhole
from tsuiseki.tracking.cameras.camera_files import Placed, write_cameras
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.cli import main


def write_rows(path: Path, boxes: list[np.ndarray]) -> None:
    """MOTChallenge detections, a frame an array of corners."""
    rows = [(n, *each[:2], *(each[2:] - each[:2])) for n, found in enumerate(boxes, 1) for each in found]
    path.write_text("".join(f"{n},-1,{x:.2f},{y:.2f},{w:.2f},{h:.2f},0.9\n" for n, x, y, w, h in rows))


def places(frame: int) -> np.ndarray:
    return np.array([[-2 + 0.1 * frame, 0.0], [2 - 0.1 * frame, 1.0]])


def shelf(folder: Path) -> Path:
    """Two people on a floor before two cameras, laid out as Shelf."""
    folder.mkdir(parents=True)
    seen = {str(n): pinhole(*at) for n, at in enumerate([(-8.0, -8.0), (8.0, -8.0)])}
    known = {}
    for name, camera in seen.items():
        lens = [
            [camera.focal[0], 0, camera.principal_point[0]],
            [0, camera.focal[1], camera.principal_point[1]],
            [0, 0, 1],
        ]
        pose = np.column_stack([camera.rotation, -camera.rotation @ camera.position])
        known[name] = {"K": lens, "RT": pose.tolist(), "imgSize": [camera.width, camera.height]}
        rows = [(n, *box) for n in range(20) for box in boxes_of(camera, places(n))]
        text = "".join(",".join(f"{value:.2f}" for value in row[1:]) + "\n" for row in rows)
        lines = [f"{row[0] + 1},{line}" for row, line in zip(rows, text.splitlines(), strict=True)]
        (folder / f"camera{name}_detections.csv").write_text("\n".join(["frame,x1,y1,x2,y2", *lines]) + "\n")
    (folder / "calibration.json").write_text(json.dumps(known))
    (folder / "truth.csv").write_text(
        "frame,person,x,y\n"
        + "".join(f"{n + 1},{k},{x},{y}\n" for n in range(20) for k, (x, y) in enumerate(places(n)))
    )
    return folder


def drone(folder: Path, videos: Path) -> tuple[list[str], str]:
    write_rows(folder / "still.txt", [np.array([[10.0 + n / 2, 8, 20 + n / 2, 40]]) for n in range(20)])
    words = ["--detections", str(folder / "{name}.txt"), "--appearance", "none", "--method", "flow"]
    return [str(videos / "still.avi"), *words], "still"


def fisheye(folder: Path, videos: Path) -> tuple[list[str], str]:
    write_rows(folder / "still.txt", [np.array([[40.0, 10 + n / 3, 48, 20 + n / 3]]) for n in range(20)])
    forward, middle = np.array([25.0, 0.0, -0.012]), np.array([24.0, 40.0])
    lens = OmnidirectionalLens(80, 48, forward, middle, np.eye(2), np.empty(0), 1.4)
    over = OmnidirectionalCamera(lens, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 3.0]))
    write_cameras(folder / "cameras.yaml", [Placed("still", over, 12.5, 0.0, np.array([-3.0, -3.0, 3.0, 3.0]))])
    words = ["--detections", str(folder / "{name}.txt"), "--appearance", "none"]
    return [str(videos / "still.avi"), *words, "--cameras", str(folder / "cameras.yaml")], "still"


def floor(folder: Path, _: Path) -> tuple[list[str], str]:
    shelf(folder / "halls/monday")
    return [str(folder / "halls")], "monday"


@pytest.mark.slow
@pytest.mark.parametrize("make", [drone, fisheye, floor])
def test_a_batch_gives_what_the_command_gives(
    make: Any, videos: Path, tmp_path: Path, here: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    words, name = make(tmp_path, videos)
    all_, one = tmp_path / "all", tmp_path / "one"
    assert main(["batch", "track", make.__name__, *words, "--out", str(all_)]) == 0, capsys.readouterr()
    assert here.kinds() == ["begin", "whole"]
    source = str(tmp_path / "halls/monday") if make is floor else words[0]
    single = [word.replace("{name}", name) for word in words[1:]]
    assert main(["track", make.__name__, source, *single, "--out", str(one)]) == 0, capsys.readouterr()
    tables = [path for path in one.rglob("*") if path.name in ("tracks.txt", "world.csv")]
    assert any(path.stat().st_size > 100 for path in tables)
    for path in tables:
        assert (all_ / name / path.relative_to(one)).read_bytes() == path.read_bytes()


@pytest.mark.usefixtures("here")
def test_a_folder_without_floors_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["batch", "track", "floor", str(tmp_path), "--out", str(tmp_path / "o")]) == 2
    assert "expected folders of WILDTRACK or Shelf, found none" in capsys.readouterr().err


def test_a_count_without_a_scene_fails_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a", "b"):
        (tmp_path / "results" / name).mkdir(parents=True)
    assert main(["batch", "count", str(tmp_path / "results"), "--out", str(tmp_path / "o")]) == 2
    assert capsys.readouterr().err == "tsuiseki: missing: --scene\n"
    assert not (tmp_path / "o").exists()
