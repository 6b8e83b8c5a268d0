"""Who does the tasks: processes of this machine, or Ray here or on a cluster. A task whose process died is done again.

What a task reads and leaves lies in files; only its `TaskOutcome` comes back.
"""

from __future__ import annotations

import logging
import os
import re
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from io import StringIO
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Any

from tsuiseki.tracking.batch.tasks import BatchTask, TaskOutcome, do
from tsuiseki.tracking.errors import RequestError, RunError

LOST = "its process was ended from outside, perhaps for want of memory"
THREADS = "OMP_NUM_THREADS"
# The address of a Ray that begins and ends with the batch.
HERE = "here"
# Bytes of its object store, which holds little: results lie in files.
STORE = 100_000_000
# Seconds within which a cluster answers.
PATIENCE = 10.0
# Tasks that wait on Ray beside those that are under way, so that no worker waits for the next.
AHEAD = 2


def _do(task: BatchTask) -> TaskOutcome:
    """Do a task with one thread for OpenCV, which prints no lines of its own."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    import cv2

    cv2.setNumThreads(1)
    return do(task)


class _Worker:
    """A process and the task that it does."""

    def __init__(self) -> None:
        # Started afresh: a copy of a process that runs threads can lock up.
        context = get_context("spawn")
        self.pipe, worker_end = context.Pipe()
        self.process = context.Process(target=_work, args=(worker_end,), daemon=True)
        self.task: BatchTask | None = None
        unset = os.environ.setdefault(THREADS, "1") if THREADS not in os.environ else ""
        try:
            self.process.start()
        finally:
            if unset:
                del os.environ[THREADS]
        worker_end.close()

    def end(self) -> None:
        self.process.kill()
        self.process.join(5)
        self.pipe.close()


def _work(pipe: Connection) -> None:
    # The terminal's interrupt is for the one who hands out the tasks.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            pipe.send(_do(pipe.recv()))


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
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
        """Whether another task would soon be begun."""
        return len(self._workers) < self.count or any(worker.task is None for worker in self._workers)

    def submit(self, task: BatchTask) -> None:
        """Take a task."""
        worker = next((worker for worker in self._workers if worker.task is None), None)
        if worker is None:
            worker = _Worker()
            self._workers.append(worker)
        worker.task = task
        with suppress(OSError):  # it has died while it had nothing to do, which `finished` finds
            worker.pipe.send(task)

    def finished(self, seconds: float) -> list[tuple[BatchTask, TaskOutcome]]:
        """What was finished, after so many seconds at most."""
        busy = [worker for worker in self._workers if worker.task is not None]
        wait([handle for worker in busy for handle in (worker.pipe, worker.process.sentinel)], seconds)
        outcomes: list[tuple[BatchTask, TaskOutcome]] = []
        for worker in busy:
            task, outcome, alive = worker.task, None, worker.process.is_alive()
            assert task is not None
            with suppress(EOFError, OSError):
                outcome = worker.pipe.recv() if worker.pipe.poll() else None
            if outcome is not None:
                worker.task = None
                outcomes.append((task, outcome))
            elif not alive:
                outcomes.append((task, TaskOutcome("lost", LOST)))
                self._workers.remove(worker)
                worker.end()
        return outcomes

    def close(self) -> None:
        """End what is under way."""
        for worker in self._workers:
            worker.end()
        self._workers = []


class RayTasks:
    """Tasks on Ray.

    Args:
        address: ``host:port`` of a cluster, ``auto`` for the one that this machine is part of, or `HERE`.
        count: of the CPUs of a Ray of one's own.
        gpus: share of a GPU that each task takes.

    Raises:
        RequestError: Ray is not installed, no cluster answers, or it runs another version.
    """

    def __init__(self, address: str, count: int, gpus: float = 0.0) -> None:
        try:
            import ray
        except ImportError as error:
            raise RequestError("`ray`: Ray is not installed; pip install 'tsuiseki[ray]'") from error
        self._ray, self._waiting = ray, dict[Any, BatchTask]()
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        how: dict[str, Any] = {"address": address}
        if address == HERE:
            how = {"num_cpus": count, "object_store_memory": STORE, "include_dashboard": False, "address": "local"}
        else:
            _check_answer(address)
        environment = {"env_vars": {} if THREADS in os.environ else {THREADS: "1"}}
        try:
            with _quiet():
                ray.init(**how, log_to_driver=False, logging_level=logging.CRITICAL, runtime_env=environment)
        except Exception as error:
            raise RequestError(f"`ray`: {_reason(error, address, ray.__version__)}") from error
        sys.stdout = self._muted = _Muted(sys.stdout)
        if self._asked(ray.cluster_resources).get("GPU", 0.0) < gpus:
            self.close()
            raise RequestError(f"`gpus`: expected {gpus:g} of a GPU, but no machine of this Ray has one")
        self._remote: Any = ray.remote(num_cpus=1, num_gpus=gpus, max_retries=0, retry_exceptions=False)(_do)

    def free(self) -> bool:
        return len(self._waiting) < int(self._asked(self._ray.cluster_resources).get("CPU", 1)) + AHEAD

    def submit(self, task: BatchTask) -> None:
        self._waiting[self._asked(self._remote.remote, task)] = task

    def finished(self, seconds: float) -> list[tuple[BatchTask, TaskOutcome]]:
        ready, _ = self._asked(self._ray.wait, [*self._waiting], num_returns=1, timeout=seconds)
        outcomes = []
        for reference in ready:
            try:
                outcome = self._ray.get(reference, timeout=PATIENCE)
            except self._ray.exceptions.RayTaskError as error:
                outcome = TaskOutcome("failed", f"{type(error.cause).__name__}: {error.cause}")
            except self._ray.exceptions.RayError as error:
                # Not a worker that has gone, but what this process speaks to Ray by.
                alone = isinstance(error, self._ray.exceptions.LocalRayletDiedError)
                if alone or not any(node["Alive"] for node in self._asked(self._ray.nodes)):
                    raise RunError("Ray has gone from this machine; give the same command again: it goes on") from error
                outcome = TaskOutcome("lost", LOST)
            outcomes.append((self._waiting.pop(reference), outcome))
        return outcomes

    def close(self) -> None:
        with _quiet():
            for reference in self._waiting:
                self._ray.cancel(reference, force=True)
            self._ray.shutdown()
        sys.stdout = self._muted.stream

    def _asked(self, call: Any, *values: Any, **options: Any) -> Any:
        """What Ray answers; raises RunError where it has gone."""
        try:
            return call(*values, **options)
        except (self._ray.exceptions.RaySystemError, ConnectionError, RuntimeError, ValueError) as error:
            raise RunError(
                f"Ray does not answer any more ({_first_line(error)}); give the same command again: it goes on"
            ) from error


class _Muted:
    """A stream that threads of Ray do not write to: lines of the raylet come through them whatever one sets."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        return len(text) if threading.current_thread().name.startswith("ray_") else int(self.stream.write(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def _quiet() -> Iterator[None]:
    """Nothing is printed: parts of Ray that are not Python write to the terminal themselves."""
    with suppress(OSError, ValueError):
        sys.stderr.flush()
    saved = os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nothing)


def _check_answer(address: str) -> None:
    """Refuse an address without a listener."""
    place = re.fullmatch(r"(?:ray://)?([^:/]+|\[[^\]]+\]):(\d+)", address)
    if place is None and address != "auto":
        raise RequestError(f"`ray`: expected an address host:port, or auto, got {address}")
    try:
        if place is not None:
            socket.create_connection((place[1].strip("[]"), int(place[2])), PATIENCE).close()
    except (OSError, OverflowError) as error:
        raise RequestError(f"`ray`: no cluster answers at {address}: {error}; is its head running?") from error


def _reason(error: Exception, address: str, version: str) -> str:
    if not re.search(r"[Vv]ersion mismatch", str(error)):
        return f"no Ray at {address}: {_first_line(error)}"
    theirs = re.search(r"Ray: ([\w.]+)", str(error))
    their_version = "another" if theirs is None else theirs[1]
    return f"the cluster at {address} runs Ray {their_version}, here is {version}; install the same, Python's too"


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:160]
