"""Events reach their receiver: whatever it, the disk and the process do, none is lost, and doubles have the same id."""

from __future__ import annotations

import gc
import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import psutil
import pytest

from tests.tracking.events.test_camera_events import IMAGE
from tests.tracking.runs.test_full_disk import files_of_at_most
from tsuiseki.tracking.counts.scene import EventIntervals, Scene, SceneLine
from tsuiseki.tracking.events import delivery as delivery_module
from tsuiseki.tracking.events import spool as spool_module
from tsuiseki.tracking.events.delivery import Delivery
from tsuiseki.tracking.events.event import Event
from tsuiseki.tracking.events.observer import EventMaker
from tsuiseki.tracking.events.receivers import Http, LinesInFile
from tsuiseki.tracking.events.spool import Spool
from tsuiseki.tracking.types import Frame, Targets
from tsuiseki.tracking.types.live import PeopleInFrame

WAIT = 20.0


@pytest.fixture(autouse=True)
def _short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delivery_module, "PAUSE", 0.005)
    monkeypatch.setattr(delivery_module, "LONGEST_PAUSE", 0.02)
    monkeypatch.setattr(spool_module, "AGAIN", 0.05)


def event(number: int) -> Event:
    return Event(f"run-{number}", "gate", "camera_back", {"gap": float(number)})


class Server:
    """Takes events by HTTP on a port that stays the same; it may be stopped, started and told to refuse.

    Attributes:
        received: every id that came in a request that it read, in order.
        status: of its answers; 0 for none, after the events are taken.
    """

    def __init__(self) -> None:
        self.received: list[str] = []
        self.status = 204
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = int(free.getsockname()[1])
        self.address = f"http://127.0.0.1:{self.port}/events"
        self._running: ThreadingHTTPServer | None = None

    def start(self) -> None:
        taken = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                assert self.headers["Content-Type"] == "application/x-ndjson"
                if taken.status < 400:
                    taken.received += [json.loads(line)["id"] for line in body.splitlines()]
                if not taken.status:
                    self.connection.close()
                    return
                self.send_response(taken.status)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        ThreadingHTTPServer.allow_reuse_address = True
        self._running = ThreadingHTTPServer(("127.0.0.1", self.port), Handler)
        self._running.handle_error = lambda *_: None  # type: ignore[method-assign]
        threading.Thread(target=self._running.serve_forever, args=(0.01,), daemon=True).start()

    def stop(self) -> None:
        if self._running is not None:
            self._running.shutdown()
            self._running.server_close()


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.stop()


@contextmanager
def delivering(receiver: object, spool: Path, lines: list[str] | None = None) -> Iterator[Delivery]:
    delivery = Delivery(receiver, spool, lambda: "dropped-1", (lines if lines is not None else []).append, goodbye=WAIT)  # type: ignore[arg-type]
    yield delivery
    delivery.close()


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_a_receiver_that_is_started_again_ten_times_gets_every_event(server: Server, tmp_path: Path) -> None:
    lines, number = list[str](), 0
    with delivering(Http(server.address), tmp_path / "spool", lines) as delivery:
        for restart in range(10):
            for _ in range(50):
                number += 1
                delivery.put([event(number)])
            server.status = (204, 0, 503)[restart % 3]
            server.start()
            if server.status == 204:
                wait_for(lambda: len(delivery.spool) == 0)
            else:
                time.sleep(0.05)
            server.stop()
        server.status = 200
        server.start()
    assert list(dict.fromkeys(server.received)) == [f"run-{n + 1}" for n in range(number)]
    assert len(server.received) > number  # some answers were lost, and their events came again
    assert not (tmp_path / "spool").exists()
    assert [line for line in lines if "does not take events" in line]
    assert "again" in lines[-1]


