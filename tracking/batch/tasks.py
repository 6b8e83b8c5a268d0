"""The tasks of a batch, each a piece of work that any process on any machine can do, and do again.

A video is begun (fetched, known by its content, cut), detected in segments, and finished by one solution of the
whole; a command that cannot be cut is one task. A task leaves its result in a file, written beside and renamed; what it
returns is small.
"""

from __future__ import annotations

import errno
import io
import os
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from tsuiseki.tracking.batch.addresses import fetch
from tsuiseki.tracking.batch.continuous import GivenTracks, join_files, joined_tracks
from tsuiseki.tracking.batch.jobs import STATE, Job, Place, key_of, options_of, settings_of
from tsuiseki.tracking.batch.segments import PLAN, SegmentPlan, again, cut, detect_segment
from tsuiseki.tracking.errors import RequestError, RunError, explained
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.runs.ending import ended, is_late
from tsuiseki.tracking.runs.messages import message_of
from tsuiseki.tracking.video.source import UnfitIndexError

Kind = Literal["begin", "detect", "join", "finish", "whole"]
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
TOKEN = "token"


@dataclass(frozen=True)
class Doing:
    """How the tasks of a batch are done.

    Attributes:
        batch: folder of the batch.
        token: what proves that this folder is reached.
        overwrite: results of other settings.
        segment: seconds of video in one task.
        alone: no other task runs beside it, so it may take all cores.
        files: all jobs of files that are tracked as one video; none where each is one by itself.
    """

    batch: Path
    token: str
    overwrite: bool = False
    segment: float = 60.0
    alone: bool = False
    files: tuple[Job, ...] = ()


@dataclass(frozen=True, order=True)
class BatchTask:
    """A piece of work on a video, or on one of its segments; of several the smallest comes first.

    Later kinds have the smaller ``turn``: what was begun is finished first. ``redo`` does again what is there.
    """

    order: int
    turn: int
    part: int
    kind: Kind = field(compare=False)
    job: Job = field(compare=False)
    doing: Doing = field(compare=False)
    redo: bool = field(compare=False, default=False)

    def __str__(self) -> str:
        return f"{self.job.name} {self.kind}{f' {self.part + 1}' if self.kind == 'detect' else ''}"

    @property
    def place(self) -> Place:
        """Where the video leaves things."""
        return Place.of(self.doing.batch, self.job)

    def source(self) -> str:
        """Path of the video, which is fetched where it is elsewhere."""
        return str(fetch(self.job.source, self.place.state)) if "://" in self.job.source else self.job.source

    def file(self, part: int) -> Path:
        """The observations of a segment."""
        return self.place.state / f"{part:05}.npz"

    def plan(self) -> SegmentPlan:
        """How the video is cut."""
        return SegmentPlan.read(self.place.state / PLAN)


@dataclass(frozen=True)
class TaskOutcome:
    """What became of a task.

    Attributes:
        status: ``done``; ``failed``, which doing it again does not help; ``lost``, which it may, as of a network that
            is cut or a process that has died; ``full``, of a disk; ``unfit``, of a video that cannot be cut.
        line: what to tell people.
        facts: ``there`` (nothing is to be done), ``parts`` (segments, and which are done), ``frames``, ``tracks``.
        seconds: that it took.
    """

    status: Literal["done", "failed", "lost", "full", "unfit"]
    line: str = ""
    facts: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0


def do(task: BatchTask) -> TaskOutcome:
    """Do a task, whatever happens in it."""
    start = time.monotonic()
    return replace(_outcome(task), seconds=time.monotonic() - start)


def _outcome(task: BatchTask) -> TaskOutcome:
    batch = task.doing.batch
    try:
        token = batch / STATE / TOKEN
        if not token.is_file() or token.read_text(encoding="utf-8") != task.doing.token:
            node = os.uname().nodename
            raise RunError(f"the machine {node} does not see {batch}; give an `out` that all machines share")
        return WORK[task.kind](task)
    except UnfitIndexError as error:
        return TaskOutcome("unfit", str(error))
    except ImportError as error:
        return TaskOutcome("failed", str(explained(error) or error))
    except Exception as error:
        if not is_late(error):
            raise
        causes = [error, error.__cause__, error.__context__]
        if any(isinstance(cause, OSError) and cause.errno in FULL for cause in causes):
            return TaskOutcome("full", f"no space is left for {batch}")
        explained_here = isinstance(error, RequestError | RunError)
        return TaskOutcome("failed" if explained_here else "lost", f"{message_of(error) or type(error).__name__}")


