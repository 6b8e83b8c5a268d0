"""An end that does not wait for long native calls: where a signal is not answered within a second, the process leaves.

Python runs a signal's handler only between its own instructions. A thread of its own hears of the signal beside it.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import active_children

from tsuiseki.tracking.output import WORKING

# Seconds from a signal to the end; and where a call goes on although finished steps wait to be written.
SOON, KEEPING = 0.9, 10.0


class Deadline:
    """Whether the command that runs has something to write when a signal comes.

    Attributes:
        keeps: a signal lets it write what is finished.
        answered: it has heard the signal, and writes.
    """

    def __init__(self) -> None:
        self.keeps = self.answered = False

    @contextmanager
    def held(self, numbers: Sequence[int]) -> Iterator[None]:
        """Within the ``with`` block one of the signals ``numbers`` is answered, or ends the process."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        self.keeps = self.answered = False
        hears, tells = os.pipe()
        os.set_blocking(tells, False)
        before, over = signal.set_wakeup_fd(tells, warn_on_full_buffer=False), threading.Event()
        watcher = threading.Thread(target=self._watch, args=(hears, numbers, over), daemon=True)
        watcher.start()
        try:
            yield
        finally:
            over.set()
            signal.set_wakeup_fd(before)
            os.close(tells)
            watcher.join()
            os.close(hears)

    def _watch(self, hears: int, numbers: Sequence[int], over: threading.Event) -> None:
        while heard := os.read(hears, 1):
            if heard[0] not in numbers:
                continue
            begin = time.monotonic()
            while not over.wait(0.02) and not (self.keeps and self.answered):
                waited = time.monotonic() - begin - (KEEPING - SOON if self.keeps else 0)
                # Processes that it waits for have had the time to clean up.
                for child in active_children() if waited > SOON / 2 else ():
                    child.kill()
                if waited > SOON:
                    _leave(heard[0])


def _leave(number: int) -> None:
    """End the process and those that it started, in the middle of whatever it does."""
    for child in active_children():
        child.kill()
    for folder in [*WORKING]:
        shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError, ValueError):
        print("tsuiseki: interrupted in the middle of a long step; nothing was written", file=sys.stderr, flush=True)
    os._exit(128 + number)


DEADLINE = Deadline()
