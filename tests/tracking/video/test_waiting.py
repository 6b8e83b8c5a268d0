"""A camera that is away is waited for as long as it takes, by a clock that nobody sets."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.types.live import CameraOutage
from tsuiseki.tracking.video.live import LONGEST_PAUSE, SKIPPED, LiveSource
from tsuiseki.tracking.video.several import Arrival, SeveralSources, check_different, open_several
from tsuiseki.tracking.video.source import is_live

from .cameras import Hours, Sends, camera

DAY = 86_400.0


def span(start: float, count: int, rate: float = 1.0) -> np.ndarray:
    return start + np.arange(count) / rate


def test_a_camera_that_is_away_for_three_days_is_waited_for_in_one_line_with_growing_pauses() -> None:
    source = camera([Sends(span(0, 5)), Sends(span(3 * DAY, 100))])
    frames = source.numbered()
    with pytest.warns(InputWarning) as told:
        times = [next(frames).time for _ in range(10)]
    assert [str(line.message) for line in told] == ["door: no picture after frame 5, connecting again until it is back"]
    np.testing.assert_allclose(np.diff(times)[4], 3 * DAY - 4, atol=LONGEST_PAUSE + 10)
    slept = source.hours.slept
    assert slept[:7] == [0.5, 1, 2, 4, 8, 16, 30]
    assert all(a <= b <= LONGEST_PAUSE for a, b in pairwise(slept))
    assert source.gaps == [{"after_frame": 5, "seconds": pytest.approx(times[5] - times[4], abs=1e-3)}]
    assert (source.state.frames, source.state.outages, source.state.away) == (10, 1, False)


def test_a_camera_is_given_up_after_as_long_as_was_said() -> None:
    source = camera([Sends(span(0, 5))], give_up=100.0)
    with pytest.warns(InputWarning, match="for up to 100 s"), pytest.raises(RunError, match="none within 100 s"):
        list(source.numbered())
    assert 100 <= source.hours.now - 4 <= 100 + 10


def test_numbers_count_dropped_pictures_and_a_gap_up_to_a_bound() -> None:
    plan = [Sends(span(0, 4)), Sends(span(20, 30)), Sends(span(5000, 300))]
    frames = camera(plan).numbered()
    with pytest.warns(InputWarning):
        numbers = np.array([next(frames).index for _ in range(80)])
    # Each gap counts as its seconds at the usual rate, and no more than `SKIPPED`.
    jumps = np.diff(numbers)[np.diff(numbers) > 1]
    assert jumps.tolist() == [SKIPPED, SKIPPED]


@pytest.mark.parametrize(
    ("size", "what"), [((96, 128), "are scaled to them"), ((64, 48), "are not of the same view: it is waited for")]
)
def test_a_stream_of_another_size_after_a_restart_is_told_in_a_line(size: tuple[int, int], what: str) -> None:
    other = Sends(span(60, 200), lambda _: np.full((*size, 3), 200, np.uint8))
    frames = camera([Sends(span(0, 3)), other, Sends(span(3600, 300))]).numbered()
    with pytest.warns(InputWarning) as told:
        shapes = [next(frames).image.shape[:2] for _ in range(6)]
    assert shapes == [(48, 64)] * 6
    assert sum(f"got {size[1]}x{size[0]}, which {what}" in str(line.message) for line in told) == 1


def test_an_outage_is_an_event_of_its_own_and_waiting_does_not_go_by_the_time_of_day() -> None:
    hours = Hours()

    def image(number: int) -> np.ndarray:
        hours.set_by = -5000.0 if number > 2 else 1e9
        return np.zeros((48, 64, 3), np.uint8)

    source = camera([Sends(span(0, 5), image), Sends(span(40, 100), image)], hours=hours, last=16)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        events = [event for batch in SeveralSources([source]).batches() for event in batch]
    outages = [event for event in events if isinstance(event, CameraOutage)]
    assert [event.seconds is None for event in outages] == [True, False]
    assert outages[1].seconds == pytest.approx(37, abs=5)
    times = [event.frame.time for event in events if isinstance(event, Arrival)]
    assert times == sorted(times)
    assert times[-1] < 60


def test_one_camera_twice_is_refused() -> None:
    source = camera([Sends(span(0, 3))], address="rtsp://door/1")
    with pytest.raises(RequestError, match="expected different cameras, got rtsp://door/1 twice"):
        check_different([source, source])


@pytest.mark.parametrize(
    ("address", "name", "bare", "stream"),
    [
        ("http://127.0.0.1:1/door?key=1#stream=2", "http://127.0.0.1:1/door", "http://127.0.0.1:1/door?key=1", 2),
        ("http://127.0.0.1:1/door?key=1", "http://127.0.0.1:1/door", "http://127.0.0.1:1/door?key=1", 1),
        ("77", "webcam 77", "77", 1),
    ],
)
def test_a_camera_that_is_not_there_yet_keeps_its_name_address_and_stream(
    address: str, name: str, bare: str, stream: int, street: Path
) -> None:
    with pytest.warns(InputWarning, match=f"{name} is not there yet, it is waited for"):
        _, source = open_several([street, address])
    assert isinstance(source, LiveSource)
    assert (source.name, source.address, source.stream, source.awaited) == (name, bare, stream, True)
    check_different([source, replace(source, stream=stream + 1)])


def test_a_number_too_long_for_a_webcam_is_none(street: Path) -> None:
    assert is_live("123456789")
    assert not is_live("1234567890")
    with pytest.raises(RequestError, match="a webcam number or an address, found no 1234567890"):
        open_several([street, "1234567890"])
