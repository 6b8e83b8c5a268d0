"""A result is a sequence of tracks that writes itself."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_tracks, write_tracks
from tsuiseki.tracking.result import Result, StageTimes
from tsuiseki.tracking.types import Track


def track(number: int) -> Track:
    frames = np.arange(3)
    boxes = np.tile([1.0, 2.0, 11.0, 22.0], (3, 1)) + number
    return Track(number, frames, boxes, np.full(3, 0.5), np.ones(3, dtype=np.bool_))


@pytest.fixture
def result() -> Result[Track]:
    tracks = [track(3), track(8)]
    return Result(
        tracks,
        source="street",
        frame_rate=25.0,
        settings={"seed": 4},
        facts={"camera": "stands still"},
        frames={"frame": [1, 2, 3]},
        files={
            "tracks.txt": lambda path, _: write_tracks(path, tracks),
            "page.html": lambda path, folder: path.write_text(str(sorted(p.name for p in folder.glob("*.txt")))),
        },
    )


def test_a_result_is_a_sequence_of_tracks(result: Result[Track]) -> None:
    assert [one.id for one in result] == [3, 8]
    assert (len(result), result[1].id, [one.id for one in result[:1]]) == (2, 8, [3])
    assert result.by_id[8] is result[1]
    assert repr(result) == "<Result: 2 tracks in street>"


def test_it_writes_its_files_and_the_record(result: Result[Track], tmp_path: Path) -> None:
    folder = result.save(tmp_path / "out")
    assert [one.id for one in read_tracks(folder / "tracks.txt")] == [3, 8]
    assert (folder / "page.html").read_text() == "['tracks.txt']"
    record = json.loads((folder / "run.json").read_text())
    assert record["seed"] == 4
    assert record["facts"] == {"camera": "stands still"}
    assert record["files"] == ["page.html", "tracks.txt"]


def test_an_earlier_result_stays_unless_it_is_asked_for(result: Result[Track], tmp_path: Path) -> None:
    result.save(tmp_path / "out")
    with pytest.raises(RequestError, match="already holds"):
        result.save(tmp_path / "out")
    result.save(tmp_path / "out", overwrite=True)


def test_stages_of_several_threads_take_no_longer_than_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    now, thread, times = [0.0], [1], StageTimes()
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    monkeypatch.setattr("threading.get_ident", lambda: thread[0])

    def at(second: float, of: int) -> None:
        now[0], thread[0] = second, of

    with times.measure("detect"):
        at(1, 2)
        with times.measure("decode"):
            at(3, 2)
        at(4, 1)
        # What is measured within a stage counts once.
        with times.measure("describe"):
            at(6, 1)
    # What nobody measures is left out.
    at(9, 1)
    with times.measure("link"):
        at(10, 1)
    assert times.seconds == {"detect": 3.0, "decode": 1.0, "describe": 2.0, "link": 1.0}
