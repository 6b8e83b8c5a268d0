"""A camera's day at fifty times its speed, with everything that goes wrong: no event lost, memory flat.

    python -m benchmarks.live.day [--hours 24] [--speed 50] [--method flow] [--delay 1]

A server on loopback sends one picture for each second of the camera, Motion JPEG. Somebody walks past every three
minutes. It cuts the connection, stalls, sends garbage between and instead of pictures, and is restarted three times.
The receiver of the events is restarted ten times, and every third time loses its answers. What waits inside the run
waits as many times shorter as the day is faster. A process of its own follows people with `people_live`, the loop of
`track people --roll`, and events go by HTTP; a threshold on brightness takes the place of the detector.

Reported are the events made, received, lost and doubled, the passes with their crossings and ids, and the memory.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from socket import create_server, socket
from typing import Any

import cv2
import numpy as np

from benchmarks.machine import machine
from tsuiseki.tracking.events import delivery
from tsuiseki.tracking.monitor.watching import Watching
from tsuiseki.tracking.people.live_run import people_live
from tsuiseki.tracking.people.opening import open_people
from tsuiseki.tracking.people.settings import Linking, PeopleFinding
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.video import live
from tsuiseki.tracking.video.source import open_source

HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=next\r\n\r\n"
# Pictures from one person to the next, and those in which one is there; the one in which they cross the line.
PERIOD, WALK, CROSSING = 180, 40, 24
# How often each thing goes wrong in a run, spread evenly.
CUTS, STALLS, GARBAGE, RESTARTS, RECEIVER = 24, 6, 48, 3, 10
# Seconds of the camera's clock: of a stall, of a restart, and for which the receiver is away.
STALL, RESTART, AWAY = 40.0, 30.0, 300.0
SCENE = "lines: [{name: door, from: [32, 0], to: [32, 48]}]\nevents: {moves: 0.2}\n"


def picture(number: int) -> bytes:
    """Somebody bright who walks from the left to the right, a pixel a picture."""
    image = np.full((48, 64, 3), 60, np.uint8)
    if (phase := number % PERIOD) < WALK:
        image[8:40, 2 + phase : 14 + phase] = 220
    return cv2.imencode(".jpg", image)[1].tobytes()


def bright(image: ImageArray) -> np.ndarray:
    """``(N, 5)`` the bright box, and its score."""
    columns = np.flatnonzero(image[24, :, 0] > 140)
    return np.array([[columns[0], 8, columns[-1] + 1, 40, 0.9]]) if len(columns) > 3 else np.empty((0, 5))


@dataclass
class Camera:
    """Sends pictures by the clock, and goes wrong.

    Attributes:
        sent: numbers of the pictures that went out whole.
        damage: how often what happened.
    """

    length: float
    rate: float
    sent: list[int] = field(default_factory=list)
    damage: Counter[str] = field(default_factory=Counter)
    begin: float = 0.0

    def __post_init__(self) -> None:
        self.pictures = [picture(number) for number in range(PERIOD)]
        self.listening = create_server(("127.0.0.1", 0))
        self.address = f"http://127.0.0.1:{self.listening.getsockname()[1]}/camera.mjpg"
        self.rng, self.connections = np.random.default_rng(0), 0
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        # A restart closes it.
        with suppress(OSError):
            while True:
                there, _ = self.listening.accept()
                self.connections += 1
                threading.Thread(target=self._send, args=(there,), daemon=True).start()

    def _due(self, what: str, times: int, number: int) -> bool:
        """Whether it is time for the next of these."""
        due = number > (self.damage[what] + 0.5) * self.length / times
        self.damage[what] += due
        return due

    def _send(self, there: socket) -> None:
        with there, suppress(OSError):
            there.recv(4096)
            there.sendall(HEAD)
            # The first connection asks whether there is a camera.
            self.begin = self.begin or (time.monotonic() if self.connections > 1 else 0.0)
            while (number := int((time.monotonic() - self.begin) * self.rate) if self.begin else 0) < self.length:
                data = self.pictures[number % PERIOD]
                if self.begin and self._goes_wrong(there, number):
                    return
                there.sendall(
                    b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%s\r\n" % (len(data), data)
                )
                if self.begin:
                    self.sent.append(number)
                time.sleep(1 / self.rate)

    def _goes_wrong(self, there: socket, number: int) -> bool:
        """Do what is due; says whether the connection ends."""
        if self._due("garbage", GARBAGE, number):
            noise = self.rng.bytes(3000)
            head = b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(noise)
            there.sendall(noise if self.damage["garbage"] % 2 else head + noise + b"\r\n")
        if self._due("stall", STALLS, number):
            time.sleep(STALL / self.rate)
        if self._due("restart", RESTARTS, number):
            self.listening.close()
            time.sleep(RESTART / self.rate)
            self.listening = create_server(("127.0.0.1", int(self.address.split(":")[2].split("/")[0])))
            threading.Thread(target=self._serve, daemon=True).start()
            return True
        return self._due("cut", CUTS, number)


class Receiver:
    """Takes events by HTTP; may be stopped, started, and lose answers."""

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []
        self.silent, self.port = False, 0
        self.running: ThreadingHTTPServer | None = None
        self.start()

    def start(self) -> None:
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                lines = self.rfile.read(int(self.headers["Content-Length"])).splitlines()
                receiver.events += map(json.loads, lines)
                if receiver.silent:
                    receiver.silent = False
                    self.connection.close()
                    return
                self.send_response(204)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        ThreadingHTTPServer.allow_reuse_address = True
        self.running = ThreadingHTTPServer(("127.0.0.1", self.port), Handler)
        self.running.handle_error = lambda *_: None  # type: ignore[method-assign]
        self.port = self.running.server_address[1]
        threading.Thread(target=self.running.serve_forever, args=(0.01,), daemon=True).start()

    def stop(self) -> None:
        assert self.running is not None
        self.running.shutdown()
        self.running.server_close()

    def restarts(self, length: float, rate: float) -> None:
        """Ten times away, in a thread of its own."""
        for number in range(RECEIVER):
            time.sleep((length / RECEIVER - AWAY) / rate)
            self.stop()
            time.sleep(AWAY / rate)
            self.silent = number % 3 == 0
            self.start()


def follow(address: str, receiver: str, out: Path, speed: float, method: str, delay: float) -> None:
    """The process that is watched: each event's id goes to the file ``made`` before it is sent."""
    live.PICTURE, live.PAUSE, live.LONGEST_PAUSE = 20 / speed, 0.5 / speed, 30 / speed
    delivery.PAUSE, delivery.LONGEST_PAUSE = 0.5 / speed, 30 / speed
    put = delivery.Delivery.put
    with (out.parent / "made").open("a") as made:

        def noting(self: delivery.Delivery, events: Any) -> None:
            made.writelines(f"{event.id}\n" for event in events)
            made.flush()
            put(self, events)

        delivery.Delivery.put = noting  # type: ignore[method-assign]
        scene = out.parent / "scene.yaml"
        scene.write_text(SCENE)
        source = open_source(address, frame_rate=speed)
        assert isinstance(source, live.LiveSource)
        finding: dict[str, Any] = {"detector": bright}
        linking: dict[str, Any] = {"method": method}
        if method == "flow":
            finding, linking = finding | {"appearance": "none"}, linking | {"affinity": "none", "delay": delay}
        source = replace(source, give_up=1500 / speed)
        opened = open_people(source, PeopleFinding(**finding), Linking(**linking), 0)
        watching = Watching(events=receiver, scene=scene)
        with suppress(Exception):
            people_live(Output(out), opened, 0.02, partial(watching.observers, out, [source]))


