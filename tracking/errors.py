"""The two ways a run can fail, how it is interrupted, and what it goes on in spite of: one clear line each.

The message says what was expected, what came, and what to do.
"""

from __future__ import annotations

import signal


class RequestError(ValueError):
    """The request was wrong: a missing file, an unknown option, a broken label file. Exit status 2."""


class InputWarning(UserWarning):
    """Something in the input was mended or left out; the command line says so in a line."""


class RunError(RuntimeError):
    """The data turned out broken while running: a truncated video, say. Exit status 1."""


class Interrupted(KeyboardInterrupt):
    """The user asked a run to end. Exit status 128 and the signal's number.

    Args:
        number: the signal.
        kept: what there is of the result, for the user.
    """

    def __init__(self, number: int = signal.SIGINT, kept: str = "nothing was written") -> None:
        super().__init__(number)
        self.number, self.kept = int(number), kept


def signal_of(error: KeyboardInterrupt) -> int:
    """The signal that ``error`` stands for."""
    return error.number if isinstance(error, Interrupted) else int(signal.SIGINT)
