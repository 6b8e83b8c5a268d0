"""The two ways a run can fail, how it is interrupted, and what it goes on in spite of: one clear line each.

The message says what was expected, what came, and what to do.
"""

from __future__ import annotations

import difflib
import re
import signal
from collections.abc import Sequence
from pathlib import Path

# Signals that ask a program to end, as far as the system knows them.
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


# Characters of a word in a message: a path of a deep folder; what is longer came out of a broken file.
LONGEST_WORD = 400


def in_a_line(message: object) -> str:
    """A message in one line, whose words are at most as long as a path.

    >>> in_a_line("expected a number,\\n  got " + "9" * 5000)[:30]
    'expected a number, got 9999999'
    """
    line = re.sub(r"\s*[\n\r]\s*", " ", str(message))
    return re.sub(rf"\S{{{LONGEST_WORD + 1},}}", lambda word: word[0][: LONGEST_WORD - 3] + "...", line)


class RequestError(ValueError):
    """The request was wrong: a missing file, an unknown option, a broken label file. Exit status 2."""

    def __init__(self, message: object = "") -> None:
        super().__init__(in_a_line(message))


class AbsentCameraError(RequestError):
    """Nothing answers at the address of a camera."""


def a_path(value: object, name: str = "path") -> Path:
    """``value`` as a path; raises RequestError where the argument ``name`` is none, or empty."""
    if not isinstance(value, str | Path):
        raise RequestError(f"`{name}`: expected a path, got {type(value).__name__}")
    if isinstance(value, str) and not value.strip():
        raise RequestError(f"`{name}`: expected a path, got an empty one; . is the current folder")
    return Path(value)


def check_choice(value: object, choices: Sequence[object], name: str) -> None:
    """Refuse an argument that is none of its choices.

    >>> check_choice("sort", ("flow", "flow-saf"), "method")
    Traceback (most recent call last):
    tsuiseki.tracking.errors.RequestError: `method`: expected flow or flow-saf, got 'sort'
    """
    if value not in choices:
        *first, last = map(str, choices)
        raise RequestError(f"`{name}`: expected {', '.join(first)} or {last}, got {value!r}")


def hint_at(name: str, names: Sequence[str]) -> str:
    """What to write in place of an unknown name: the nearest of the ``names``, or one of all."""
    near = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {near[0]}?" if near else f"expected one of {', '.join(names) or 'none'}"


class InputWarning(UserWarning):
    """Something in the input was mended or left out; the command line says so in a line."""


class RunError(RuntimeError):
    """The data turned out broken while running: a truncated video, say. Exit status 1."""

    def __init__(self, message: object = "") -> None:
        super().__init__(in_a_line(message))


class Interrupted(KeyboardInterrupt):
    """The user asked a run to end. Exit status 128 and the signal's number.

    Args:
        number: the signal.
        written: what there is of the result, for the user.
    """

    def __init__(self, number: int = signal.SIGINT, written: str = "nothing was written") -> None:
        super().__init__(number)
        self.number, self.written = int(number), written


def signal_of(error: KeyboardInterrupt) -> int:
    """The signal that ``error`` stands for."""
    return error.number if isinstance(error, Interrupted) else int(signal.SIGINT)


ADVICE = (
    "another package has brought opencv-python in the place of opencv-python-headless; give `pip uninstall -y "
    "opencv-python opencv-contrib-python`, then `pip install --force-reinstall --no-deps opencv-python-headless`"
)


TRAIN_PACKAGES = ("torch", "torchvision", "lightning", "onnx", "onnxscript", "sklearn", "skl2onnx", "tensorboard")


def explained(error: ImportError) -> RunError | RequestError | None:
    """The failure to load OpenCV or what trains as an error that says what to do; None where it was something else.

    >>> str(explained(ImportError("libGL.so.1: cannot open shared object file"))).split(";")[0]
    'OpenCV does not load, for libGL.so.1 is not there'
    >>> explained(ImportError("No module named 'tsuiseki.flow'"))
    """
    if (error.name or "").split(".")[0] in TRAIN_PACKAGES:
        return RequestError(
            f"training needs {error.name}, which is not installed; install the extra: pip install 'tsuiseki[train]'"
        )
    if error.name == "cv2":
        return RunError("OpenCV is not installed; give `pip install opencv-python-headless`")
    library = re.match(r"(lib[\w.+-]+\.so[\w.]*): cannot open shared object file", str(error))
    if library is None:
        return None
    return RunError(f"OpenCV does not load, for {library[1]} is not there; {ADVICE}")


# How OpenCV, onnxruntime, torch, CUDA, the loader of libraries and Python's threads word it.
MEMORY_SIGNS = (
    "insufficient memory",
    "not enough memory",
    "cannot allocate memory",
    "failed to allocate memory",
    "can't allocate memory",
    "out of memory",
    "smaller than requested bytes",
    "bad_alloc",
    "failed to map segment",
    "can't start new thread",
)


def lacks_memory(error: BaseException | None) -> bool:
    """Whether an error, or what it came from, is a lack of memory.

    >>> lacks_memory(RuntimeError("std::bad_alloc"))
    True
    """
    # Some libraries chain errors in a circle.
    passed: set[int] = set()
    while error is not None and id(error) not in passed:
        passed.add(id(error))
        if isinstance(error, MemoryError) or any(sign in str(error).lower() for sign in MEMORY_SIGNS):
            return True
        error = error.__cause__ or error.__context__
    return False
