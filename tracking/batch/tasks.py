"""The tasks of a batch, each a piece of work that any process on any machine can do, and do again.

A video is begun (fetched, known by its content, cut), looked at in stretches, and finished by one solution of the
whole; a command that cannot be cut is one task. A task leaves its result in a file, written beside and renamed; what it
returns is small.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from tsuiseki.tracking.batch.jobs import STATE, Job, Place, key_of, settings_of
from tsuiseki.tracking.errors import RequestError, RunError

Kind = Literal["begin", "look", "join", "finish", "whole"]
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
TOKEN = "token"


@dataclass(frozen=True, order=True)
class Task:
    """A piece of work; of several the smallest comes first.

    Attributes:
        order: of its video.
        turn: of the kind within it, the later the sooner done.
        part: number of the stretch.
        kind: what is to be done.
        job: the video.
        batch: folder of the batch.
        token: what tells that this folder is seen.
        overwrite: results of other settings.
        stretch: seconds that one task looks at.
        alone: no other task runs beside it, so it may take all cores.
        files: all jobs of files that are tracked as one video; none where each is one by itself.
        redo: do it again although the result is there.
    """

    order: int
    turn: int
    part: int
    kind: Kind = field(compare=False)
    job: Job = field(compare=False)
    batch: Path = field(compare=False)
    token: str = field(compare=False)
    overwrite: bool = field(compare=False, default=False)
    stretch: float = field(compare=False, default=60.0)
    alone: bool = field(compare=False, default=False)
    files: tuple[Job, ...] = field(compare=False, default=())
    redo: bool = field(compare=False, default=False)

    def __str__(self) -> str:
        return f"{self.job.name} {self.kind}{f' {self.part + 1}' if self.kind == 'look' else ''}"


@dataclass(frozen=True)
class Outcome:
    """What became of a task.

    Attributes:
        status: ``done``; ``failed``, which doing it again does not help; ``lost``, which it may, as of a network that
            is cut or a process that has died; ``full``, of a disk; ``unfit``, of a video that cannot be cut.
        line: what to tell people.
        facts: ``there`` (nothing is to be done), ``parts`` (stretches, and which are done), ``frames``, ``tracks``.
        seconds: that it took.
    """

    status: Literal["done", "failed", "lost", "full", "unfit"]
    line: str = ""
    facts: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0


def do(task: Task) -> Outcome:
    """Do a task, whatever happens in it."""
    from tsuiseki.tracking.cli.ending import LATE, said_of
    from tsuiseki.tracking.errors import explained
    from tsuiseki.tracking.video.stretch import UnfitIndexError

    start = time.monotonic()
    try:
        if not _sees(task):
            raise RunError(
                f"the machine {os.uname().nodename} does not see {task.batch}; give an `out` that all machines share"
            )
        return _timed(WORK[task.kind](task), start)
    except UnfitIndexError as error:
        return _timed(Outcome("unfit", str(error)), start)
    except ImportError as error:
        return _timed(Outcome("failed", str(explained(error) or error)), start)
    except LATE as error:
        causes = [error, error.__cause__, error.__context__]
        if any(isinstance(cause, OSError) and cause.errno in FULL for cause in causes):
            return _timed(Outcome("full", f"no space is left for {task.batch}"), start)
        known = isinstance(error, RequestError | RunError)
        return _timed(Outcome("failed" if known else "lost", f"{said_of(error) or type(error).__name__}"), start)


def _timed(outcome: Outcome, start: float) -> Outcome:
    return Outcome(outcome.status, outcome.line, outcome.facts, time.monotonic() - start)


def _sees(task: Task) -> bool:
    try:
        return (task.batch / STATE / TOKEN).read_text(encoding="utf-8") == task.token
    except OSError:
        return False


def _source(task: Task) -> str:
    """Path of the video, which is fetched where it is elsewhere."""
    from tsuiseki.tracking.batch.sources import fetch

    if not task.job.is_address:
        return task.job.source
    return str(fetch(task.job.source, Place.of(task.batch, task.job).state))


def _begin(task: Task) -> Outcome:
    """Find out whether the result is there, and cut the video where it can be."""
    from tsuiseki.tracking.batch.looking import LookingPlan, cut

    place, given = Place.of(task.batch, task.job), task.job.source
    people = task.job.command == ("track", "people")
    key = key_of(task.job, given, [task.stretch if people else None, [(job.name, job.start) for job in task.files]])
    if not place.begin(key, settings_of(task.job, given), task.overwrite, task.redo):
        return Outcome("done", facts={"there": True, **_known(place)})
    source = _source(task)
    if not people:
        return Outcome("done", facts={"parts": 0})
    path = place.state / "plan.json"
    if path.exists():
        plan: LookingPlan | None = LookingPlan.read(path)
    else:
        found = task.job.arguments(source, place.folder)
        with _quiet() as (_, errors):
            plan = _said(partial(cut, found["video"].open(), found["finding"], found["linking"], task.stretch), errors)
        if plan is not None:
            plan.write(path)
    if plan is None:
        return Outcome("done", facts={"parts": 0})
    done = [part for part in range(len(plan.parts)) if _file(place, part).exists()]
    frames = [last + 1 - first for first, last in plan.parts]
    return Outcome("done", facts={"parts": len(plan.parts), "done": done, "frames": frames})


def _said(call: Callable[[], Any], errors: io.StringIO) -> Any:
    """What ``call`` gives; its notes go nowhere, for the end tells them again."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = call()
    errors.truncate(0)
    return found


