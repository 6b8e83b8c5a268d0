"""Seconds of each stage of a run."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class StageTimes:
    """Seconds per stage, together no more than the run took: by default those of the wall clock.

    While several threads work, each moment is shared out among the stages that they are in; of stages within each other
    the inner one counts.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    clock: Callable[[], float] = field(default=lambda: time.perf_counter(), repr=False, compare=False)
    _under_way: dict[int, list[str]] = field(default_factory=dict, repr=False, compare=False)
    _last: float = field(default=0.0, repr=False, compare=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time spent inside the ``with`` block to ``stage``."""
        thread = threading.get_ident()
        with self._lock:
            self._share_out()
            self._under_way.setdefault(thread, []).append(stage)
        try:
            yield
        finally:
            with self._lock:
                self._share_out()
                self._under_way[thread].remove(stage)
                if not self._under_way[thread]:
                    del self._under_way[thread]

    def _share_out(self) -> None:
        """The time since the last call among the stages that are under way."""
        now = self.clock()
        for stages in self._under_way.values():
            share = (now - self._last) / len(self._under_way)
            self.seconds[stages[-1]] = self.seconds.get(stages[-1], 0.0) + share
        self._last = now
