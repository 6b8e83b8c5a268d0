"""`python -m benchmarks.papers drone-action-features` on clips of half a second."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.papers import drone_actions as drone
from benchmarks.papers.__main__ import main
from tests.tracking.conftest import save_action
from tsuiseki.tracking.features.action import STREAMS


def words(models: Path, folder: Path, out: str, *more: str) -> list[str]:
    streams = [str(models / f"{name}.onnx") for name in STREAMS]
    plan = ["--seeds", "1", "--clips", "1", "--frames", "12"]
    given = ["--actions", *streams, "--cache", str(folder / "cache")]
    return ["drone-action-features", "--out", str(folder / out), *plan, *given, *more]


@pytest.fixture(scope="session")
def drone_models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with four small streams, ``STREAM.onnx``."""
    folder = tmp_path_factory.mktemp("drone")
    for stream in STREAMS:
        save_action(folder / f"{stream}.onnx", stream)
    return folder


@pytest.fixture
def small_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes as those of the experiment, in small pictures of fewer people."""
    for name in ("TEST_SCENE", "SECOND_SCENE"):
        scene = replace(getattr(drone, name), width=320, height=180, people=4, clutter=2)
        monkeypatch.setattr(drone, name, scene)
    monkeypatch.setattr(drone, "MOST_ITERATIONS", 3)


@pytest.mark.slow
@pytest.mark.usefixtures("small_scenes")
def test_all_tables_and_figures_and_what_was_there_is_used_again(
    drone_models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words(drone_models, tmp_path, "first")) == 0
    printed = capsys.readouterr()
    tables = (tmp_path / "first" / "tables.md").read_text()
    for text in (
        "Table 5.3",
        "| 32.42 73.93 597 21.43 32.99 |",
        "Table 5.4",
        "Table 5.3, the camera's motion left in",
        "Table 5.5",
        "42.88",
        "switches in 100 frames",
    ):
        assert text in printed.out + tables
    values: dict[str, Any] = json.loads((tmp_path / "first/results.json").read_text())
    assert set(values["people"]) == {"taken out", "left in"}
    for rows in values["people"].values():
        printed = {f"{name} as printed" for name in ("MCF", "MHT-SAF", "MHT-MAF")}
        assert set(rows) == {"deepsort", "flow", "flow-saf", "flow-maf", "flow-maf, one-sided", *printed}
        assert rows["flow"]["against_flow"]["id_switches"]["difference"] == 0
    row = values["people"]["taken out"]["flow"]
    assert row["motp"] + row["motp_as_printed"] == pytest.approx(100)
    assert [len(curve) for curve in values["iterations"].values()] == [3, 3, 3]
    assert len(values["actions"]) == 4
    assert {p.name for p in (tmp_path / "first").iterdir()} >= {"iterations.png", "tables.json"}
    drawn = {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.jpg")}
    assert main(words(drone_models, tmp_path, "second")) == 0
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.jpg")} == drawn != {}
    again = json.loads((tmp_path / "second/results.json").read_text())
    assert again == values


def test_impossible_plans_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["drone-action-features", "--out", str(tmp_path / "out"), "--seeds", "0"]) == 2
    assert '"0" for --seeds. Must be > 0' in capsys.readouterr().err