@pytest.mark.parametrize(("status", "words"), [(403, "403 Forbidden"), (302, "302 Found"), (500, "500 Internal")])
def test_a_receiver_that_refuses_is_one_line_and_events_wait(
    status: int, words: str, server: Server, tmp_path: Path
) -> None:
    lines = list[str]()
    server.status = status
    server.start()
    delivery = Delivery(Http(server.address), tmp_path / "spool", lambda: "d", lines.append, goodbye=0.3)
    for number in range(500):
        delivery.put([event(number)])
    delivery.close()
    if status == 302:
        assert set(server.received) == {event(n).id for n in range(200)}
    assert len(lines) == 2
    assert words in lines[0]
    assert lines[0].endswith("they wait")
    assert lines[1].endswith("; the same command sends them")
    assert "500 events" in lines[1]
    server.status = 204
    with delivering(Http(server.address), tmp_path / "spool"):
        pass
    assert set(server.received) == {event(n).id for n in range(500)}


WRITER = """
import sys
from pathlib import Path
from tsuiseki.tracking.events.delivery import Delivery
from tsuiseki.tracking.events.event import Event
from tsuiseki.tracking.events.receivers import Http
delivery = Delivery(Http(sys.argv[1]), Path(sys.argv[2]), lambda: "dropped", print)
for number in range(10**6):
    delivery.put([Event(f"run-{number}", "gate", "camera_back", {"gap": 1.0})])
    print(number, flush=True)
"""


