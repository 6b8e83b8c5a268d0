"""What a signal does in each state of a run; see the head of `tracking.runs.run`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tsuiseki.tracking.output import is_partial
from tsuiseki.tracking.runs import ending
from tsuiseki.tracking.runs.ending import ended
from tsuiseki.tracking.runs.files import RunFiles
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.run import Run

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
STEPS = 5


def send(number: signal.Signals = signal.SIGINT, times: int = 1) -> None:
    for _ in range(times):
        os.kill(os.getpid(), number)


def command(out: Path, happens: Callable[[str], object]) -> Callable[[], int]:
    """A command of five steps with a file of their lines, two files, an overlay and a page.

    ``happens`` is called with the name of each place.
    """

    def numbers() -> Iterator[tuple[int, int]]:
        for number in range(STEPS):
            happens(f"step {number}")
            yield number, number

    def write(path: Path, text: str) -> None:
        with path.open("w") as file:
            file.write("half")
            file.flush()
            happens(path.name)
            file.write(text)

    def work() -> int:
        with Output(out, overwrite=True).run() as run:
            happens("idle")
            finished = [number for number, _ in run.steps(run.kept("lines.txt", numbers(), "{}: {}\n".format))]
            happens("linking")
            for name in ("first.txt", "second.txt"):
                run.write(name, write, str(finished))
            run.draw("overlay.webm", lambda path: write(path, "drawn"))
            run.write("page.html", write, "page")
            run.done("all is done")
        return run.status

    return work


def at(place: str, number: signal.Signals = signal.SIGINT, times: int = 1) -> Callable[[str], object]:
    return lambda name: send(number, times) if name == place else None


def left(out: Path) -> tuple[list[str], dict[str, Any]]:
    """Names of all files, hidden ones among them, and the record."""
    assert [path.name for path in out.parent.iterdir()] == [out.name]
    return sorted(path.name for path in out.iterdir()), json.loads((out / "run.json").read_text())


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Signals that follow each other at once count one by one."""
    monkeypatch.setattr(ending, "TWICE", 0.0)


