"""How a command ends: its exit status, what interrupts it, and one line on stderr where there is something to say."""

from __future__ import annotations

import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from tsuiseki.tracking.cli.deadline import DEADLINE
from tsuiseki.tracking.errors import InputWarning, Interrupted, RequestError, RunError, explained, signal_of

DONE, FAILED, WRONG_REQUEST = 0, 1, 2
# Ways to ask a run to end, as far as the system knows them.
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
# What may end a run late; what was finished before is kept.
LATE = (RequestError, RunError, OSError, MemoryError)
# What was noted of the input since the command began; a process runs one at a time.
NOTES: list[str] = []


def ended(command: Callable[[], int | None]) -> int:
    """The exit status of ``command``, whatever ends it; what went wrong is said in a line."""
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
        return complain(said_of(error) + place, WRONG_REQUEST if isinstance(error, RequestError) else FAILED)
    except KeyboardInterrupt as error:
        kept = error.kept if isinstance(error, Interrupted) else Interrupted().kept
        return complain(f"interrupted; {kept}", 128 + signal_of(error))


def said_of(error: BaseException) -> str:
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
