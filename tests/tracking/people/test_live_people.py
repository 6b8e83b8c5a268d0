"""A live run of people: readable while it is written, in parts by the hour, flat in memory, and never at an end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from tests.tracking.video.cameras import Hours, Sends, camera
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import AbsentCameraError, InputWarning, RequestError
from tsuiseki.tracking.people.api import follow_people
from tsuiseki.tracking.people.live_run import people_live
from tsuiseki.tracking.people.opening import OpenedPeople, open_people
from tsuiseki.tracking.people.settings import Linking, PeopleFinding
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.rolling import LiveOptions
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.live import CameraOutage, LiveEvent, PeopleInFrame
from tsuiseki.tracking.video import live
from tsuiseki.tracking.video.frame_source import Source

HOUR, DAY = 3600.0, 86_400.0


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of a simulated day come each minute."""
    monkeypatch.setattr(live, "PICTURE", 100.0)


def walker(image: ImageArray) -> np.ndarray:
    """Somebody who crosses in forty frames, then the next one; the first pixel says where."""
    left = 2.0 + int(image[0, 0, 0]) % 40
    return np.array([[left, 10, left + 12, 40, 0.9]])


def picture(number: int) -> ImageArray:
    return np.full((48, 64, 3), min(number % 50, 41), np.uint8)


def opened(source: Source, method: str = "sort", delay: float | None = None) -> OpenedPeople:
    finding = PeopleFinding(detector=lambda image: walker(image) if image[0, 0, 0] < 41 else np.empty((0, 5)),
                            appearance="none" if method == "flow" else None)  # fmt: skip
    return open_people(source, finding, Linking(method=method, delay=delay), 0)


def rows(out: Path) -> list[list[str]]:
    lines = [line for part in sorted(out.glob("*/tracks.csv")) for line in part.read_text().splitlines()[1:]]
    return [line.split(",") for line in lines]


def test_parts_follow_the_hours_and_each_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    source = camera([Sends(np.arange(0, 3 * HOUR, 30.0), picture)], rate=1 / 30, last=239)
    read: list[int] = []

    def observe(event: LiveEvent) -> None:
        if isinstance(event, PeopleInFrame) and event.frame.index % 100 == 50:
            newest = max(tmp_path.glob("out/*/tracks.csv"))
            with pytest.warns(InputWarning, match="the run goes on"):
                read.append(len(Result.load(newest.parent).tracks))

    people_live(Output(tmp_path / "out"), opened(source), watch=lambda _: nullcontext([observe]))
    parts = sorted(part.parent.name for part in tmp_path.glob("out/*/tracks.csv"))
    assert parts == ["1970-01-01T00-00Z", "1970-01-01T01-00Z"]
    assert len(read) == 2
    assert min(read) >= 1
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert (record["partial"], record["facts"]["cameras"][0]["frames"]) == (False, 240)
    assert list(record["results"]) == parts
    result = Result.load(tmp_path / "out" / parts[1])
    assert result.frame_rate == pytest.approx(1 / 30)
    numbers = [track.frames for track in result]
    assert min(map(min, numbers)) < 3
    assert max(map(max, numbers)) < 120


