"""The command on four streams of one floor: its page, its events, and the same people after cuts."""

from __future__ import annotations

import json
import os
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import requests

from tests.tracking.events.test_camera_events import VALID
from tests.tracking.video.servers import Beginning, LabelReader, PlannedCamera, jpeg, numbered
from tsuiseki.tracking.cameras.camera_files import write_cameras
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.floor import live_run
from tsuiseki.tracking.report import page_server
from tsuiseki.tracking.report.local_page import token_of
from tsuiseki.tracking.types import Detections, ImageArray
from tsuiseki.tracking.video import live

from .conftest import LENGTH, RATE, World, boxes_of, make_world

CAMERAS, PEOPLE, DELAY = 4, 4, 2.0
# Seconds in which the second camera is away, within the delay, and in which all are, beyond the window of the flow.
ONE_AWAY, ALL_AWAY = (2.0, 3.0), (4.0, 8.5)
END = LENGTH / RATE + ALL_AWAY[1] - ALL_AWAY[0]
SCENE = """
unit: metres
scale: 0.01
lines: [{name: middle, from: [0, -6], to: [0, 6]}]
events: {counts: 5}
"""


@dataclass
class Visitor:
    """Somebody who looks at the page of a run meanwhile, and ends the run."""

    beginning: Beginning
    token: str
    ports: list[int] = field(default_factory=list)
    health: list[Any] = field(default_factory=list)
    answers: list[int] = field(default_factory=list)

    def wait(self, seconds: float) -> None:
        end = time.monotonic() + 60
        while self.beginning.seconds < seconds and time.monotonic() < end:
            time.sleep(0.02)

    def visit(self) -> None:
        try:
            for seconds in (3.8, 7.0):
                self.wait(seconds)
                base = f"http://127.0.0.1:{self.ports[0]}"
                self.health.append(requests.get(f"{base}/health", timeout=10).json())
                for path in ("", *(f"picture/{camera}" for camera in range(CAMERAS))):
                    self.answers.append(requests.get(f"{base}/{self.token}/{path}", timeout=10).status_code)
            self.wait(END)
        finally:
            os.kill(os.getpid(), signal.SIGINT)


@dataclass
class LabelDetector:
    reader: LabelReader

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        return [Detections(rows[:, :4], rows[:, 4]) for rows in map(self.reader, images)]


def reader_of(world: World) -> LabelReader:
    steps = [np.flatnonzero(np.isclose(world.truth.times, t / RATE)) for t in range(LENGTH)]
    ids = [world.truth.ids[rows] for rows in steps]
    boxes = [[boxes_of(feed.placed.camera, world.truth.places[rows]) for rows in steps] for feed in world.feeds]
    return LabelReader(boxes, [ids] * len(world.feeds))


@pytest.fixture
def place(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[World, list[PlannedCamera]]]:
    monkeypatch.setattr(live, "PAUSE", 0.1)
    monkeypatch.setattr(live, "LONGEST_PAUSE", 0.2)
    whole = make_world(3, people=PEOPLE)
    world, beginning, servers = World(whole.feeds[:CAMERAS], whole.truth), Beginning(CAMERAS), []
    for number, feed in enumerate(world.feeds):
        lens = feed.placed.camera
        blank = np.zeros((lens.height, lens.width, 3), np.uint8)
        pictures = [jpeg(numbered(blank, frame, number)) for frame in range(LENGTH)]

        def shows(seconds: float, number: int = number, pictures: list[bytes] = pictures) -> bytes | None:
            if ALL_AWAY[0] <= seconds < ALL_AWAY[1] or (number == 1 and ONE_AWAY[0] <= seconds < ONE_AWAY[1]):
                return None
            # Nobody walks on while nobody looks.
            shown = seconds - (ALL_AWAY[1] - ALL_AWAY[0] if seconds >= ALL_AWAY[1] else 0.0)
            return pictures[min(int(shown * RATE), LENGTH - 1)]

        servers.append(PlannedCamera(beginning, shows, RATE))
    reader: Any = reader_of(world)
    monkeypatch.setattr(live_run, "as_detector", lambda *_, **__: LabelDetector(reader))
    monkeypatch.setattr(live_run, "as_describer", lambda *_, **__: reader)
    yield world, servers
    for server in servers:
        server.close()


@pytest.mark.slow
@pytest.mark.paced
@pytest.mark.filterwarnings("ignore")
def test_a_floor_of_streams_has_a_page_and_events_and_its_people_keep_their_ids(
    place: tuple[World, list[PlannedCamera]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    world, servers = place
    out, file = tmp_path / "o", tmp_path / "events.jsonl"
    (tmp_path / "scene.yaml").write_text(SCENE)
    write_cameras(tmp_path / "cameras.yaml", [feed.placed for feed in world.feeds])
    visitor, opened = Visitor(servers[0].beginning, token_of(out)), page_server.listening

    def noting(port: int) -> Any:
        opened_here = opened(port)
        visitor.ports.append(opened_here.getsockname()[1])
        return opened_here

    monkeypatch.setattr(page_server, "listening", noting)
    taken = socket.create_server(("127.0.0.1", 0))
    busy = taken.getsockname()[1]
    words = ["track", "floor", *(server.address for server in servers), "--cameras", str(tmp_path / "cameras.yaml")]
    words += [
        "--delay",
        str(DELAY),
        "--page",
        str(busy),
        "--events",
        str(file),
        "--scene",
        str(tmp_path / "scene.yaml"),
    ]
    guest = threading.Thread(target=visitor.visit, daemon=True)
    guest.start()
    assert main([*words, "--out", str(out)]) == 0
    guest.join(20)
    told = capsys.readouterr()
    assert told.out == f"{PEOPLE} people on the floor: {out}\n"
    taken.close()
    assert told.err.count(f"note: port {busy} is in use; the live page has another one") == 1
    assert told.err.count("connecting again until it is back") == 1 + CAMERAS
    assert {*visitor.answers} == {200}
    some, none = visitor.health
    assert (some["status"], none["status"]) == ("ok", "degraded")
    assert [camera["outages"] for camera in some["cameras"]] == [0, 1, 0, 0]
    assert [camera["people"] for camera in some["cameras"]] == [PEOPLE] * CAMERAS
    assert all(camera["away"] for camera in none["cameras"])
    rows = [line.split(",") for part in out.glob("*/world.csv") for line in part.read_text().splitlines()[1:]]
    # Over the gap of one camera by the others, and over that of all by appearance.
    assert {row[2] for row in rows} == {"1", "2", "3", "4"}
    events = [json.loads(line) for line in file.read_text().splitlines()]
    for event in events:
        VALID.validate(event)
    assert len({event["id"] for event in events}) == len(events)
    kinds = Counter(event["type"].removeprefix("tsuiseki.") for event in events)
    assert (kinds["appeared"], kinds["camera_lost"], kinds["camera_back"]) == (PEOPLE, 1 + CAMERAS, 1 + CAMERAS)
    lost = [event["data"]["seconds"] for event in events if event["type"].endswith("camera_lost")]
    assert lost[1:] == pytest.approx([ALL_AWAY[0]] * CAMERAS, abs=1)
    ends = [world.truth.places[world.truth.ids == person][[0, -1], 0] for person in range(1, PEOPLE + 1)]
    assert kinds["crossed"] == sum(first * last < 0 for first, last in ends)
