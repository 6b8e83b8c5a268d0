"""How a command ends: the signals that end it, its exit status, and one line on stderr where something went wrong.

A signal raises `Interrupted` at once, unless a run has taken it over; the states of `tracking.runs.run` say what it
does there. Python calls a signal's handler between two of its own instructions: a long call of a library, such as a
network on a batch or the exact solver, is not cut short.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from tsuiseki.tracking.errors import ENDING, Interrupted, RequestError, RunError, explained, lacks_memory, signal_of
from tsuiseki.tracking.runs.messages import complain, message_of, notes_in_a_line

# Exit status of a command that did what it was asked for.
DONE = 0
# Of one that failed on its way.
FAILED = 1
# Of one that cannot be done as it was asked for.
WRONG_REQUEST = 2
# What a shell adds to the number of the signal that ended a command.
SIGNALLED = 128
# What may end a run late; what was finished before is kept.
LATE = (RequestError, RunError, OSError, MemoryError)


def is_late(error: BaseException) -> bool:
    """Whether an error may end a run late: one of `LATE`, or a lack of memory in whatever words."""
    return isinstance(error, LATE) or (isinstance(error, Exception) and lacks_memory(error))


# Seconds within which a signal that comes again is the same: `timeout` sends it to the process and to its group.
TWICE = 0.25


def ended(command: Callable[[], int | None]) -> int:
    """The exit status of ``command``, whatever ends it; what went wrong is reported in a line."""
    try:
        with on_signals(_interrupt), notes_in_a_line():
            return int(command() or DONE)
    except SystemExit as done:
        return int(done.code or DONE)
    except BrokenPipeError:
        sys.stderr.close()
        return FAILED
    except Exception as error:
        explanation: BaseException | None = error if isinstance(error, LATE) else None
        # Whatever a lack of memory was taken for on its way here, such as a file that cannot be read.
        if not isinstance(error, MemoryError) and lacks_memory(error if explanation is None else error.__cause__):
            explanation = MemoryError()
        elif isinstance(error, ImportError):
            explanation = explained(error)
        if explanation is None:
            raise
        return complain(message_of(explanation), WRONG_REQUEST if isinstance(explanation, RequestError) else FAILED)
    except KeyboardInterrupt as error:
        written = error.written if isinstance(error, Interrupted) else Interrupted().written
        return complain(f"interrupted; {written}", SIGNALLED + signal_of(error))


@contextmanager
def on_signals(handler: Callable[[int], object]) -> Iterator[None]:
    """Within the ``with`` block the number of an `ENDING` signal goes to ``handler``.

    Signals that this process was started to ignore, in the background say, stay ignored.
    """
    heard = dict.fromkeys(ENDING, -TWICE)

    def hear(number: int, _: FrameType | None) -> None:
        last, heard[number] = heard[number], time.monotonic()
        if heard[number] - last > TWICE:
            handler(number)

    numbers = ENDING if threading.current_thread() is threading.main_thread() else ()
    usual = {number: old for number in numbers if (old := signal.getsignal(number)) is not signal.SIG_IGN}
    try:
        for number in usual:
            signal.signal(number, hear)
        yield
    finally:
        for number, old in usual.items():
            signal.signal(number, old)


def _interrupt(number: int) -> None:
    raise Interrupted(number)
