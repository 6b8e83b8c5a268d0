"""Who does the tasks: processes of this machine. One that dies is started again, and its task may be done again."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Protocol

from tsuiseki.tracking.batch.tasks import Outcome, Task, do

LOST = "its process was ended from outside, perhaps for want of memory"
THREADS = "OMP_NUM_THREADS"


class Executor(Protocol):
    """Does several tasks at a time."""

    def free(self) -> bool:
        """Whether another task would soon be begun."""

    def submit(self, task: Task) -> None:
        """Take a task."""

    def finished(self, seconds: float) -> Iterable[tuple[Task, Outcome]]:
        """What was finished, after so many seconds at most."""

    def close(self) -> None:
        """End what is under way."""


class _Worker:
    """A process and the task that it does."""

    def __init__(self) -> None:
        # Started afresh: a copy of a process that runs threads can lock up.
        context = get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_work, args=(other,), daemon=True)
        self.task: Task | None = None
        unset = THREADS not in os.environ
        os.environ.setdefault(THREADS, "1")
        try:
            self.process.start()
        finally:
            if unset:
                del os.environ[THREADS]
        other.close()

    def end(self) -> None:
        self.process.kill()
        self.process.join(5)
        self.pipe.close()


def _work(pipe: Connection) -> None:
    # The terminal's interrupt is for the one who hands out the tasks.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    quiet_opencv()
    try:
        while (task := pipe.recv()) is not None:
            pipe.send(do(task))
    except (EOFError, OSError):
        return


def quiet_opencv() -> None:
    """One thread for OpenCV, and none of its own lines."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    import cv2

    cv2.setNumThreads(1)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


class Processes:
    """Tasks in processes of this machine.

    Args:
        count: of the processes, at least one; each is started when it is first needed.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._workers: list[_Worker] = []

    def free(self) -> bool:
        """See `Executor.free`."""
        return len(self._workers) < self.count or any(worker.task is None for worker in self._workers)

    def submit(self, task: Task) -> None:
        """See `Executor.submit`."""
        worker = next((worker for worker in self._workers if worker.task is None), None)
        if worker is None:
            worker = _Worker()
            self._workers.append(worker)
        worker.task = task
        with suppress(OSError):  # it has died while it had nothing to do, which `finished` finds
            worker.pipe.send(task)

    def finished(self, seconds: float) -> list[tuple[Task, Outcome]]:
        """See `Executor.finished`."""
        busy = [worker for worker in self._workers if worker.task is not None]
        by_pipe = {worker.pipe: worker for worker in busy}
        wait([*by_pipe, *(worker.process.sentinel for worker in busy)], seconds)
        found: list[tuple[Task, Outcome]] = []
        for worker in busy:
            task, alive = worker.task, worker.process.is_alive()
            assert task is not None
            if worker.pipe.poll():
                try:
                    found.append((task, worker.pipe.recv()))
                    worker.task = None
                    continue
                except (EOFError, OSError):
                    alive = False
            if not alive:
                found.append((task, Outcome("lost", LOST)))
                self._workers.remove(worker)
                worker.end()
        return found

    def close(self) -> None:
        """See `Executor.close`."""
        for worker in self._workers:
            worker.end()
        self._workers = []
