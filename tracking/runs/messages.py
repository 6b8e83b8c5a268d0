"""What a command says on stderr: one line for what went wrong, and one for each note about its input."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError, lacks_memory

# What was noted of the input since the command began; a process runs one at a time.
NOTES: list[str] = []


def complain(message: object, status: int = 0) -> int:
    """Print one line to stderr; returns ``status``."""
    # The library speaks of arguments, in backquotes.
    message = re.sub(r"`(\w+(?:\.\w+)*)`", lambda name: "--" + name[1].replace("_", "-"), str(message))
    # A signal's handler may interrupt another line, and the terminal may be gone.
    with suppress(RuntimeError, OSError, ValueError):
        print(f"tsuiseki: {' '.join(str(message).split())}", file=sys.stderr)
    return status


def message_of(error: BaseException) -> str:
    """What ``error`` says to people."""
    if isinstance(error, MemoryError):
        return f"not enough memory{f': {error}' if str(error) else ''}"
    if not isinstance(error, OSError | RequestError | RunError) and lacks_memory(error):
        return "not enough memory"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror + (f" ({error.filename})" if error.filename else "")
    return str(error)


@contextmanager
def notes_in_a_line() -> Iterator[None]:
    """Within the ``with`` block every `InputWarning` is printed once as a note, and kept in `NOTES`."""
    NOTES.clear()
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputWarning)
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **details: Any) -> None:
            if not issubclass(category, InputWarning):
                usual(message, category, *place, **details)
            elif str(message) not in NOTES:
                NOTES.append(str(message))
                complain(f"note: {message}")

        warnings.showwarning = show
        yield
