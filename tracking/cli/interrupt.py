"""Ctrl-C between two frames instead of in the middle of one, so that what is finished can be kept."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TypeVar

INTERRUPTED = 130

T = TypeVar("T")


class Interrupt:
    """Whether the user asked to stop."""

    def __init__(self) -> None:
        self.asked = False

    def until_asked(self, items: Iterable[T]) -> Iterator[T]:
        """``items`` up to the moment when the user asks to stop."""
        for item in items:
            yield item
            if self.asked:
                return


@contextmanager
def graceful_interrupt() -> Iterator[Interrupt]:
    """Within the ``with`` block the first Ctrl-C only sets `Interrupt.asked`; a second one interrupts at once."""
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return

    def ask(_number: int, _frame: FrameType | None) -> None:
        if interrupt.asked:
            raise KeyboardInterrupt
        interrupt.asked = True

    before = signal.signal(signal.SIGINT, ask)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, before)


def report_partial(last: int, folder: Path) -> int:
    """Say that the run ended with the 0-based frame ``last`` and what is left of it; returns the exit status."""
    print(
        f"tsuiseki: interrupted after frame {last + 1}; the partial result is in {folder}, marked in its run.json",
        file=sys.stderr,
    )
    return INTERRUPTED
