"""The order of the tasks of a batch, and what becomes of it: kept in a journal, so that anyone can ask at any time."""

from __future__ import annotations

import heapq
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Literal

from tsuiseki.tracking.batch.executors import Processes, RayTasks
from tsuiseki.tracking.batch.jobs import STATE, Job
from tsuiseki.tracking.batch.tasks import BatchTask, Doing, Kind, TaskOutcome
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.openers.json_files import json_of
from tsuiseki.tracking.openers.text import read_text
from tsuiseki.tracking.output import held

# Attempts at a task whose process died or whose network failed.
ATTEMPTS = 3
# What is done first: the later in the life of a video, the sooner, so that videos that were begun are finished.
TURNS: dict[Kind, int] = {"finish": 0, "join": 0, "detect": 1, "begin": 2, "whole": 1}
JOURNAL = "journal.jsonl"
# Seconds of the past that tell the speed.
LATELY = 600.0


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
        parts: segments altogether and done.
    """

    name: str
    source: str
    status: Literal["waiting", "running", "done", "failed", "kept"] = "waiting"
    line: str = ""
    frames: int = 0
    tracks: int | None = None
    seconds: float = 0.0
    parts: list[int] = field(default_factory=lambda: [0, 0])


def note(journal: IO[str], event: str, **values: Any) -> None:
    """Add an event, a line; whoever reads them passes over a last line that is torn."""
    journal.write(json.dumps({"time": round(time.time(), 3), "event": event, **values}) + "\n")
    journal.flush()


class Schedule:
    """Hands out the tasks of jobs in their order: those of a video that was begun before those of the next.

    Args:
        jobs: of the batch.
        doing: how they are done; where it has files, these are finished together.
        journal: gets a line for each task.

    Attributes:
        rows: what became of each so far.
        last: name of the one that was finished last.
    """

    def __init__(self, jobs: Sequence[Job], doing: Doing, journal: IO[str]) -> None:
        self.rows, self.last = [Row(job.name, job.source) for job in jobs], ""
        self._jobs, self._doing, self._journal = jobs, doing, journal
        self._ready: list[BatchTask] = []
        self._tries: Counter[str] = Counter()
        # Of files that follow each other: those whose result is there, and those that wait to be joined.
        self._there, self._joining = set[int](), set[int]()
        for order in range(len(jobs)):
            self._add(order, "begin")

    def run(self, executor: Processes | RayTasks, changed: Callable[[], None]) -> None:
        """Do all of it; ``changed`` is called whenever a video is finished.

        Raises:
            RunError: the disk is full.
        """
        self._changed, under_way = changed, 0
        while self._ready or under_way:
            while self._ready and executor.free():
                task = heapq.heappop(self._ready)
                row = self.rows[task.order]
                if row.status == "failed":
                    continue
                row.status = "running"
                note(self._journal, "begin", name=row.name, kind=task.kind, part=task.part)
                executor.submit(task)
                under_way += 1
            for task, outcome in executor.finished(1.0) if under_way else ():
                under_way -= 1
                self._take(task, outcome)

    def _add(self, order: int, kind: Kind, part: int = 0, redo: bool = False) -> None:
        heapq.heappush(self._ready, BatchTask(order, TURNS[kind], part, kind, self._jobs[order], self._doing, redo))

    def _take(self, task: BatchTask, outcome: TaskOutcome) -> None:
        row, facts = self.rows[task.order], outcome.facts
        row.seconds += outcome.seconds
        entry = {"name": row.name, "kind": task.kind, "part": task.part, "seconds": round(outcome.seconds, 3)}
        note(self._journal, outcome.status, **entry, line=outcome.line, frames=facts.get("frames", 0))
        if outcome.status == "full":
            raise RunError(f"{outcome.line}; free some and give the same command again: it goes on")
        if row.status == "failed":
            return
        if outcome.status == "lost":
            self._tries[str(task)] += 1
            if self._tries[str(task)] < ATTEMPTS:
                heapq.heappush(self._ready, task)
            else:
                self._fail(task, f"{outcome.line} ({ATTEMPTS} attempts)")
        elif outcome.status == "failed" or (outcome.status == "unfit" and self._doing.files):
            self._know(row, outcome)
            self._fail(task, outcome.line)
        elif outcome.status == "unfit":
            # Segments of it that are still under way count no more.
            if row.parts[0] or task.kind == "begin":
                self._add(task.order, "whole")
            row.line, row.parts = outcome.line, [0, 0]
        elif task.kind == "begin":
            self._begun(task, outcome)
        elif task.kind == "detect":
            row.parts[1] += 1
            if row.parts[1] == row.parts[0]:
                self._detected(task.order)
        elif task.kind == "join":
            for order in sorted(self._joining):
                self._add(order, "finish")
        else:
            self._know(row, outcome)
            self._end(row, "done", outcome.line)

    def _fail(self, task: BatchTask, line: str) -> None:
        """Give up a video; where its files were to be joined, all of them."""
        for order in sorted(self._joining) if task.kind == "join" else [task.order]:
            self._end(self.rows[order], "failed", line)
        if task.kind in ("begin", "detect"):
            self._join()

    def _begun(self, task: BatchTask, outcome: TaskOutcome) -> None:
        row, order = self.rows[task.order], task.order
        parts, done = outcome.facts.get("parts", 0), outcome.facts.get("done", [])
        row.parts = [parts, len(done)]
        if outcome.facts.get("there"):
            self._know(row, outcome)
            self._there.add(order)
            if not self._doing.files:
                self._end(row, "kept", "the result was there")
            self._join()
        elif not parts and self._doing.files:
            self._end(row, "failed", "this video cannot be read in segments, as `continuous` needs")
            self._join()
        elif not parts:
            self._add(order, "whole")
        elif parts == len(done):
            self._detected(order)
        for part in range(parts):
            if part not in done:
                self._add(order, "detect", part)

    def _detected(self, order: int) -> None:
        """All segments of a video are done."""
        if not self._doing.files:
            self._add(order, "finish")
        else:
            self._joining.add(order)
            self._join()

    def _join(self) -> None:
        """Of files that follow each other: go on where all are detected; detect again where only some were there."""
        failed = {order for order, row in enumerate(self.rows) if row.status == "failed"}
        if not self._doing.files or len(self._there | self._joining | failed) < len(self.rows):
            return
        if self._there and not self._joining:
            for order in sorted(self._there):
                self._end(self.rows[order], "kept", "the result was there")
        elif self._there:
            for order in sorted(self._there):
                self._add(order, "begin", redo=True)
            self._there = set()
        elif self._joining:
            files = tuple(self._jobs[order] for order in sorted(self._joining))
            self._doing = replace(self._doing, files=files)
            self._add(min(self._joining), "join")

    def _know(self, row: Row, outcome: TaskOutcome) -> None:
        row.frames, row.tracks = outcome.facts.get("frames", 0), outcome.facts.get("tracks")

    def _end(self, row: Row, status: Literal["done", "failed", "kept"], line: str) -> None:
        # Short enough for a table.
        row.status, row.line, self.last = status, " ".join(line.split())[:400], row.name
        note(self._journal, "end", name=row.name, status=status, line=row.line, frames=row.frames, tracks=row.tracks)
        self._changed()


def status(folder: Path) -> None:
    """Say how far a batch is: videos done, running and failed, frames a second, time left.

    Args:
        folder: that the batch writes into.
    """
    path = folder / STATE / JOURNAL
    if not path.is_file():
        raise RequestError(f"{folder}: expected the folder of a batch, found no {STATE}/{JOURNAL} in it")
    events = list[dict[str, Any]]()
    for line in read_text(path, "the journal of a batch").splitlines():
        with suppress(ValueError):  # torn where the disk was full or the process killed
            event = json_of(line, str(path), "an event")
            if isinstance(event, dict) and {"event", "time"} <= event.keys():
                if event["event"] == "batch":
                    events.clear()
                if events or event["event"] == "batch":
                    events.append(event)
    if not events:
        raise RequestError(f"{path}: expected the beginning of a batch, found none; is it still starting?")
    with ExitStack() as stack:
        runs = not held(folder / STATE, stack)
    for line in lines_of(events, runs):
        print(line)


def lines_of(events: list[dict[str, Any]], runs: bool) -> Iterator[str]:
    """What there is to say of the events of a batch, the first of which says what is to be done."""
    sizes: dict[str, float] = events[0]["sizes"]
    ends = {event["name"]: event for event in events if event["event"] == "end"}
    begun = {event["name"] for event in events if event["event"] == "begin"} - ends.keys()
    failed = [event for event in ends.values() if event["status"] == "failed"]
    waiting = len(sizes) - len(ends) - len(begun)
    others = f"{len(begun)} begun, {waiting} waiting, {len(failed)} failed"
    yield f"{'' if runs else 'not '}running: {len(ends) - len(failed)} of {len(sizes)} videos done, {others}"
    now, start = time.time() if runs else events[-1]["time"], events[0]["time"]
    detected = [event for event in events if event["event"] == "done" and event["kind"] in ("detect", "whole")]
    lately = [event for event in detected if event["time"] > now - LATELY]
    if lately:
        seconds = max(now - max(start, now - LATELY), 1e-3)
        yield f"{sum(event['frames'] for event in lately) / seconds:.1f} frames a second"
    worked = sum(sizes[name] for name, end in ends.items() if end["status"] != "kept" and name in sizes)
    left = sum(size for name, size in sizes.items() if name not in ends)
    if runs and worked and left:
        minutes = round((now - start) * left / worked / 60)
        clock = (
            f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min" if minutes else "a minute"
        )
        yield f"about {clock} left"
    for event in failed:
        yield f"{event['name']}: {event['line']}"
