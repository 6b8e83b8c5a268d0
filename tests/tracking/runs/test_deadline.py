"""A signal ends a command within a second, also in a native call without end; what it worked on is cleared away."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts.page import TrackedPage
from tsuiseki.tracking.drone.tracker import DroneTracker
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.onnx import CALLS
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.runs import ending
from tsuiseki.tracking.types import ImageArray, Track
from tsuiseki.tracking.video import image_folder

# A lock that is taken twice: the call never returns, no signal interrupts it, and no Python runs in its thread.
SCRIPT = """
import ctypes, os, sys
from pathlib import Path
from tsuiseki.tracking.runs.ending import ended
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.processes import on_all_cores

def hang(number=0):
    library, lock = ctypes.CDLL(None), (ctypes.c_char * 256)()
    library.pthread_mutex_init(lock, None)
    os.write(1, b"ready\\n")
    library.pthread_mutex_lock(lock)
    library.pthread_mutex_lock(lock)

def alone():
    with output_folder(Path(sys.argv[2]), False) as work:
        (work / "half.txt").write_text("half")
        hang()

def together():
    list(on_all_cores(hang, [1, 2], processes=2))

if __name__ == "__main__":
    sys.exit(ended({"alone": alone, "together": together}[sys.argv[1]]))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("where", ["alone", "together"])
def test_a_signal_ends_a_native_call_without_end(where: str, number: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    words = [sys.executable, str(tmp_path / "script.py"), where, str(tmp_path / "out")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            for _ in range(2 if where == "together" else 1):
                assert process.stdout.readline() == "ready\n"
            begin = time.monotonic()
            process.send_signal(number)
            # All processes hold its output: it ends with the last of them.
            _, said = process.communicate(timeout=30)
            # A second where the machine has nothing else to do.
            assert time.monotonic() - begin < 4
        finally:
            process.kill()
    assert process.returncode == 128 + number
    (line,) = said.splitlines()
    assert line.startswith("tsuiseki: interrupted")
    assert line.endswith("nothing was written")
    assert list((tmp_path / "out").glob(".*")) == []


# An object that takes its time to be taken apart, as the modules of torch do; and what is to run at the end.
INTERRUPTED = """
import atexit, time
from tsuiseki.tracking import cli

class Slow:
    def __del__(self, sleep=time.sleep):
        sleep(60)

SLOW = Slow()
atexit.register(print, "cleared away")
cli.ended = lambda command: 143
print("said")
cli.main()
"""


def test_who_interrupts_does_not_wait_for_python_to_take_itself_apart() -> None:
    run = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=30, check=False)
    assert (run.returncode, run.stdout) == (143, "said\ncleared away\n")


def make_endless(path: Path, brightness: float) -> None:
    """The detector at ``path`` adds 0 without end where a batch is brighter than ``brightness``, of 255."""
    model = onnx.load(path)
    graph, number = model.graph, helper.make_tensor_value_info
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"]), helper.make_node("Add", ["x", "nothing"], ["y"])],
        "body",
        [number("n", TensorProto.INT64, []), number("go", TensorProto.BOOL, []), number("x", TensorProto.FLOAT, None)],
        [number("on", TensorProto.BOOL, []), number("y", TensorProto.FLOAT, None)],
    )
    constants = {"level": np.float32(brightness / 255 / 0.226 - 0.449 / 0.226), "many": np.array(10**15)}
    graph.initializer.extend(numpy_helper.from_array(np.array(value), name) for name, value in constants.items())
    before = [
        helper.make_node("ReduceMean", ["images"], ["bright"], keepdims=0),
        helper.make_node("Greater", ["bright", "level"], ["brighter"]),
        helper.make_node("Cast", ["brighter"], ["times"], to=TensorProto.INT64),
        helper.make_node("Mul", ["times", "many"], ["rounds"]),
        helper.make_node("Loop", ["rounds", "", "mean"], ["looped"], body=body),
    ]
    nodes = [*graph.node]
    nodes[1].input[0] = "looped"
    del graph.node[:]
    graph.node.extend([nodes[0], *before, *nodes[1:]])
    onnx.save(model, path)