@pytest.mark.parametrize("number", SIGNALS)
def test_idle_nothing_is_written(number: signal.Signals, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(command(out, at("idle", number))) == 128 + number
    assert not out.exists()
    assert capsys.readouterr() == ("", "tsuiseki: interrupted; nothing was written\n")


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize(("place", "steps"), [("step 0", 1), ("step 2", 3), ("linking", 5), ("first.txt", 5)])
def test_running_the_first_signal_finishes_the_step_and_writes(
    place: str, steps: int, number: signal.Signals, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = [signal.getsignal(other) for other in SIGNALS]
    assert ended(command(out, at(place, number))) == 128 + number
    names, record = left(out)
    assert names == ["first.txt", "page.html", "run.json", "second.txt"]
    assert (out / "second.txt").read_text() == "half" + str([*range(steps)])
    assert (record["partial"], record["reason"]) == (True, "interrupted")
    assert [signal.getsignal(other) for other in SIGNALS] == before
    printed = capsys.readouterr()
    assert printed.out == ""
    asked, last = [line for line in printed.err.splitlines() if line.startswith("tsuiseki: ")]
    assert asked == "tsuiseki: interrupted: what is finished is being written; another interrupt ends at once"
    assert last.endswith(f"up to {steps} steps is in {out}, marked in its run.json")


@pytest.mark.parametrize(
    ("place", "names"),
    [
        ("step 2", ["lines.txt", "run.json"]),
        ("linking", ["lines.txt", "run.json"]),
        ("first.txt", ["lines.txt", "run.json"]),
        ("second.txt", ["first.txt", "run.json"]),
        ("page.html", ["first.txt", "overlay.webm", "run.json", "second.txt"]),
    ],
)
@pytest.mark.usefixtures("apart")
def test_asked_a_second_signal_ends_at_once_and_whole_files_are_kept(place: str, names: list[str], out: Path) -> None:
    assert ended(command(out, at(place, signal.SIGTERM, times=2))) == 128 + signal.SIGTERM
    assert left(out)[0] == names
    assert is_partial(out)
    if names[0] == "lines.txt":
        assert (out / "lines.txt").read_text().startswith("0: 0\n1: 1\n")


@pytest.mark.usefixtures("apart")
def test_asked_a_second_signal_of_another_kind_gives_the_status(out: Path) -> None:
    def happens(place: str) -> None:
        if place == "step 2":
            send(signal.SIGINT)
            send(signal.SIGTERM)

    assert ended(command(out, happens)) == 128 + signal.SIGTERM


@pytest.mark.usefixtures("apart")
def test_asked_in_the_first_step_a_second_signal_leaves_nothing(out: Path) -> None:
    assert ended(command(out, at("step 0", times=2))) == 130
    assert not out.exists()


def test_a_signal_that_comes_twice_at_once_is_one(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ending, "TWICE", 60.0)
    assert ended(command(out, at("step 2", times=2))) == 130
    assert "first.txt" in left(out)[0]


def test_drawing_a_signal_costs_the_drawing_alone(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(command(out, at("overlay.webm"))) == 130
    names, record = left(out)
    assert names == ["first.txt", "page.html", "run.json", "second.txt"]
    assert record["reason"] == "interrupted while overlay.webm was drawn"
    assert len([line for line in capsys.readouterr().err.splitlines() if line.startswith("tsuiseki: ")]) == 1


def test_writing_a_signal_changes_nothing(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record = RunFiles.record

    def recorded(run: RunFiles, reason: str) -> None:
        send()
        record(run, reason)

    monkeypatch.setattr(RunFiles, "record", recorded)
    assert ended(command(out, lambda _: None)) == 0
    assert not is_partial(out)
    assert capsys.readouterr().out == "all is done\n"


@pytest.mark.parametrize("place", ["frame", "step"])
def test_a_live_source_ends_with_what_came(place: str, out: Path) -> None:
    def items() -> Iterator[int]:
        for number in range(STEPS):
            if (place, number) == ("frame", 3):
                send()
            yield number

    def steps(run: Run) -> Iterator[int]:
        for number in run.unending(items()):
            if (place, number) == ("step", 2):
                send()
            yield number

    def work() -> int:
        with Output(out).run() as run:
            finished = [*run.steps(steps(run))]
            run.write("a.txt", lambda path: path.write_text(str(finished)))
        return run.status

    assert ended(work) == 0
    assert (out / "a.txt").read_text() == "[0, 1, 2]"
    assert not is_partial(out)


SCRIPT = """
import sys, time
from pathlib import Path
from tests.tracking.runs.test_signals import command
from tsuiseki.tracking.runs.ending import ended

def happens(place):
    if place == sys.argv[2]:
        print(place, flush=True)
        time.sleep(float(sys.argv[3]))

sys.exit(ended(command(Path(sys.argv[1]), happens)))
"""


def started(out: Path, place: str, seconds: float, ignored: bool = False) -> subprocess.Popen[str]:
    """A process that waits so long at ``place``, and is there."""
    words = [sys.executable, "-c", SCRIPT, str(out), place, str(seconds)]
    ignore = (lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)) if ignored else None
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=ignore, start_new_session=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == f"{place}\n"
    return process


@pytest.mark.slow
def test_a_process_ends_with_the_status_of_the_signal(out: Path) -> None:
    process = started(out, "step 2", 1.0)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert is_partial(out)


@pytest.mark.slow
def test_what_is_ignored_stays_ignored(out: Path) -> None:
    process = started(out, "step 2", 1.0, ignored=True)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=60)[0] == "all is done\n"
    assert process.returncode == 0
    assert not is_partial(out)


@pytest.mark.slow
def test_a_killed_run_leaves_nothing_half_and_the_next_one_clears_up(out: Path) -> None:
    def visible() -> dict[str, str]:
        return {path.name: path.read_text() for path in out.iterdir() if not path.name.startswith(".")}

    assert ended(command(out, at("linking"))) == 130
    before = visible()
    process = started(out, "second.txt", 60.0)
    process.kill()
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    assert visible() == before
    assert ended(command(out, lambda _: None)) == 0
    names, record = left(out)
    assert names == ["first.txt", "overlay.webm", "page.html", "run.json", "second.txt"]
    assert record["partial"] is False
