"""The two ways a run can fail, and what it goes on in spite of, each shown to the user as one clear line.

The message says what was expected, what came, and what to do.
"""


class RequestError(ValueError):
    """The request was wrong: a missing file, an unknown option, a broken label file. Exit status 2."""


class InputWarning(UserWarning):
    """Something in the input was mended or left out; the command line says so in a line."""


class RunError(RuntimeError):
    """The data turned out broken while running: a truncated video, say. Exit status 1."""