@pytest.mark.parametrize("threads", ["1", "2"])
def test_a_signal_drops_the_networks_under_way_and_keeps_what_is_finished(
    threads: str, inputs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    detector = tmp_path / "endless.onnx"
    shutil.copy(inputs.detector, detector)
    # Of the batches of frames 0-3, 4-7 and 8-11 the last.
    make_endless(detector, 60 + 5 * 8.5)
    begin, started = list[float](), list[bool]()

    def stop() -> None:
        begin.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGTERM)

    read = image_folder.read_image

    def reading(path: Path, *more: Any) -> ImageArray:
        if path.stem == "000012" and not started:
            started.append(True)
            threading.Timer(1, stop).start()
        return read(path, *more)

    monkeypatch.setattr(image_folder, "read_image", reading)
    # However busy the machine is.
    monkeypatch.setattr(ending, "BRIEF", 3.0)
    words = ["track", "people", str(inputs.images), "--detector", str(detector), "--view", "1", "--method", "sort"]
    out = tmp_path / "out"
    assert main([*words, "--threads", threads, "--out", str(out)]) == 128 + signal.SIGTERM
    # A second where the machine has nothing else to do.
    assert time.monotonic() - begin[0] < 4
    record = json.loads((out / "run.json").read_text())
    assert record["partial"] is True
    assert record["frames"]["frame"] == list(range(1, 9))
    assert CALLS.terminate is False


@pytest.mark.parametrize(
    ("number", "what", "linker"),
    [
        (signal.SIGINT, ["people"], (FlowTracker, "tracks")),
        (signal.SIGTERM, ["people"], (FlowTracker, "tracks")),
        (signal.SIGTERM, ["drone", "--method", "flow", "--keep-camera-motion"], (DroneTracker, "people")),
    ],
)
def test_detections_are_kept_where_linking_them_takes_long(
    number: signal.Signals,
    what: list[str],
    linker: tuple[type, str],
    inputs: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = list[float]()

    def link(_: object) -> list[Track]:
        begin.append(time.monotonic())
        os.kill(os.getpid(), number)
        while time.monotonic() < begin[0] + 30:
            time.sleep(0.01)
        return []

    words = ["track", *what, str(inputs.images), "--appearance", "none"]
    with monkeypatch.context() as patch:
        patch.setattr(*linker, link)
        one = [*words, "--detector", str(inputs.detector), "--view", "1", "--out", str(tmp_path / "one")]
        assert main(one) == 128 + number
    # A second where the machine has nothing else to do.
    assert time.monotonic() - begin[0] < 4
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == ["detections.txt", "run.json"]
    record = json.loads((tmp_path / "one/run.json").read_text())
    assert (record["partial"], record["files"]) == (True, ["detections.txt"])
    given = ["--detections", str(tmp_path / "one/detections.txt")]
    assert main([*words, *given, "--out", str(tmp_path / "two")]) == 0
    assert len(read_tracks(tmp_path / "two/tracks.txt")) > 0
    monkeypatch.setattr(*linker, link)
    begin.clear()
    assert main([*words, *given, "--out", str(tmp_path / "three")]) == 128 + number
    assert not (tmp_path / "three").exists()


@pytest.mark.parametrize("slow", ["html", "_plot"])
@pytest.mark.parametrize("asked", ["before", "there"])
def test_who_interrupts_waits_for_no_page_and_no_plot(
    slow: str, asked: str, inputs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = list[float]()

    def interrupt() -> None:
        begin.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGTERM)

    def page(*_: Any) -> str:
        if not begin:
            interrupt()
        while time.monotonic() < begin[0] + 30:
            time.sleep(0.01)
        return ""

    def tracks(self: Sort) -> list[Track]:
        if asked == "before":
            interrupt()
        return found(self)

    found = Sort.tracks
    monkeypatch.setattr(Sort, "tracks", tracks)
    monkeypatch.setattr(TrackedPage, slow, page)
    words = ["track", "people", str(inputs.images), "--method", "sort", "--detector", str(inputs.detector)]
    assert main([*words, "--view", "1", "--out", str(tmp_path / "out")]) == 128 + signal.SIGTERM
    # A second where the machine has nothing else to do.
    assert time.monotonic() - begin[0] < 4
    record = json.loads((tmp_path / "out/run.json").read_text())
    assert record["partial"] is True
    assert "tracks.txt" in record["files"]
    assert "report.html" not in record["files"]
