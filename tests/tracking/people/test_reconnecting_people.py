"""A camera of a street that is cut for a while, and the same people before and after."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.tracking.conftest import Inputs
from tests.tracking.video.servers import Beginning, LabelReader, PlannedCamera, jpeg, number_of, numbered
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.people.live_run import people_live
from tsuiseki.tracking.people.opening import open_people
from tsuiseki.tracking.people.settings import Linking, PeopleFinding
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.live import CameraOutage, LiveEvent, PeopleInFrame
from tsuiseki.tracking.video import live
from tsuiseki.tracking.video.source import open_source

RATE, LENGTH, DELAY = 8.0, 12.0, 2.0
# Seconds without pictures: within the delay, and beyond it.
GAPS = ((3.0, 4.0), (7.0, 10.0))


@dataclass(frozen=True)
class Street:
    reader: LabelReader
    pictures: dict[int, bytes]

    def shows(self, seconds: float) -> bytes | None:
        return self.pictures.get(min(int(seconds * RATE), round(LENGTH * RATE) - 1))


@pytest.fixture(scope="module")
def walked() -> Street:
    """Five people on a street; nobody is drawn while the camera is away."""
    count = round(LENGTH * RATE)
    settings = StreetSettings(
        frames=count, people=5, occluders=0, width=320, height=240, frame_rate=RATE, samples=1
    )  # fmt: skip
    clip, pictures, boxes, ids = StreetClip(settings, 1), dict[int, bytes](), [], []
    for frame in range(count):
        away = any(start <= frame / RATE < end for start, end in GAPS)
        if not away:
            (image,), truth = clip.draw_frame(frame)
            pictures[frame] = jpeg(numbered(image, frame))
        visible = np.zeros(0, bool) if away else truth.visibility > 0.3
        boxes.append(np.empty((0, 4)) if away else truth.boxes[visible])
        ids.append(np.empty(0, int) if away else truth.ids[visible])
    return Street(LabelReader([boxes], [ids]), pictures)


@pytest.fixture
def server(walked: Street, monkeypatch: pytest.MonkeyPatch) -> Iterator[PlannedCamera]:
    monkeypatch.setattr(live, "PAUSE", 0.1)
    monkeypatch.setattr(live, "LONGEST_PAUSE", 0.2)
    camera = PlannedCamera(Beginning(1), walked.shows, RATE)
    yield camera
    camera.close()


@pytest.mark.slow
@pytest.mark.paced
@pytest.mark.filterwarnings("ignore")
def test_people_keep_their_ids_over_a_gap_within_the_delay_and_by_appearance_over_a_longer_one(
    walked: Street, server: PlannedCamera, tmp_path: Path
) -> None:
    source = open_source(server.address, FrameRange(0, round(LENGTH * RATE) - 1), RATE)
    finding = PeopleFinding(detector=walked.reader, appearance=walked.reader)
    opened = open_people(source, finding, Linking(method="flow", delay=DELAY), 0)
    events: list[LiveEvent] = []
    people_live(Output(tmp_path / "out"), opened, watch=lambda _: nullcontext([events.append]))
    back = [event.seconds for event in events if isinstance(event, CameraOutage) and event.seconds is not None]
    assert len(back) == 2
    assert back[0] < DELAY < back[1]
    parts: list[dict[int, set[int]]] = [{}, {}, {}]
    for event in events:
        if isinstance(event, PeopleInFrame):
            image, seen = event.frame.image, event.people.select(event.people.status == "tracking")
            part = parts[sum(number_of(image)[0] / RATE >= end for _, end in GAPS)]
            people = walked.reader.nearest(image, seen.boxes) if len(seen) else ()
            for person, number in zip(people, seen.ids, strict=True):
                part.setdefault(int(person), set()).add(int(number))
    for before, after in pairwise(parts):
        both = before.keys() & after.keys()
        assert len(both) >= 3
        assert {person: before[person] for person in both} == {person: after[person] for person in both}
        assert all(len(before[person]) == 1 for person in both)


def rows_of(out: Path) -> list[list[str]]:
    """Whole rows of all parts."""
    lines = [line for part in sorted(out.glob("*/tracks.csv")) for line in part.read_text().split("\n")[1:-1]]
    return [line.split(",") for line in lines]


# The command, and a note of each picture that is worked on.
COMMAND = """
import sys
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.people.several import FollowedCamera
push = FollowedCamera.push
def noting(camera, arrival, detections):
    with open(sys.argv[1], "a") as file:
        file.write(f"{arrival.time:.3f}\\n")
    return push(camera, arrival, detections)
FollowedCamera.push = noting
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.slow
@pytest.mark.paced
def test_the_command_goes_on_after_three_kills_and_loses_at_most_the_delay(inputs: Inputs, tmp_path: Path) -> None:
    """Killed at first, in the middle, and while the camera is away; somebody stands before it all the time."""
    picture = jpeg(np.full((48, 64, 3), 120, np.uint8))
    camera = PlannedCamera(Beginning(1), lambda seconds: None if 3.0 < seconds % 6.0 < 5.0 else picture, RATE)
    out, file, seen = tmp_path / "out", tmp_path / "events.jsonl", tmp_path / "seen"
    words = ["--method", "flow", "--delay", "1", "--fps", "8", "--roll", "1", "--out", str(out), "--events", str(file)]
    words += ["--detector", str(inputs.detector), "--appearance", "none", "--affinity", "none"]
    command = [sys.executable, "-W", "ignore", "-c", COMMAND, str(seen), "track", "people", camera.address, *words]
    highest = 0
    for moment, more in (("first", 1), ("middle", 12), ("away", 12), ("end", 1)):
        before, end = len(rows_of(out)), time.monotonic() + 100
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            while len(rows_of(out)) < before + more or (camera.shown is None) != (moment == "away"):
                assert time.monotonic() < end
                assert process.poll() is None
                time.sleep(0.02)
            process.send_signal(signal.SIGINT if moment == "end" else signal.SIGKILL)
        rows = rows_of(out)[before:]
        worked_on = np.array(seen.read_text().split(), dtype=float)
        # A second of delay, and the picture that was being worked on.
        assert (worked_on > float(rows[-1][1])).sum() <= RATE + 1
        ids = {int(row[2]) for row in rows}
        assert min(ids) > highest
        highest = max(ids)
    camera.close()
    assert process.returncode == 0
    assert [line.split(",")[0] for line in (out / "outages.csv").read_text().splitlines()].count("the run") == 3
    events = [json.loads(line) for line in file.read_text().splitlines()]
    assert len({event["id"] for event in events}) == len(events)
    appeared = [event["data"]["person"] for event in events if event["type"] == "tsuiseki.appeared"]
    assert len(appeared) == len(set(appeared))
    rows = rows_of(out)
    assert set(appeared) <= {int(row[2]) for row in rows}
    # A kill may come between the rows of pictures that are answered together, two here, and their events.
    assert len({row[1] for row in rows if int(row[2]) not in appeared}) <= 3 * 2