def main() -> None:
    """Replay and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--speed", type=float, default=50.0)
    parser.add_argument("--method", default="flow")
    parser.add_argument("--delay", type=float, default=1.0, help="seconds of the run")
    parser.add_argument("--follow", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.follow:
        address, receiver_address, folder = arguments.follow
        follow(address, receiver_address, Path(folder), arguments.speed, arguments.method, arguments.delay)
        return
    camera, receiver = Camera(3600 * arguments.hours, arguments.speed), Receiver()
    threading.Thread(target=receiver.restarts, args=(camera.length, camera.rate), daemon=True).start()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        words = ["--speed", str(camera.rate), "--method", arguments.method, "--delay", str(arguments.delay)]
        words += ["--follow", camera.address, f"http://127.0.0.1:{receiver.port}/events", str(out)]
        process, memory = subprocess.Popen([sys.executable, "-W", "ignore", "-m", __spec__.name, *words]), list[int]()
        while process.poll() is None:
            with suppress(OSError):
                pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
                if camera.begin:
                    memory.append(pages * os.sysconf("SC_PAGE_SIZE"))
            time.sleep(5)
        cpu = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
        made = (out.parent / "made").read_text().split()
        record = json.loads((out / "run.json").read_text())["facts"]["cameras"][0]
        report(arguments, camera, receiver, made, memory, record, cpu)


def report(
    arguments: argparse.Namespace, camera: Camera, receiver: Receiver, made: list[str], memory: list[int],
    record: dict[str, Any], cpu: float,
) -> None:  # fmt: skip
    """Print what came of it."""
    print(machine("numpy", "av", "opencv-python-headless"))
    words = (
        f"{arguments.hours:g} h of a camera, a picture a second, at {arguments.speed:g} x; method {arguments.method}"
    )
    print(f"{words}, delay {arguments.delay:g} s of the run")
    print(f"went wrong: {dict(camera.damage)}, receiver restarted {RECEIVER}")
    print(f"pictures: {len(camera.sent)} sent, {record['frames']} came, {record['dropped']} dropped, "
          f"{record['outages']} outages")  # fmt: skip
    ids = [event["id"] for event in receiver.events]
    lost, doubles, same = len(set(made) - set(ids)), len(ids) - len(set(ids)), len(made) - len(set(made))
    print(f"events: {len(made)} made, {len(ids)} received, {lost} lost, {doubles} doubles, {same} after removal by id")
    once = {event["id"]: event for event in receiver.events}.values()
    kinds = Counter(event["type"].removeprefix("tsuiseki.") for event in once)
    passes = defaultdict(set)
    for number in camera.sent:
        passes[number // PERIOD].add(number % PERIOD)
    walked = sum(len([p for p in phases if p < WALK]) >= WALK // 4 for phases in passes.values())
    crossed = sum(min(phases) < CROSSING - 8 and max(phases) > CROSSING + 8 for phases in passes.values())
    print(f"passes: {walked} with {kinds['appeared']} ids; {crossed} across the line, {kinds['crossed']} events say so")
    print(f"of each kind: {dict(kinds)}")
    tenth = max(1, len(memory) // 10)
    first, rest = np.median(memory[tenth : 2 * tenth]), np.array(memory[2 * tenth :])
    least, most = rest.min() / 1e6, rest.max() / 1e6
    print(f"memory: {first / 1e6:.1f} MB in the second tenth, afterwards {least:.1f} to {most:.1f} MB")
    print(f"at most {100 * (rest.max() / first - 1):+.1f} %; CPU {cpu:.0f} s")


if __name__ == "__main__":
    main()