def _file(place: Place, part: int) -> Path:
    return place.state / f"{part:05}.npz"


def _look(task: Task) -> Outcome:
    from tsuiseki.tracking.batch.looking import LookingPlan, look
    from tsuiseki.tracking.batch.observations import write_observations

    place, source = Place.of(task.batch, task.job), _source(task)
    plan = LookingPlan.read(place.state / "plan.json")
    found = task.job.arguments(source, place.folder)
    with _quiet() as (_, errors):
        how = (task.part, found["video"].open(), found["finding"], found["linking"])
        seen = _said(partial(look, plan, *how), errors)
    write_observations(_file(place, task.part), seen)
    return Outcome("done", facts={"frames": len(seen.found)})


def _finish(task: Task) -> Outcome:
    from tsuiseki.tracking.batch.looking import LookingPlan, again
    from tsuiseki.tracking.people.run import track

    place, source = Place.of(task.batch, task.job), _source(task)
    plan = LookingPlan.read(place.state / "plan.json")
    files = [_file(place, part) for part in range(len(plan.parts))]
    found, tracker = task.job.arguments(source, place.folder), None
    if task.files:
        from tsuiseki.tracking.batch.continuous import GivenTracks, joined_tracks

        tracker = GivenTracks(joined_tracks(place.state / "joined.npz"))
    return _ended(partial(track, **found, look=partial(again, plan=plan, files=files, tracker=tracker)), task, place)


def _join(task: Task) -> Outcome:
    from tsuiseki.tracking.batch.continuous import join_files

    states = [Place.of(task.batch, job).state for job in task.files]
    join_files(task.files, [_source(replace(task, job=job)) for job in task.files], states)
    return Outcome("done")


def _whole(task: Task) -> Outcome:
    place, source = Place.of(task.batch, task.job), _source(task)
    place.folder.mkdir(parents=True, exist_ok=True)
    more: dict[str, Any] = {} if task.alone else {"threads": 1}
    given = task.job.arguments(source, place.folder, **more)
    from tsuiseki.tracking.cli.parser import options_of

    by_place = [option.name for option in options_of(task.job.function) if option.by_place]
    places = [given.pop(name) for name in by_place if name in given]
    return _ended(partial(task.job.function, *places, **given), task, place)


def _ended(call: Callable[[], int | None], task: Task, place: Place) -> Outcome:
    """Run a command's function to its end, and drop what was kept on the way."""
    from tsuiseki.tracking.cli.ending import ended

    with _quiet() as (said, errors):
        status = ended(call)
    lines = [line.removeprefix("tsuiseki: ") for line in errors.getvalue().splitlines() if line.strip()]
    complaints = [line for line in lines if not line.startswith("note: ")]
    if any(os.strerror(number) in line for line in complaints for number in FULL):
        return Outcome("full", f"no space is left for {task.batch}")
    if status:
        return Outcome("failed", complaints[-1] if complaints else f"ended with status {status}", _known(place))
    if not task.files:  # those that follow each other may be needed again until all are finished
        place.clear()
    printed = [line for line in said.getvalue().splitlines() if line.strip()]
    return Outcome("done", printed[-1] if printed else "", _known(place))


def _known(place: Place) -> dict[str, Any]:
    """Frames and tracks of a result."""
    try:
        record = json.loads((place.folder / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    columns = record.get("frames", {})
    found: dict[str, Any] = {"frames": len(columns.get("frame", ()))}
    tracks = place.folder / "tracks.txt"
    if tracks.is_file():
        with tracks.open(encoding="utf-8") as file:
            found["tracks"] = len({line.split(",", 2)[1] for line in file if "," in line})
    return found


@contextlib.contextmanager
def _quiet() -> Any:
    """What is printed inside; a batch has many voices and one terminal."""
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()) as errors:
        yield said, errors


def plain(line: str) -> str:
    """A line for people, short enough for a table."""
    return re.sub(r"\s+", " ", line).strip()[:400]


WORK: dict[Kind, Callable[[Task], Outcome]] = {
    "begin": _begin,
    "look": _look,
    "join": _join,
    "finish": _finish,
    "whole": _whole,
}
