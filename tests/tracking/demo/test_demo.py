"""`tsuiseki demo` leaves what it promises."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.evaluation.result_files import read_truths
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.video.source import open_source


@pytest.fixture
def small_models(inputs: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The small models of these tests in place of the shipped ones."""
    monkeypatch.setattr("tsuiseki.tracking.weights.shipped", lambda name: getattr(inputs, name.split("_")[0]))


@pytest.mark.slow
@pytest.mark.usefixtures("small_models")
def test_demo_leaves_a_result_for_each_method_and_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "demo"
    assert main(["demo", "--frames", "8", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    for method, name in (("sort", "SORT"), ("deepsort", "DeepSORT"), ("flow", "Min-cost flow")):
        assert len(read_tracks(out / method / "tracks.txt")) == 1
        record = json.loads((out / method / "run.json").read_text())
        assert record["settings"]["method"] == method
        assert name in shown
    assert len(list(open_source(out / "overlay.webm").frames())) == 8
    assert read_truths(out / "street")[0].length == 8
    page = (out / "report.html").read_text()
    assert "data:video/webm;base64," in page
    assert "Min-cost flow" in page
    assert main(["demo", "--out", str(out)]) == 2
    assert "already holds" in capsys.readouterr().err


@pytest.mark.slow
def test_the_clip_alone_is_a_video_as_large_as_the_street(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = tmp_path / "street.mp4"
    assert main(["demo", "--clip", str(clip), "--frames", "3"]) == 0
    assert str(clip) in capsys.readouterr().out
    frames = list(open_source(clip).frames())
    assert [frame.image.shape for frame in frames] == [(540, 960, 3)] * 3
    assert main(["demo", "--clip", str(clip)]) == 2
    assert main(["demo", "--clip", str(tmp_path / "street.avi")]) == 2
    assert "expected a name that ends in .webm or .mp4" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == [clip]


@pytest.mark.slow
def test_demo_with_the_shipped_models(tmp_path: Path) -> None:
    """Some of the people are found, and followed."""
    assert main(["demo", "--frames", "20", "--out", str(tmp_path / "demo")]) == 0
    assert main(["evaluate", "people", str(tmp_path / "demo" / "street"), str(tmp_path / "demo" / "flow"),
                 "--json", str(tmp_path / "s.json")]) == 0  # fmt: skip
    scores = json.loads((tmp_path / "s.json").read_text())["flow"]["combined"]
    assert scores["recall"] > 0.5
    assert scores["precision"] > 0.7