@pytest.mark.slow
def test_a_run_goes_on_where_it_was_and_gives_no_id_twice(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for begin in (0.0, 10_000.0):
        plan = [Sends(begin + np.arange(200.0), picture)]
        people_live(Output(out), opened(camera(plan, last=199, hours=Hours(begin))), 24.0)
        ids = {int(row[2]) for row in rows(out)}
        frames = [int(row[0]) for row in rows(out)]
    assert ids == {*range(1, 9)}
    assert frames == sorted(frames)
    # Its frames lie as far apart as its times.
    at = {int(row[0]): float(row[1]) for row in rows(out)}
    assert max(at) - min(at) == pytest.approx(at[max(at)] - at[min(at)], abs=2)
    (gap,) = (out / "outages.csv").read_text().splitlines()[1:]
    assert gap.startswith("the run,")
    with pytest.raises(RequestError, match="already holds"):
        people_live(Output(out, settings={"method": "other"}), opened(camera([], last=1)))
    people_live(Output(out, True, settings={"a": 1}), opened(camera([Sends(np.arange(9.0), picture)], last=8)))
    assert {int(row[2]) for row in rows(out)} <= {1}


def test_a_line_that_a_kill_cut_off_is_removed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    plan = [Sends(np.arange(200.0), picture)]
    people_live(Output(out), opened(camera(plan, last=99)), 24.0)
    (part,) = out.glob("*/tracks.csv")
    whole = part.read_text()
    part.write_text(whole + "101,100.0,7,3.5")
    people_live(Output(out), opened(camera([Sends(500 + np.arange(90.0), picture)], last=89, hours=Hours(500))), 24.0)
    assert part.read_text().startswith(whole)
    assert {len(row) for row in rows(out)} == {12}


def test_a_jump_of_the_clock_is_noted_and_waits_go_on(tmp_path: Path) -> None:
    hours = Hours()

    def image(number: int) -> ImageArray:
        hours.set_by = -7200.0 if number >= 50 else 0.0
        return picture(number)

    source = camera([Sends(100 * HOUR + np.arange(100.0), image)], last=99, hours=hours)
    hours.now = 100 * HOUR
    people_live(Output(tmp_path / "out"), opened(source))
    (line,) = (tmp_path / "out" / "outages.csv").read_text().splitlines()[1:]
    what, _, _, seconds = line.split(",")
    assert (what, float(seconds)) == ("the clock", pytest.approx(-7200, abs=2))
    assert [part.parent.name[-6:] for part in sorted(tmp_path.glob("out/*/tracks.csv"))] == ["02-00Z", "04-00Z"]


def test_outages_are_events_and_lines_of_the_result(tmp_path: Path) -> None:
    source = camera([Sends(np.arange(60.0), picture), Sends(400 + np.arange(200.0), picture)], last=120)
    events: list[LiveEvent] = []
    with pytest.warns(InputWarning, match="connecting again"):
        people_live(Output(tmp_path / "out"), opened(source), watch=lambda _: nullcontext([events.append]))
    away, back = (event for event in events if isinstance(event, CameraOutage))
    assert away.seconds is None
    assert back.seconds == pytest.approx(341, abs=40)
    (line,) = (tmp_path / "out" / "outages.csv").read_text().splitlines()[1:]
    assert line.startswith("door,")


def memory() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("method", "delay"), [("sort", None), ("flow", 1.0)])
def test_a_week_leaves_memory_as_it_was(
    method: str, delay: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A week with a cut each night, a picture each 2 or 10 minutes that stands for ten a second."""
    step = 120.0 if method == "sort" else 600.0
    monkeypatch.setattr(live, "PICTURE", 1.2 * step)
    week = [Sends(np.arange(day * DAY, (day + 0.98) * DAY, step), picture) for day in range(7)]
    source = camera([*week, Sends(np.arange(7 * DAY, 8 * DAY, step), picture)], rate=10.0)
    pages: list[int] = []

    class WeekIsOver(Exception):  # noqa: N818
        pass

    def observe(event: LiveEvent) -> None:
        if isinstance(event, PeopleInFrame) and event.time > (len(pages) + 1) * DAY:
            pages.append(memory())
            if len(pages) == 7:
                raise WeekIsOver

    with pytest.raises(WeekIsOver):
        people_live(Output(tmp_path / "out"), opened(source, method, delay), watch=lambda _: nullcontext([observe]))
    assert pages[-1] <= 1.05 * pages[0]
    assert len(list(tmp_path.glob("out/*/tracks.csv"))) >= 7 * 23
    assert len((tmp_path / "out" / "outages.csv").read_text().splitlines()) >= 7


def highest(out: Path) -> int:
    path = out / "live.json"
    return int(json.loads(path.read_text())["ids"]) if path.exists() else 0


SCRIPT = """
import sys, time
import numpy as np
from pathlib import Path
from tests.tracking.people.test_live_people import opened, picture
from tests.tracking.video.cameras import Hours, Sends, camera
from tsuiseki.tracking.people.live_run import people_live
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.rolling import LiveOptions

begin = time.time()
hours = Hours(begin)
def image(number):
    time.sleep(0.002)
    return picture(number)
plan = [Sends(begin + np.arange(100000.0) / 10, image)]
people_live(Output(Path(sys.argv[1])), opened(camera(plan, 10.0, hours=hours), "flow", 1.0))
"""


@pytest.mark.slow
@pytest.mark.paced
def test_after_a_kill_at_any_moment_the_same_command_goes_on(tmp_path: Path) -> None:
    out, before, promised = tmp_path / "out", set[int](), 0
    for seconds in (0.0, 0.03, 0.11):
        process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(out)])
        until = time.monotonic() + 120
        while highest(out) < promised + 2 and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(seconds)
        os.kill(process.pid, signal.SIGKILL)
        process.wait(60)
        promised = highest(out)
        now = {int(row[2]) for row in rows(out) if len(row) == 12 and row[2]}
        assert max(now) <= promised
        assert min(now - before) > max(before, default=0)
        before = now
    assert len(before) >= 3


def test_a_run_that_goes_on_waits_for_its_camera_and_one_that_begins_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "PAUSE", 0.001)
    answers: list[str | None] = [None, None, None, "there"]

    def open_camera() -> str:
        if (answer := answers.pop(0)) is None:
            raise AbsentCameraError("expected pictures from door, got none; is it connected, and free?")
        return answer

    with pytest.raises(AbsentCameraError):
        LiveOptions(roll=1.0).opened(tmp_path, open_camera)
    (tmp_path / "live.json").write_text("{}")
    with pytest.warns(InputWarning, match="free. The run goes on when it is back") as told:
        assert LiveOptions(roll=1.0).opened(tmp_path, open_camera) == "there"
    assert len(told) == 1
    answers[:] = [None] * 1000
    with pytest.warns(InputWarning), pytest.raises(AbsentCameraError):
        LiveOptions(roll=1.0, give_up=0.01).opened(tmp_path, open_camera)


def test_several_files_are_followed_each_by_itself(street: Path) -> None:
    def detector(_: ImageArray) -> np.ndarray:
        return np.array([[4.0, 4, 24, 54, 0.9]])

    alone = [people.ids.tolist() for _, people in follow_people(street, detector=detector, frames="1-8")]
    pairs = list(follow_people([street, str(street)], detector=detector, frames="1-8"))
    assert [(frame.index, frame.camera) for frame, _ in pairs] == [(n, k) for n in range(8) for k in (0, 1)]
    for camera_number in (0, 1):
        ours = [people.ids.tolist() for frame, people in pairs if frame.camera == camera_number]
        assert ours == alone


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--roll", "1", "--overlay"], "expected --roll without --overlay"),
        (["--give-up", "5"], "--give-up: expected a live source"),
        (["--roll", "1"], "expected a method that answers while it runs"),
        (["--roll", "-1", "--method", "sort"], "--roll"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(
    words: Sequence[str], said: str, street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", "people", str(street), "--out", str(tmp_path / "o"), *words]) == 2
    assert said in capsys.readouterr().err
