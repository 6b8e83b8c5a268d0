"""Files of a recorder that follow each other, with gaps and overlaps, are tracked as one video."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.batch.continuous import in_order, start_of
from tsuiseki.tracking.batch.jobs import Job
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.people import whole_flow
from tsuiseki.tracking.people.flow import FlowSettings, FlowTracker
from tsuiseki.tracking.types import Detections

RATE = 10.0
CONTINUOUS = ["batch", "track", "people"]


def record(path: Path, first: int, last: int) -> None:
    """Frames of one long recording whose people walk on through all of its files."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE, (80, 48))
    for number in range(first, last):
        writer.write(np.full((48, 80, 3), 60 + number, np.uint8))
    writer.release()


def boxes_at(number: int) -> str:
    """Two people, of whom one comes from the right in the second file."""
    people = [(2 + 0.5 * number, 4)] + ([(70 - 0.5 * (number - 32), 26)] if number >= 32 else [])
    return "".join(f"{{frame}},-1,{x},{y},8,18,0.9\n" for x, y in people)


def write_detections(path: Path, first: int, last: int) -> None:
    path.write_text("".join(boxes_at(n).replace("{frame}", str(n - first + 1)) for n in range(first, last)))


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """Of 60 frames the second file repeats the last second of the first, and the third begins half a second late."""
    folder = tmp_path / "recorder"
    folder.mkdir()
    for second, first, last in ((0, 0, 30), (2, 20, 45), (5, 50, 60)):
        record(folder / f"cam_20260101-00000{second}.avi", first, last)
        write_detections(folder / f"cam_20260101-00000{second}.txt", first, last)
    return folder


def tracks_of(folder: Path) -> dict[int, tuple[int, int]]:
    return {track.id: (int(track.frames[0]), int(track.frames[-1])) for track in read_tracks(folder / "tracks.txt")}


@pytest.mark.slow
def test_ids_go_on_over_gaps_and_overlaps(recorded: Path, tmp_path: Path, here: Any) -> None:
    words = [*CONTINUOUS, str(recorded), "--continuous", "--detections", str(recorded / "{name}.txt")]
    words += ["--segment", "1", "--out", str(tmp_path / "o")]
    assert main(words) == 0
    assert here.kinds().count("join") == 1
    first, second, third = (tmp_path / "o" / path.stem for path in sorted(recorded.glob("*.avi")))
    assert tracks_of(first) == {1: (0, 29)}
    # What the first file has shown is not tracked again.
    assert tracks_of(second) == {1: (10, 24), 2: (12, 24)}
    assert tracks_of(third) == {1: (0, 9), 2: (0, 9)}
    here.tasks.clear()
    assert main(words) == 0
    assert here.kinds() == ["begin"] * 3
    (second / "run.json").unlink()
    assert main(words) == 0
    assert tracks_of(second) == {1: (10, 24), 2: (12, 24)}


@pytest.mark.slow
def test_files_without_times_follow_each_other(recorded: Path, tmp_path: Path, here: Any) -> None:
    table = tmp_path / "list.csv"
    one = recorded / "cam_20260101-000000"
    for name, first, last in (("a", 0, 30), ("b", 30, 60)):
        record(tmp_path / f"{name}.avi", first, last)
        write_detections(tmp_path / f"{name}.txt", first, last)
    table.write_text("source\na.avi\nb.avi\n")
    words = ["--continuous", "--detections", str(tmp_path / "{name}.txt"), "--out", str(tmp_path / "o")]
    assert main([*CONTINUOUS, str(table), *words]) == 0
    assert tracks_of(tmp_path / "o/b") == {1: (0, 29), 2: (2, 29)}
    assert one.with_suffix(".avi").exists()
    assert here.kinds().count("finish") == 2


@pytest.mark.parametrize("name", ["x_20260131_235958.mp4", "2026-01-31T23-59-58.mkv", "gate 2026-01-31 23.59.58.avi"])
def test_times_in_names(name: str) -> None:
    assert start_of(Job((), f"folder/{name}", "x")) == 1769903998.0


def test_wrong_times_are_refused() -> None:
    assert start_of(Job((), "x_20261399_235958.mp4", "x")) is None
    with pytest.raises(RequestError, match="got none of b; give a manifest with a column `start`"):
        in_order([Job((), "a_20260131_235958.mp4", "a"), Job((), "b.mp4", "b")])


def test_only_people_follow_each_other(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["batch", "track", "animals", str(recorded), "--continuous", "--out", str(tmp_path / "o")]
    assert main(words) == 2
    assert "`continuous`" not in capsys.readouterr().err


@pytest.mark.slow
def test_windows_whose_borders_are_proved_give_the_ids_of_the_whole_solve(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three minutes of people who come and go: what is finished on the way is what one solution of the whole says."""
    monkeypatch.setattr(whole_flow, "RELEASE", 30.0)
    whole, windows = (FlowTracker(FlowSettings(decide_every=every), frame_rate=4.0) for every in (None, 20.0))
    rng = np.random.default_rng(0)
    for number in range(720):
        # Someone comes every four seconds, and crosses the picture in 20.
        walked = (number - 16 * np.arange(number // 16 + 1)) / 80
        left, top = 640 * walked[walked < 1], 40.0 * (np.flatnonzero(walked < 1) % 7)
        seen = rng.random(len(left)) > 0.1
        boxes = np.stack([left, top, left + 20, top + 60], axis=1)[seen] + rng.normal(0, 1, (int(seen.sum()), 4))
        for tracker in (whole, windows):
            tracker.update(Detections(boxes, np.full(len(boxes), 0.9)))
    expected, found = whole.tracks(), windows.tracks()
    assert windows.facts()["exact"]
    assert windows.facts()["tracks_finished_early"] > 20
    assert [(t.id, t.frames.tolist()) for t in found] == [(t.id, t.frames.tolist()) for t in expected]
