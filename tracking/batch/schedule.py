"""The order of the tasks of a batch, and what becomes of it: kept in a journal, so that anyone can ask at any time."""

from __future__ import annotations

import heapq
import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Literal

from tsuiseki.tracking.batch.executors import Executor
from tsuiseki.tracking.batch.jobs import STATE, Job
from tsuiseki.tracking.batch.tasks import Kind, Outcome, Task, plain
from tsuiseki.tracking.errors import RunError

# Attempts at a task whose process died or whose network failed.
ATTEMPTS = 3
TURNS: dict[Kind, int] = {"finish": 0, "join": 0, "look": 1, "begin": 2, "whole": 1}
JOURNAL = "journal.jsonl"


@dataclass
class Row:
    """What became of a video.

    Attributes:
        name: of the folder of its result.
        source: as it was given.
        status: ``waiting``, ``running``, ``done``, ``failed``, or ``kept`` where the result was there.
        line: what came out, or why nothing.
        frames: of the result.
        tracks: likewise; None where there are none to count.
        seconds: that its tasks took together.
        parts: stretches altogether and done.
    """

    name: str
    source: str
    status: Literal["waiting", "running", "done", "failed", "kept"] = "waiting"
    line: str = ""
    frames: int = 0
    tracks: int | None = None
    seconds: float = 0.0
    parts: list[int] = field(default_factory=lambda: [0, 0])


class Journal:
    """A line an event; whoever reads it passes over a last line that is torn."""

    def __init__(self, batch: Path) -> None:
        self._file: IO[str] = (batch / STATE / JOURNAL).open("a", encoding="utf-8")

    def note(self, event: str, **values: Any) -> None:
        """Add an event."""
        self._file.write(json.dumps({"time": round(time.time(), 3), "event": event, **values}) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Nothing follows."""
        self._file.close()


class Schedule:
    """Hands out the tasks of jobs in their order: those of a video that was begun before those of the next.

    Args:
        jobs: of the batch.
        task: makes a task: order, turn, part, kind and job.
        journal: is told.
        changed: is called whenever a video is finished.
        continuous: the videos follow each other, and are finished together.

    Attributes:
        rows: what became of each so far.
        last: name of the one that was finished last.
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        task: Callable[[int, int, int, Kind, Job], Task],
        journal: Journal,
        changed: Callable[[], None],
        continuous: bool = False,
    ) -> None:
        self.rows = [Row(job.name, job.source) for job in jobs]
        self._jobs, self._task, self._journal, self._changed = jobs, task, journal, changed
        self.last = ""
        self._ready: list[Task] = []
        self._left: Counter[int] = Counter()
        self._tries: Counter[str] = Counter()
        self._continuous, self._there, self._joining = continuous, set[int](), set[int]()
        for order in range(len(jobs)):
            self._add(order, "begin")

    def run(self, executor: Executor) -> None:
        """Do all of it.

        Raises:
            RunError: the disk is full.
        """
        under_way = 0
        while self._ready or under_way:
            while self._ready and executor.free():
                task = heapq.heappop(self._ready)
                row = self.rows[task.order]
                if row.status == "failed":
                    continue
                row.status = "running"
                self._journal.note("begin", name=row.name, kind=task.kind, part=task.part)
                executor.submit(task)
                under_way += 1
            for task, outcome in executor.finished(1.0) if under_way else ():
                under_way -= 1
                self._take(task, outcome)

    def _add(self, order: int, kind: Kind, part: int = 0, **more: Any) -> None:
        task = self._task(order, TURNS[kind], part, kind, self._jobs[order])
        heapq.heappush(self._ready, replace(task, **more))

    def _take(self, task: Task, outcome: Outcome) -> None:
        row = self.rows[task.order]
        row.seconds += outcome.seconds
        told = {"name": row.name, "kind": task.kind, "part": task.part, "seconds": round(outcome.seconds, 3)}
        self._journal.note(outcome.status, **told, line=outcome.line, frames=outcome.facts.get("frames", 0))
        if outcome.status == "full":
            raise RunError(f"{outcome.line}; free some and give the same command again: it goes on")
        if row.status == "failed":
            return
        if outcome.status == "lost":
            self._tries[str(task)] += 1
            if self._tries[str(task)] < ATTEMPTS:
                heapq.heappush(self._ready, task)
                return
            self._fail(task, f"{outcome.line} ({ATTEMPTS} attempts)")
        elif outcome.status == "failed" or (outcome.status == "unfit" and self._continuous):
            self._known(row, outcome)
            self._fail(task, outcome.line)
        elif outcome.status == "unfit":
            self._add(task.order, "whole")
            row.line = outcome.line
            self._left[task.order] = -1
        elif task.kind == "begin":
            self._begun(task, outcome, row)
        elif task.kind == "look":
            row.parts[1] += 1
            self._left[task.order] -= 1
            if self._left[task.order] == 0:
                self._looked(task.order)
        elif task.kind == "join":
            for order in sorted(self._joining):
                self._add(order, "finish")
        else:
            self._known(row, outcome)
            self._end(row, "done", outcome.line)

    def _fail(self, task: Task, line: str) -> None:
        """Give up a video; where its files were to be joined, all of them."""
        for order in sorted(self._joining) if task.kind == "join" else [task.order]:
            self._end(self.rows[order], "failed", line)
        if task.kind in ("begin", "look"):
            self._join()

    def _begun(self, task: Task, outcome: Outcome, row: Row) -> None:
        facts = outcome.facts
        if facts.get("there"):
            self._known(row, outcome)
            self._there.add(task.order)
            if not self._continuous:
                self._end(row, "kept", "the result was there")
            self._join()
            return
        parts, done = facts.get("parts", 0), facts.get("done", [])
        row.parts = [parts, len(done)]
        self._left[task.order] = parts - len(done)
        for part in range(parts):
            if part not in done:
                self._add(task.order, "look", part)
        if self._continuous and not parts:
            self._end(row, "failed", "this video cannot be looked at in stretches, as `continuous` needs")
            self._join()
        elif parts == len(done) and parts:
            self._looked(task.order)
        elif not parts:
            self._add(task.order, "whole")

    def _looked(self, order: int) -> None:
        """All stretches of a video are done."""
        if not self._continuous:
            self._add(order, "finish")
            return
        self._joining.add(order)
        self._join()

    def _join(self) -> None:
        """Of files that follow each other: go on where all are looked at; look again where only some were there."""
        if not self._continuous:
            return
        failed = {order for order, row in enumerate(self.rows) if row.status == "failed"}
        if len(self._there | self._joining | failed) < len(self.rows):
            return
        if self._there and not self._joining:
            for order in sorted(self._there):
                self._end(self.rows[order], "kept", "the result was there")
        elif self._there:
            for order in sorted(self._there):
                self._add(order, "begin", redo=True)
            self._there = set()
        elif self._joining:
            self._add(min(self._joining), "join", files=tuple(self._jobs[order] for order in sorted(self._joining)))

    def _known(self, row: Row, outcome: Outcome) -> None:
        row.frames, row.tracks = outcome.facts.get("frames", 0), outcome.facts.get("tracks")

    def _end(self, row: Row, status: Literal["done", "failed", "kept"], line: str) -> None:
        row.status, row.line, self.last = status, plain(line), row.name
        self._journal.note("end", name=row.name, status=status, line=row.line, frames=row.frames, tracks=row.tracks)
        self._changed()
