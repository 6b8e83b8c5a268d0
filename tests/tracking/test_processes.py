"""Work on all cores: answers in order, errors passed on, and an end at once where the user interrupts."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.processes import on_all_cores

SECONDS = 20
INTERRUPTED = """
from functools import partial
from pathlib import Path
from test_processes import busy
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.processes import on_all_cores

if __name__ == "__main__":
    list(on_all_cores(partial(busy, Path({folder!r})), range(100)))
"""


def busy(folder: Path, number: int) -> None:
    try:
        (folder / f"begun-{number}").touch()
        time.sleep(SECONDS)
    finally:
        time.sleep(0.1 * (number % 2))  # of two processes one clears away longer
        (folder / f"left-{number}").touch()


def test_answers_come_in_order_and_errors_as_they_are(tmp_path: Path) -> None:
    assert list(on_all_cores(math.factorial, range(5), together=2)) == [1, 1, 2, 6, 24]
    with pytest.raises(RequestError, match=r"seqinfo\.ini"):
        list(on_all_cores(read_sequence, [tmp_path]))


def test_one_process_is_this_one() -> None:
    assert list(on_all_cores(lambda _: os.getpid(), range(2), processes=1)) == [os.getpid()] * 2


def test_a_process_that_is_ended_from_outside_is_one_clear_line() -> None:
    with pytest.raises(RunError, match="one was ended from outside, perhaps for want of memory") as caught:
        list(on_all_cores(os._exit, [0]))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("everyone", [True, False])
def test_an_interrupt_cleans_up_and_begins_nothing_further(everyone: bool, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED.format(folder=str(tmp_path)))
    words = [sys.executable, str(script)]
    paths = {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])}
    run = subprocess.Popen(words, env=os.environ | paths, start_new_session=True, stderr=subprocess.PIPE, text=True)
    try:
        wanted = min(100, os.cpu_count() or 1)
        start = time.monotonic()
        while len(list(tmp_path.glob("begun-*"))) < wanted and time.monotonic() < start + 60:
            time.sleep(0.05)
        # Ctrl-C reaches all processes of a terminal, `kill` one of them.
        (os.killpg if everyone else os.kill)(run.pid, signal.SIGINT)
        _, errors = run.communicate(timeout=60)
    finally:
        run.kill()
    begun, left = (sorted(p.name.split("-")[1] for p in tmp_path.glob(f"{kind}-*")) for kind in ("begun", "left"))
    assert len(begun) == wanted
    assert left == begun
    # The interrupt shows in the process that was started, and in no other.
    assert errors.count("Traceback") == 1
    assert run.returncode == -signal.SIGINT
