"""The solver in several processes: the same window at other costs is asked of all of them at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.flow_loss import Problem, Spread


class Solvers:
    """Processes that solve at the same time.

    Args:
        processes: how many; 0 takes all cores, 1 does without another process.
    """

    def __init__(self, processes: int) -> None:
        self.processes = processes or os.cpu_count() or 1
        self._pool: Executor | None = None

    @property
    def spread(self) -> Spread:
        """As `map`; the processes are started when it is first asked for."""
        if self.processes == 1:
            return map
        if self._pool is None:
            self._pool = ProcessPoolExecutor(self.processes, get_context("spawn"))
        pool = self._pool

        def spread(function: Callable[[Problem], FloatArray], items: Iterable[Problem]) -> Iterable[FloatArray]:
            return pool.map(function, items)

        return spread

    def close(self) -> None:
        """Let the processes go."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
