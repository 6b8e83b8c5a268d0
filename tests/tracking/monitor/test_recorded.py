"""One source that is watched: when its frames came, its outages, and its people at the end."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tracking.monitor.test_board import NOISE, people_in
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.monitor.recorded import Recorded
from tsuiseki.tracking.monitor.watching import Watching
from tsuiseki.tracking.types import Frame, Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.live import CameraOutage, PeopleInFrame, PeopleOnFloor
from tsuiseki.tracking.video.live import LiveSource
from tsuiseki.tracking.video.source import open_source

BOX = [20, 30, 40, 90]


def watched(source: Any, while_it_runs: bool = True) -> tuple[Recorded, list[Any]]:
    happenings = list[Any]()
    return Recorded(source, [happenings.append], while_it_runs), happenings


def test_frames_of_a_camera_have_the_time_at_which_they_came_and_its_gaps_are_outages() -> None:
    source = LiveSource(name="gate", address="0", frames_wanted=FrameRange())
    recorded, happenings = watched(source)
    for frame in recorded.frames(Frame(n, n / 10, NOISE) for n in range(4)):
        if frame.index == 2:
            source.gaps.append({"after_frame": 2, "seconds": 7.5})
        recorded.people(people_in(frame.index, BOX))
    kinds = [type(happening) for happening in happenings]
    assert kinds == [PeopleInFrame, PeopleInFrame, CameraOutage, CameraOutage, PeopleInFrame, PeopleInFrame]
    assert [happening.seconds for happening in happenings[2:4]] == [None, 7.5]
    assert happenings[3].time - happenings[2].time == pytest.approx(7.5)
    assert happenings[-1].time == pytest.approx(time.time(), abs=5)


def test_frames_of_a_recording_have_its_own_time_and_wait_for_their_people() -> None:
    recorded, happenings = watched(open_source([NOISE] * 4, frame_rate=10))
    for frame in recorded.frames(Frame(n, n / 10, NOISE) for n in range(4)):
        if frame.index >= 2:
            recorded.people(people_in(frame.index - 2, BOX))
    assert [(happening.time, happening.frame.index) for happening in happenings] == [(0.0, 0), (0.1, 1)]
    recorded.rest([Track(5, np.arange(4), np.array([BOX] * 4), np.ones(4))], range(4))
    assert [happening.people.ids.tolist() for happening in happenings] == [[1], [1], [5], [5]]


def test_a_method_that_decides_at_the_end_keeps_no_pictures() -> None:
    recorded, happenings = watched(open_source([NOISE] * 3, frame_rate=10), False)
    assert len(list(recorded.frames(Frame(n, n / 10, NOISE) for n in range(3)))) == 3
    recorded.rest([Track(1, np.array([1]), np.array([BOX]), np.ones(1))], range(3))
    assert [len(happening.people) for happening in happenings] == [0, 1, 0]
    assert not any(happening.frame.image.any() for happening in happenings)


def test_a_floor_is_watched_by_a_scene_in_metres(tmp_path: Path) -> None:
    scene, file = tmp_path / "scene.yaml", tmp_path / "events.jsonl"
    watching = Watching(events=str(file), scene=scene)
    scene.write_text("size: [64, 48]\nlines: [{name: gate, from: [2, 0], to: [2, 3]}]\n")
    source = open_source([NOISE] * 3, frame_rate=10)
    with (
        pytest.raises(RequestError, match="floor needs a scale"),
        watching.observers(tmp_path, [source], on_floor=True),
    ):
        pass
    scene.write_text("unit: metres\nscale: 0.01\nlines: [{name: gate, from: [2, 0], to: [2, 3]}]\n")
    none = np.empty(0)
    with watching.observers(tmp_path, [source, source], on_floor=True) as observers:
        for t in range(40):
            place = np.array([[0.1 * t, 1.0]])
            for observe in observers:
                observe(
                    PeopleOnFloor(
                        t / 10, t, np.array([3]), place, none, none, np.ones(1), np.ones((1, 2), bool), (), ()
                    )
                )
    events = [json.loads(line) for line in file.read_text().splitlines()]
    (crossed,) = (event for event in events if event["type"] == "tsuiseki.crossed")
    assert (crossed["source"], crossed["data"]["line"], crossed["data"]["metres"]) == ("floor", "gate", [2.4, 1.0])


def test_recorded_cameras_of_a_floor_are_not_watched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", "floor", "a.mp4", "b.mp4", "--events", "-", "--out", str(tmp_path / "o")]) == 2
    assert "expected live cameras, or --roll, with --events" in capsys.readouterr().err