def _begin(task: BatchTask) -> TaskOutcome:
    """Find out whether the result is there, and cut the video where it can be."""
    place, address, doing = task.place, task.job.source, task.doing
    people = task.job.command == ("track", "people")
    key = key_of(task.job, address, [doing.segment if people else None, [(job.name, job.start) for job in doing.files]])
    if not place.begin(key, settings_of(task.job, address), doing.overwrite, task.redo):
        return TaskOutcome("done", facts={"there": True, **_counts(place)})
    source = task.source()
    if not people:
        return TaskOutcome("done", facts={"parts": 0})
    if not (place.state / PLAN).exists():
        arguments = task.job.request(source, place.folder).arguments.arguments
        with _silent():
            plan = cut(arguments["video"].open(), arguments["finding"], arguments["linking"], doing.segment)
        if plan is None:
            return TaskOutcome("done", facts={"parts": 0})
        plan.write(place.state / PLAN)
    parts = task.plan().parts
    done = [part for part in range(len(parts)) if task.file(part).exists()]
    return TaskOutcome("done", facts={"parts": len(parts), "done": done, "frames": [b + 1 - a for a, b in parts]})


def _detect(task: BatchTask) -> TaskOutcome:
    arguments = task.job.request(task.source(), task.place.folder).arguments.arguments
    with _silent():
        detected = detect_segment(
            task.plan(), task.part, arguments["video"].open(), arguments["finding"], arguments["linking"]
        )
    detected.write(task.file(task.part))
    return TaskOutcome("done", facts={"frames": len(detected.detections)})


def _finish(task: BatchTask) -> TaskOutcome:
    from tsuiseki.tracking.cli.track_people import track

    place, plan = task.place, task.plan()
    arguments = task.job.request(task.source(), place.folder).arguments.arguments
    tracker = GivenTracks(joined_tracks(place.state / "joined.npz")) if task.doing.files else None
    files = [task.file(part) for part in range(len(plan.parts))]
    replayed = partial(again, plan=plan, files=files, tracker=tracker)
    return _ended(partial(track, **arguments, replayed=replayed), task, place)


def _join(task: BatchTask) -> TaskOutcome:
    tasks = [replace(task, job=job) for job in task.doing.files]
    join_files(task.doing.files, [part.source() for part in tasks], [part.place.state for part in tasks])
    return TaskOutcome("done")


def _in_one_piece(task: BatchTask) -> TaskOutcome:
    place, job = task.place, task.job
    place.folder.mkdir(parents=True, exist_ok=True)
    changes: dict[str, Any] = {} if task.doing.alone or "threads" not in options_of(job.command) else {"threads": 1}
    request = job.request(task.source(), place.folder, **changes)
    return _ended(request.run, task, place)


def _ended(call: Callable[[], int | None], task: BatchTask, place: Place) -> TaskOutcome:
    """Run a command's function to its end, and drop what was kept on the way."""
    with _quiet() as (output, errors):
        status = ended(call)
    lines = [line.removeprefix("tsuiseki: ") for line in errors.getvalue().splitlines() if line.strip()]
    complaints = [line for line in lines if not line.startswith("note: ")]
    if any(os.strerror(number) in line for line in complaints for number in FULL):
        return TaskOutcome("full", f"no space is left for {task.doing.batch}")
    if status:
        return TaskOutcome("failed", complaints[-1] if complaints else f"ended with status {status}", _counts(place))
    if not task.doing.files:  # those that follow each other may be needed again until all are finished
        place.clear()
    printed = [line for line in output.getvalue().splitlines() if line.strip()]
    return TaskOutcome("done", printed[-1] if printed else "", _counts(place))


def _counts(place: Place) -> dict[str, Any]:
    """Frames and tracks of a result."""
    try:
        record = read_json(place.folder / "run.json", "the record of a run")
    except RequestError:
        return {}
    columns = record.get("frames", {})
    counts: dict[str, Any] = {"frames": len(columns.get("frame", ()))}
    tracks = place.folder / "tracks.txt"
    if tracks.is_file():
        with tracks.open(encoding="utf-8") as file:
            counts["tracks"] = len({line.split(",", 2)[1] for line in file if "," in line})
    return counts


@contextmanager
def _quiet() -> Iterator[tuple[io.StringIO, io.StringIO]]:
    """What is printed inside; a batch has many voices and one terminal."""
    with redirect_stdout(io.StringIO()) as output, redirect_stderr(io.StringIO()) as errors:
        yield output, errors


@contextmanager
def _silent() -> Iterator[None]:
    """Nothing is printed inside, for the end prints it."""
    with _quiet(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


WORK: dict[Kind, Callable[[BatchTask], TaskOutcome]] = {
    "begin": _begin, "detect": _detect, "join": _join, "finish": _finish, "whole": _in_one_piece
}  # fmt: skip
