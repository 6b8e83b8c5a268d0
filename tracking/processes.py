"""Work on many independent items, a process a core."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import get_context
from typing import TypeVar

import cv2

from tsuiseki.tracking.errors import RunError

Item = TypeVar("Item")
Result = TypeVar("Result")
ENDING = (signal.SIGINT, signal.SIGTERM)


def on_all_cores(
    work: Callable[[Item], Result], items: Sequence[Item], together: int = 1, processes: int = 0
) -> Iterator[Result]:
    """What ``work`` makes of each of ``items``, in their order.

    Where the user interrupts, the processes clean up and end at once; nothing further is begun.

    Args:
        work: a function of a module, or a `partial` of one.
        items: at least one.
        together: how many a process is handed at a time.
        processes: how many at most; 0 takes all cores, 1 does without another process.

    Raises:
        RunError: a process was ended from outside.
    """
    if processes == 1:
        yield from map(work, items)
        return
    try:
        yield from _in_pool(work, items, together, processes or os.cpu_count() or 1)
    except KeyboardInterrupt as interrupt:
        # It ends the processes, too: where the pool misses them first, that is no error to show beside the interrupt.
        raise interrupt from None


def _in_pool(work: Callable[[Item], Result], items: Sequence[Item], together: int, most: int) -> Iterator[Result]:
    processes = min(len(items), most)
    try:
        # Started afresh: a copy of a process that runs threads can lock up.
        with ProcessPoolExecutor(processes, get_context("spawn"), _begin) as pool:
            yield from pool.map(partial(_do, work), items, chunksize=together)
    except BrokenProcessPool as error:
        raise RunError(
            "expected all processes to end by themselves, one was ended from outside, perhaps for want of memory; "
            "try again with fewer programs beside it"
        ) from error


def _begin() -> None:
    cv2.setNumThreads(1)
    for number in ENDING:
        # What the program was started to ignore, in the background say, its processes ignore, too.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _leave)


def _leave(number: int, _: object) -> None:
    # The pool ends all processes when it misses one: that must not cut short what this one still clears away.
    for other in ENDING:
        signal.signal(other, signal.SIG_IGN)
    raise SystemExit(number)


def _do(work: Callable[[Item], Result], item: Item) -> Result:
    try:
        return work(item)
    except SystemExit:
        # The pool would take it for an answer, and hand out the next item.
        os._exit(1)
