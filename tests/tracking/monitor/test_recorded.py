"""One source that is watched: when its frames came, its outages, and its people at the end."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from tests.tracking.monitor.test_board import NOISE, people_in
from tsuiseki.tracking.monitor.recorded import Recorded
from tsuiseki.tracking.types import Frame, Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.live import CameraOutage, PeopleInFrame
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
