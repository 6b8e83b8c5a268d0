"""Work on many independent items, a process a core."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, get_context
from typing import TypeVar

import cv2

from tsuiseki.tracking.errors import ENDING, Interrupted, RunError

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass
class Worker:
    """What a process of a pool is doing.

    Attributes:
        busy: whether it works on an item.
        signal: the number of the first signal that it has heard; 0 for none.
    """

    busy: bool = False
    signal: int = 0


WORKER = Worker()


def on_all_cores(
    work: Callable[[Item], Result], items: Sequence[Item], together: int = 1, processes: int = 0
) -> Iterator[Result]:
    """What ``work`` makes of each of ``items``, in their order.

    Where the user interrupts, the processes clean up and end; nothing further is begun.

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
    count = min(len(items), processes or os.cpu_count() or 1)
    try:
        # Started afresh: a copy of a process that runs threads can lock up.
        with ProcessPoolExecutor(count, get_context("spawn"), _begin) as pool:
            try:
                yield from pool.map(partial(_do, work), items, chunksize=together)
            except KeyboardInterrupt:
                # A signal to this process alone has not reached those of the pool.
                for process in active_children():
                    process.terminate()
                raise
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
            signal.signal(number, _interrupt)


def _interrupt(number: int, _: object) -> None:
    """The first signal ends the work on an item; the next ones must not cut short what it clears away."""
    first, WORKER.signal = not WORKER.signal, WORKER.signal or number
    if first and WORKER.busy:
        raise Interrupted(number)


def _do(work: Callable[[Item], Result], item: Item) -> Result:
    # The pool hands out what it has queued, though nobody waits for it any more.
    if WORKER.signal:
        raise Interrupted(WORKER.signal)
    WORKER.busy = True
    try:
        return work(item)
    finally:
        WORKER.busy = False