def test_after_a_kill_the_spool_goes_on_and_nothing_that_was_put_is_lost(server: Server, tmp_path: Path) -> None:
    spool = tmp_path / "spool"
    command = [sys.executable, "-c", WRITER, server.address, str(spool)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        numbers = [line for line in (process.stdout.readline() for _ in range(300)) if line[:1].isdecimal()]
        os.kill(process.pid, signal.SIGKILL)
        numbers += [line for line in process.stdout if line.endswith("\n")]
    last = int([line for line in numbers if line.strip().isdecimal()][-1])
    server.start()
    with delivering(Http(server.address), spool):
        pass
    assert server.received[: last + 1] == [f"run-{n}" for n in range(last + 1)]
    assert len(server.received) == len(set(server.received))


def test_a_full_disk_is_one_line_and_events_wait_in_memory(server: Server, tmp_path: Path) -> None:
    lines = list[str]()
    with delivering(Http(server.address), tmp_path / "spool", lines) as delivery:
        with files_of_at_most(120_000):
            for number in range(2_000):
                delivery.put([event(number)])
            assert sum("cannot be written" in line for line in lines) == 1
        time.sleep(0.1)
        delivery.put([event(2_000)])
        server.start()
    assert list(dict.fromkeys(server.received)) == [event(n).id for n in range(2_001)]
    assert "the disk takes events again" in " ".join(lines)


def test_a_spool_that_cannot_be_opened_is_one_line(server: Server, tmp_path: Path) -> None:
    lines = list[str]()
    server.start()
    with delivering(Http(server.address), tmp_path / "none/spool", lines) as delivery:
        delivery.put([event(1)])
    assert server.received == ["run-1"]
    assert [line for line in lines if "none/spool cannot be written" in line] == lines[:1]


def test_what_is_no_spool_is_kept_aside(tmp_path: Path) -> None:
    path, lines = tmp_path / "spool", list[str]()
    path.write_bytes(b"no database " * 1000)
    spool = Spool(path, lines.append)
    spool.put(["a"])
    assert spool.first(9) == ["a"]
    spool.close()
    assert (tmp_path / "spool.broken").read_bytes().startswith(b"no database")
    assert len(lines) == 1


@pytest.mark.parametrize("on_disk", [True, False])
def test_a_full_spool_drops_the_oldest_and_says_how_many(on_disk: bool, tmp_path: Path) -> None:
    spool = Spool(tmp_path / "spool" if on_disk else None, print, most=10, most_in_memory=10)
    dropped = sum(spool.put([str(n), str(n + 1)]) for n in range(0, 24, 2))
    assert dropped + sum([spool.put([])]) == 14
    assert spool.first(99) == [str(n) for n in range(14, 24)]
    spool.remove(4)
    assert spool.first(2) == ["18", "19"]
    assert len(spool) == 6


def test_a_receiver_learns_how_many_events_were_dropped(server: Server, tmp_path: Path) -> None:
    with delivering(Http(server.address), tmp_path / "spool") as delivery:
        delivery.spool._most = 5
        for number in range(9):
            delivery.put([event(number)])
        server.start()
    assert server.received[-1] == "dropped-1"


def test_a_spool_does_not_grow_with_what_went_through_it(tmp_path: Path) -> None:
    spool, sizes = Spool(tmp_path / "spool", print), list[int]()
    for _ in range(100):
        spool.put(["x" * 300] * 200)
        spool.remove(200)
        sizes.append(sum(path.stat().st_size for path in tmp_path.iterdir()))
    # The log is written back every thousand pages of 4 kB.
    assert max(sizes) == max(sizes[:60]) < 6_000_000


def test_half_a_line_of_a_killed_process_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_bytes(b'{"a":1}\n' + b'{"b' * 4000)
    receiver = LinesInFile(path)
    receiver.send(['{"c":2}'])
    receiver.close()
    assert path.read_bytes() == b'{"a":1}\n{"c":2}\n'


def test_a_file_on_a_full_disk_gets_whole_lines_once_there_is_room(tmp_path: Path) -> None:
    path, lines = tmp_path / "events.jsonl", list[str]()
    with delivering(LinesInFile(path), tmp_path / "spool", lines) as delivery, files_of_at_most(5_000):
        for number in range(100):
            delivery.put([event(number)])
        wait_for(lambda: bool(lines))
        assert path.read_bytes()[-1:] in (b"", b"\n")
    assert [json.loads(line)["id"] for line in path.read_text().splitlines()] == [event(n).id for n in range(100)]
    assert "File too large" in lines[0]
    assert not (tmp_path / "spool").exists()


class Restarting:
    """A receiver in this process that is away at times, and at times loses its answer."""

    spooled, name = True, "http://receiver"

    def __init__(self) -> None:
        self.ids, self.came, self.away, self.silent = set[str](), 0, False, False

    def send(self, lines: Sequence[str]) -> None:
        if self.away:
            raise ConnectionRefusedError(111, "Connection refused")
        self.came += len(lines)
        self.ids.update(line.split('"id":"', 1)[1].split('"', 1)[0] for line in lines)
        if self.silent:
            self.silent = False
            raise TimeoutError("no answer")

    def close(self) -> None:
        pass


@pytest.mark.slow
def test_a_day_with_ten_restarts_loses_and_doubles_nothing_in_flat_memory(tmp_path: Path) -> None:
    """24 h at a frame each ten seconds, by a clock of its own; four people walk through at a time."""
    receiver, maker = Restarting(), EventMaker(Scene([SceneLine("door", np.array([[50.0, 0], [50, 99]]))],
                                                     events=EventIntervals(moves=20.0)))  # fmt: skip
    made, memory, hours, process = list[str](), list[int](), 24, psutil.Process()
    with delivering(receiver, tmp_path / "spool") as delivery:
        for frame in range(hours * 360):
            seconds = 10.0 * frame
            ids = frame // 10 + 1 - np.arange(min(4, frame // 10 + 1))
            x = 8.0 * (frame / 10 - (ids - 1))
            boxes = np.column_stack([10 * x - 5, np.full(len(x), 20.0), 10 * x + 5, np.full(len(x), 60.0)])
            people = Targets(frame, ids, boxes, np.ones(len(x)), np.full(len(x), "tracking", dtype="U9"))
            events = maker.events(PeopleInFrame(0, "gate", 1e9 + seconds, Frame(frame, seconds, IMAGE), people))
            made += [event.id for event in events]
            delivery.put(events)
            hour, within = divmod(frame, 360)
            if hour % 2 == 1 and hour < 21:  # ten times
                receiver.away = 120 <= within < 180
                receiver.silent |= within == 180
            if within == 359:
                wait_for(lambda: len(delivery.spool) == 0)
                gc.collect()
                memory.append(process.memory_info().rss - sys.getsizeof(made))
    assert receiver.ids == set(made)
    assert len(made) == len(set(made)) > 10_000
    assert receiver.came > len(made)
    assert max(memory[4:]) < 1.05 * memory[3], [round(m / 1e6) for m in memory]


def test_two_runs_never_share_an_id() -> None:
    ids = [EventMaker().new_id() for _ in range(100)]
    assert len(set(ids)) == 100


def test_sqlite_of_this_python_has_the_write_ahead_log(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "x") as database:
        assert database.execute("PRAGMA journal_mode = WAL").fetchone() == ("wal",)
