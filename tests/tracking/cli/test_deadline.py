"""A signal ends a command within a second, also in a native call without end; what it worked on is cleared away."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

# A lock that is taken twice: the call never returns, no signal interrupts it, and no Python runs in its thread.
SCRIPT = """
import ctypes, os, sys
from pathlib import Path
from tsuiseki.tracking.cli.ending import ended
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
