"""The same tasks on Ray: on this machine or a cluster. What a task reads and leaves lies in files."""

from __future__ import annotations

import logging
import os
import re
import socket
import sys
import threading
from collections.abc import Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from typing import Any

from tsuiseki.tracking.batch.executors import LOST, THREADS, quiet_opencv
from tsuiseki.tracking.batch.tasks import Outcome, Task, do
from tsuiseki.tracking.errors import RequestError, RunError

HERE = "here"
# Bytes of the object store of a Ray of one's own: results lie in files.
STORE = 100_000_000
# Seconds within which a cluster answers.
PATIENCE = 10.0
# Tasks that wait on Ray beside those that are under way, so that no worker waits for the next.
AHEAD = 2


class RayTasks:
    """Tasks on Ray.

    Args:
        address: ``host:port`` of a cluster, ``auto`` for the one that this machine is part of, or `HERE` for a Ray that
            begins and ends with the batch.
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
        self._ray, self.count = ray, count
        self._waiting: dict[Any, Task] = {}
        environment: dict[str, str] = {}
        if THREADS not in os.environ:
            environment[THREADS] = "1"
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        how: dict[str, Any] = {"address": address}
        if address == HERE:
            how = {"num_cpus": count, "object_store_memory": STORE, "include_dashboard": False, "address": "local"}
        else:
            _answers(address)
        try:
            with _quiet():
                ray.init(
                    **how, log_to_driver=False, logging_level=logging.CRITICAL, runtime_env={"env_vars": environment}
                )
        except Exception as error:
            raise RequestError(f"`ray`: {_reason(error, address, ray.__version__)}") from error
        self._muted = _Muted(sys.stdout)
        sys.stdout = self._muted
        if self._asked(self._ray.cluster_resources).get("GPU", 0.0) < gpus:
            self.close()
            raise RequestError(f"`gpus`: expected {gpus:g} of a GPU, but no machine of this Ray has one")
        self._remote: Any = ray.remote(num_cpus=1, num_gpus=gpus, max_retries=0, retry_exceptions=False)(_do)

    def free(self) -> bool:
        """See `Executor.free`."""
        cores = int(self._asked(self._ray.cluster_resources).get("CPU", 1))
        return len(self._waiting) < cores + AHEAD

    def submit(self, task: Task) -> None:
        """See `Executor.submit`."""
        self._waiting[self._asked(self._remote.remote, task)] = task

    def finished(self, seconds: float) -> list[tuple[Task, Outcome]]:
        """See `Executor.finished`."""
        ready, _ = self._asked(self._ray.wait, [*self._waiting], num_returns=1, timeout=seconds)
        found = []
        for reference in ready:
            try:
                outcome = self._ray.get(reference, timeout=PATIENCE)
            except self._ray.exceptions.RayTaskError as error:
                outcome = Outcome("failed", f"{type(error.cause).__name__}: {error.cause}")
            except self._ray.exceptions.RayError as error:
                self._refuse_end(error)
                outcome = Outcome("lost", LOST)
            found.append((self._waiting.pop(reference), outcome))
        return found

    def close(self) -> None:
        """See `Executor.close`."""
        with _quiet():
            for reference in self._waiting:
                self._ray.cancel(reference, force=True)
            self._ray.shutdown()
        sys.stdout = self._muted.stream

    def _refuse_end(self, error: Exception) -> None:
        """Raise RunError where it is not a worker that has gone, but what this process speaks to Ray by."""
        alone = isinstance(error, self._ray.exceptions.LocalRayletDiedError)
        if alone or not any(node["Alive"] for node in self._asked(self._ray.nodes)):
            raise RunError("Ray has gone from this machine; give the same command again: it goes on") from error

    def _asked(self, call: Any, *values: Any, **more: Any) -> Any:
        """What Ray answers; raises RunError where it has gone."""
        try:
            return call(*values, **more)
        except (self._ray.exceptions.RaySystemError, ConnectionError, RuntimeError, ValueError) as error:
            raise RunError(
                f"Ray does not answer any more ({_first_line(error)}); give the same command again: it goes on"
            ) from error


def _do(task: Task) -> Outcome:
    quiet_opencv()
    return do(task)


class _Muted:
    """A stream that threads of Ray do not write to: lines of the raylet come through them whatever one sets."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        return len(text) if threading.current_thread().name.startswith("ray_") else int(self.stream.write(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def _quiet() -> Any:
    """Nothing is printed, by what is not Python neither: parts of Ray write to the terminal themselves."""
    before, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            yield
    finally:
        os.dup2(before, 2)
        os.close(before)
        os.close(nowhere)


def _answers(address: str) -> None:
    """Refuse an address where nobody listens."""
    place = re.fullmatch(r"(?:ray://)?([^:/]+|\[[^\]]+\]):(\d+)", address)
    if place is None:
        if address != "auto":
            raise RequestError(f"`ray`: expected an address host:port, or auto, got {address}")
        return
    try:
        socket.create_connection((place[1].strip("[]"), int(place[2])), PATIENCE).close()
    except (OSError, OverflowError) as error:
        raise RequestError(f"`ray`: no cluster answers at {address}: {error}; is its head running?") from error


def _reason(error: Exception, address: str, version: str) -> str:
    text = str(error)
    if re.search(r"[Vv]ersion mismatch", text):
        theirs: Mapping[str, str] = re.search(r"Ray: (?P<ray>[\w.]+)", text) or {"ray": "another"}  # type: ignore[assignment]
        return f"the cluster at {address} runs Ray {theirs['ray']}, here is {version}; install the same, Python's too"
    return f"no Ray at {address}: {_first_line(error)}"


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:160]
