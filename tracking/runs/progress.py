"""How far long work is: a bar on a terminal, plain lines elsewhere; all on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Generator, Iterable
from typing import TypeVar

T = TypeVar("T")
# Where there is no terminal: a log of a long run stays short.
SECONDS_BETWEEN_LINES = 10.0


def progress(items: Iterable[T], what: str, total: int | None = None) -> Generator[T]:
    """Pass ``items`` through and show how many went by, of a ``total`` where it is known; ``what`` is being done."""
    yield from (_bar if sys.stderr.isatty() else _lines)(items, what, total)


def _bar(items: Iterable[T], what: str, total: int | None) -> Generator[T]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        yield from bar.track(items, total, description=what)


def _lines(items: Iterable[T], what: str, total: int | None) -> Generator[T]:
    of, last, done = f"/{total}" if total else "", time.monotonic(), 0
    for done, item in enumerate(items, start=1):
        yield item
        if time.monotonic() - last >= SECONDS_BETWEEN_LINES:
            last = time.monotonic()
            print(f"{what}: {done}{of}", file=sys.stderr, flush=True)
    print(f"{what}: {done}{of} done", file=sys.stderr, flush=True)
