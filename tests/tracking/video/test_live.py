"""A stream that is cut, stalls and comes back is followed through its gaps, and never waited for without a bound."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from socket import AF_INET, SO_REUSEADDR, SOCK_STREAM, SOL_SOCKET, socket

import cv2
import numpy as np
import pytest

from tests.tracking.video.servers import Beginning, PlannedCamera, jpeg
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video import live
from tsuiseki.tracking.video.live import LiveSource
from tsuiseki.tracking.video.source import open_source

PICTURE = 0.6
HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=next\r\n\r\n"


class MotionJpeg:
    """A camera's server on loopback.

    Attributes:
        plan: for each connection that comes, how many pictures are sent, and whether it then stalls (or is cut); after
            the last the server is gone.
    """

    def __init__(self, plan: list[tuple[int, bool]]) -> None:
        self.plan, self.sent, self.over, self.stalled = plan, 0, threading.Event(), threading.Event()
        self.listening = socket(AF_INET, SOCK_STREAM)
        self.listening.setsockopt(SOL_SOCKET, SO_REUSEADDR, 1)
        self.listening.bind(("127.0.0.1", 0))
        self.listening.listen()
        self.address = f"http://127.0.0.1:{self.listening.getsockname()[1]}/camera.mjpg"
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self) -> None:
        for count, stalls in self.plan:
            try:
                there, _ = self.listening.accept()
                with there:
                    there.recv(4096)
                    there.sendall(HEAD)
                    for _ in range(count):
                        there.sendall(self.picture())
                        self.over.wait(0.02)
                    if stalls:
                        self.stalled.set()
                        there.recv(1)
            except OSError:
                if self.over.is_set():
                    return
        self.listening.close()

    def picture(self) -> bytes:
        image = np.full((48, 64, 3), 90, np.uint8)
        left = 4 + self.sent % 40
        image[20:32, left : left + 12] = (0, 0, 230)
        self.sent += 1
        data = cv2.imencode(".jpg", image)[1].tobytes()
        return b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%s\r\n" % (len(data), data)

    def close(self) -> None:
        self.over.set()
        self.listening.close()


@pytest.fixture
def servers() -> Iterator[list[MotionJpeg]]:
    made: list[MotionJpeg] = []
    yield made
    for server in made:
        server.close()


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seconds in {"PICTURE": PICTURE, "PAUSE": 0.1}.items():
        monkeypatch.setattr(live, name, seconds)


def source_of(server: MotionJpeg, wanted: FrameRange | None = None, give_up: float | None = None) -> LiveSource:
    return LiveSource(name="camera", address=server.address, frames_wanted=wanted or FrameRange(), give_up=give_up)


@pytest.mark.slow
@pytest.mark.paced
def test_a_stream_that_is_cut_and_one_that_stalls_come_back(servers: list[MotionJpeg]) -> None:
    servers.append(MotionJpeg([(30, False), (30, True), (300, False)]))
    source = source_of(servers[0], FrameRange(0, 69))
    with pytest.warns(InputWarning) as told:
        frames = list(source.frames())
    assert [frame.index for frame in frames] == list(range(70))
    steps = np.diff([frame.time for frame in frames])
    assert (steps > 0).all()
    assert len(source.gaps) == len(told) == 2
    for gap, line in zip(source.gaps, told, strict=True):
        assert f"no picture after frame {gap['after_frame']}, connecting again until it is back" in str(line.message)
        assert gap["seconds"] == pytest.approx(steps[gap["after_frame"] - 1], abs=1e-3)
    # The one that stalled was waited for as long as a picture may take.
    assert source.gaps[0]["seconds"] < PICTURE < source.gaps[1]["seconds"] < 2


@pytest.mark.slow
@pytest.mark.paced
@pytest.mark.filterwarnings("ignore")
def test_garbage_between_and_instead_of_pictures_is_passed_over() -> None:
    picture, rng = np.full((48, 64, 3), 90, np.uint8), np.random.default_rng(0)
    picture[20:32, 10:22] = (230, 0, 0)

    def noise(number: int) -> bytes:
        data = rng.bytes(3000)
        head = b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data)
        return {4: data, 7: head + data + b"\r\n"}.get(number % 10, b"")

    camera = PlannedCamera(Beginning(2), lambda _: jpeg(picture), 50.0, noise)
    source = LiveSource(name="camera", address=camera.address, frames_wanted=FrameRange(0, 59), give_up=5.0)
    frames = list(source.frames())
    camera.close()
    assert [frame.index for frame in frames] == list(range(60))
    assert max(np.abs(frame.image.astype(int) - picture).mean() for frame in frames) < 5


@pytest.mark.slow
@pytest.mark.paced
def test_a_stream_that_stays_away_is_given_up(servers: list[MotionJpeg]) -> None:
    servers.append(MotionJpeg([(20, False)]))
    begin, frames = time.monotonic(), source_of(servers[0], give_up=1.5).frames()
    with (
        pytest.warns(InputWarning),
        pytest.raises(RunError, match=r"after frame \d\d, and none within 1\.5 s"),
    ):
        list(frames)
    assert 1.5 < time.monotonic() - begin < 5
    with pytest.raises(RequestError, match=r"expected pictures from .*, got none"):
        open_source(servers[0].address)


@pytest.mark.slow
@pytest.mark.paced
def test_a_run_marks_the_gap_and_answers_an_interrupt_while_it_waits(
    servers: list[MotionJpeg], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    servers.append(MotionJpeg([*[(30, False)] * 3, (30, True)]))
    monkeypatch.setattr(live, "PICTURE", 20.0)
    asked = []

    def interrupt() -> None:
        servers[0].stalled.wait(20)
        time.sleep(0.5)
        asked.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    words = ["track", "blobs", servers[0].address, "--colour", "red", "--particles", "50", "--out", str(tmp_path / "o")]
    assert main(words) == 0
    assert time.monotonic() - asked[0] < 3
    record = json.loads((tmp_path / "o" / "run.json").read_text())
    (facts,) = record["facts"]["frame_times"].values()
    assert facts["timed_by"] == "arrival"
    (gap,) = facts["gaps"]
    assert gap["after_frame"] < len(record["frames"]["frame"])
    assert record["partial"] is False
    assert capsys.readouterr().err.count("connecting again") == 1
