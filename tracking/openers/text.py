"""The bytes and the text of a file, bounded; and content that is not as expected, in one line."""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError

# Bytes of a file that is read as a whole: labels of days of video; what is longer does not fit into memory as text.
MOST_BYTES = 2**31
# Levels of lists and mappings in each other; the formats here need up to 12.
DEEPEST = 64
# Whole numbers are within +-2^64: what is measured, counted or named by a number.
LARGEST_WHOLE = 2**64
MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_BINARY = re.compile(r"[\x00-\x08]")


def read_bytes(path: Path, what: str, most: int = MOST_BYTES) -> bytes:
    """The bytes of a file of ``what``.

    Raises:
        RequestError: there is no such file, it cannot be read, or it has more than ``most`` bytes.
    """
    try:
        if not path.is_file():
            raise RequestError(f"expected {what} at {path}, found no such file")
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise RequestError(f"{path}: expected {what}, cannot read the file ({error.strerror})") from error
    if len(data) > most:
        raise RequestError(f"{path}: expected {what} of up to {most} bytes, got a longer file")
    return data


def read_text(path: Path, what: str, most: int = MOST_BYTES) -> str:
    """The text of a file of ``what``, without the mark that some editors put before the first character.

    It is UTF-8 or UTF-16, or else Latin-1.

    Raises:
        RequestError: there is no such file, it has more than ``most`` bytes, or it is binary.
    """
    data = read_bytes(path, what, most)
    name = next((name for mark, name in MARKS.items() if data.startswith(mark)), None)
    if name is None and len(data) > 1 and 0 in data[:2]:
        name = "utf-16-be" if data[0] == 0 else "utf-16-le"
    try:
        text = data.decode(name or "utf-8")
    except UnicodeDecodeError:
        text = "\0" if name else data.decode("latin-1")
    if _BINARY.search(text):
        raise RequestError(f"{path}: expected a text file of {what}, got something binary")
    return text


@contextmanager
def refusing(message: str, describe: Callable[[Exception], str] = lambda _: "") -> Iterator[None]:
    """What fails within, as content of another kind does, is a RequestError of a message and what ``describe`` says."""
    try:
        yield
    except RequestError:
        raise
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise RequestError(f"{message}{describe(error)}") from error


def check_depth(value: Any, where: str) -> None:
    """Refuse lists and mappings of more than `DEEPEST` levels; raises RequestError."""
    level = [value]
    for _ in range(DEEPEST):
        inner = (x.values() if isinstance(x, dict) else x for x in level if isinstance(x, dict | list))
        level = [*chain.from_iterable(inner)]
        if not level:
            return
    raise RequestError(f"{where}: expected up to {DEEPEST} lists and mappings in each other, got more")
