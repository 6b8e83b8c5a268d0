"""How a command ends: its exit status, what interrupts it, and one line on stderr where there is something to say.

Python runs a signal's handler only between its own instructions. A thread of its own hears of the signal beside it:
where one is not answered within a second, the process leaves in the middle of a long native call.
"""

from __future__ import annotations

import os
import re
import select
import shutil
import signal
import sys
import threading
import time
import warnings
from _thread import interrupt_main
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from types import FrameType
from typing import Any

from tsuiseki.tracking.errors import InputWarning, Interrupted, RequestError, RunError, explained, signal_of
from tsuiseki.tracking.output import WORKING

DONE, FAILED, WRONG_REQUEST, SIGNALLED = 0, 1, 2, 128
# Ways to ask a run to end, as far as the system knows them.
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
# What may end a run late; what was finished before is kept.
LATE = (RequestError, RunError, OSError, MemoryError)
# What was noted of the input since the command began; a process runs one at a time.
NOTES: list[str] = []
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
            reported = False
            while not (self.brief or select.select([hears], [], [], 0.02)[0]):
                if not reported and time.monotonic() - begin > SOON:
                    reported = True
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
    os._exit(SIGNALLED + number)


def _say(line: str) -> None:
    with suppress(OSError, ValueError):
        print(f"tsuiseki: {line}", file=sys.stderr, flush=True)


DEADLINE = Deadline()


def ended(command: Callable[[], int | None]) -> int:
    """The exit status of ``command``, whatever ends it; what went wrong is reported in a line."""
    try:
        with DEADLINE.held(ENDING), on_signals(_interrupt), _warnings_in_a_line():
            return int(command() or DONE)
    except SystemExit as done:
        return int(done.code or DONE)
    except ImportError as error:
        known = explained(error)
        if known is None:
            raise
        return complain(known, WRONG_REQUEST if isinstance(known, RequestError) else FAILED)
    except BrokenPipeError:
        sys.stderr.close()
        return FAILED
    except LATE as error:
        place = f" ({error.filename})" if isinstance(error, OSError) and error.filename else ""
        return complain(message_of(error) + place, WRONG_REQUEST if isinstance(error, RequestError) else FAILED)
    except KeyboardInterrupt as error:
        kept = error.kept if isinstance(error, Interrupted) else Interrupted().kept
        return complain(f"interrupted; {kept}", SIGNALLED + signal_of(error))


def message_of(error: BaseException) -> str:
    """What one of `LATE` says to people."""
    if isinstance(error, MemoryError):
        return f"not enough memory{f': {error}' if str(error) else ''}"
    return f"{error.strerror or error}" if isinstance(error, OSError) else str(error)


@contextmanager
def on_signals(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Within the ``with`` block `ENDING` goes to ``handler``, save what this process was started to ignore."""
    numbers = ENDING if threading.current_thread() is threading.main_thread() else ()
    before = {number: old for number in numbers if (old := signal.getsignal(number)) is not signal.SIG_IGN}
    try:
        for number in before:
            signal.signal(number, handler)
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def _interrupt(number: int, _: FrameType | None) -> None:
    DEADLINE.answered += 1
    raise Interrupted(number)


@contextmanager
def _warnings_in_a_line() -> Iterator[None]:
    """Within the ``with`` block every `InputWarning` is printed once as a note, and kept in `NOTES`."""
    NOTES.clear()
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputWarning)
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if not issubclass(category, InputWarning):
                usual(message, category, *place, **more)
            elif str(message) not in NOTES:
                NOTES.append(str(message))
                complain(f"note: {message}", DONE)

        warnings.showwarning = show
        yield


def complain(message: object, status: int) -> int:
    """Print one line to stderr; returns ``status``."""
    # The library speaks of arguments, in backquotes.
    message = re.sub(r"`(\w+(?:\.\w+)*)`", lambda name: "--" + name[1].replace("_", "-"), str(message))
    print(f"tsuiseki: {' '.join(str(message).split())}", file=sys.stderr)
    return status
