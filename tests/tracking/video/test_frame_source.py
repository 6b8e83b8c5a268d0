"""Frames lie in time where the container puts them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning
from tsuiseki.tracking.types import Frame
from tsuiseki.tracking.video.frame_source import container_time, uneven
from tsuiseki.tracking.video.source import open_source

DROPPED = [n / 25 for n in range(40) if not 10 <= n < 15]


@pytest.fixture
def videos(data_folder: Path) -> Path:
    return data_folder / "cases" / "video"


def timed(stated: list[float], rate: float) -> list[float]:
    times: list[float] = []
    for time in stated:
        times.append(container_time(time, times, rate))
    return times


def test_rounding_is_undone_and_all_else_is_taken() -> None:
    assert timed([0.0, 0.033, 0.067, 0.1], 30) == [0, 1 / 30, 2 / 30, 3 / 30]
    assert timed([0.0, 0.04, 0.25, 0.3], 25) == [0, 1 / 25, 0.25, 0.3]
    # A container that has no time of a frame, or an impossible one.
    assert timed([0.0, 0.1, 0.1, float("nan"), -5.0, 0.55], 10) == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.55])


def test_uneven_times_are_found() -> None:
    assert uneven([]) == uneven([0.0]) == uneven([n / 30 for n in range(90)]) == {}
    assert uneven([round(n / 30, 3) for n in range(90)]) == {}
    assert uneven(DROPPED) == {"shortest_step": 0.04, "longest_step": 0.24, "missing": 5}


def test_what_went_by_is_noted() -> None:
    image = np.zeros((1, 1, 3), np.uint8)
    source = open_source([image] * 8, frame_rate=10.0)
    for number, time in ((3, 0.35), (4, 0.5)):
        assert source.noted(Frame(number, time, image)).index == number
    np.testing.assert_allclose(source.times_of(np.array([3, 4, 7])), [0.35, 0.5, 0.7])


@pytest.mark.integration
def test_dropped_frames_leave_a_gap_in_time(videos: Path) -> None:
    source = open_source(videos / "drop.avi")
    assert source.timed_by == "container"
    with pytest.warns(InputWarning, match=re.escape("0.04 to 0.24 s apart, about 5 are missing")):
        frames = list(source.frames())
    assert [frame.index for frame in frames] == list(range(35))
    assert [frame.time for frame in frames] == pytest.approx(DROPPED)
    even = open_source(videos / "drop.avi", frame_rate=10)
    assert [frame.time for frame in even.frames()] == [n / 10 for n in range(35)]
    assert [frame.time for frame in open_source(videos / "base.mp4").frames()] == [n / 25 for n in range(40)]


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("name", ["drop.avi", "base.mp4"])
def test_the_record_says_where_times_come_from(
    name: str, videos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["track", "blobs", str(videos / name), "--colour", "red", "--particles", "50", "--overlay"]
    assert main([*words, "--out", str(tmp_path / "o")]) == 0
    record = json.loads((tmp_path / "o" / "run.json").read_text())
    facts = record["facts"]["frame_times"][name]
    assert facts.pop("timed_by") == "container"
    if name == "base.mp4":
        assert facts == {}
        assert "time" not in record["frames"]
        return
    assert facts == uneven(DROPPED)
    assert record["frames"]["time"] == pytest.approx(DROPPED)
    assert capsys.readouterr().err.count("their times are the container's") == 1
