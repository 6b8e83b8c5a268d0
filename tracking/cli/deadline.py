"""An end that does not wait for long native calls: where a signal is not answered within a second, the process leaves.

Python runs a signal's handler only between its own instructions. A thread of its own hears of the signal beside it.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import sys
import threading
import time
from _thread import interrupt_main
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import active_children

from tsuiseki.tracking.output import WORKING

# Seconds from a signal to the end; where a call goes on although finished steps wait to be written; and for `brief`.
SOON, KEEPING, BRIEF = 0.9, 10.0, 0.4


class Deadline:
    """Whether the command that runs has something to write when a signal comes.

    Attributes:
        keeps: a signal lets it write what is finished.
        brief: soon after a signal it is interrupted in what it makes of that, for it can be made again.
        answered: signals that it has heard: after the first it writes, after the next it ends.
    """

    def __init__(self) -> None:
        self.keeps = self.brief = self._droppable = False
        self.answered = 0
        self._lock = threading.RLock()

    @contextmanager
    def droppable(self) -> Iterator[None]:
        """Within the ``with`` block a signal ends the networks under way, by `Dropped`."""
        self._droppable = True
        try:
            yield
        finally:
            with self._lock:
                self._droppable = False
                self.drop(False)

    def drop(self, now: bool = True) -> None:
        """End the networks under way, where what they work on is `droppable`."""
        # Loaded only where networks run.
        calls = getattr(sys.modules.get("tsuiseki.tracking.onnx"), "CALLS", None)
        with self._lock:
            if calls is not None and now == self._droppable:
                calls.terminate = now

    @contextmanager
    def held(self, numbers: Sequence[int]) -> Iterator[None]:
        """Within the ``with`` block one of the signals ``numbers`` is answered, or ends the process."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        self.keeps, self.brief, self.answered = False, False, 0
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
        asked = 0
        while heard := os.read(hears, 1):
            if heard[0] not in numbers:
                continue
            asked, begin = asked + 1, time.monotonic()
            self.drop()
            while not over.wait(0.02) and not (self.keeps and self.answered >= asked):
                self.drop()
                waited = time.monotonic() - begin - (KEEPING - SOON if self.keeps else 0)
                # Processes that it waits for have had the time to clean up.
                for child in active_children() if waited > SOON / 2 else ():
                    child.kill()
                if waited > SOON:
                    _leave(heard[0])
            if asked > 1 or over.wait(BRIEF):
                continue
            told = False
            while not (self.brief or select.select([hears], [], [], 0.02)[0]):
                if not told and time.monotonic() - begin > SOON:
                    told = True
                    _say("interrupted; what is finished is being written; once more ends at once")
            while self.brief and not over.is_set():
                # Again where it came while Python tidied up, which passes over it.
                interrupt_main(signal.Signals(heard[0]))
                over.wait(BRIEF)


def _leave(number: int) -> None:
    """End the process and those that it started, in the middle of whatever it does."""
    for child in active_children():
        child.kill()
    for folder in [*WORKING]:
        shutil.rmtree(folder, ignore_errors=True)
    _say("interrupted in the middle of a long step; nothing was written")
    os._exit(128 + number)


def _say(line: str) -> None:
    with suppress(OSError, ValueError):
        print(f"tsuiseki: {line}", file=sys.stderr, flush=True)


DEADLINE = Deadline()
