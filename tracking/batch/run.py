"""`tsuiseki batch`: a command on many videos, by processes of this machine or on Ray."""

from __future__ import annotations

import dataclasses
import inspect
import json
import secrets
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import MISSING, dataclass, field, make_dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_type_hints

from tsuiseki.tracking.batch.continuous import in_order
from tsuiseki.tracking.batch.executors import Executor, Processes
from tsuiseki.tracking.batch.jobs import STATE, Job, Place, function_of
from tsuiseki.tracking.batch.page import summary_of, write_pages
from tsuiseki.tracking.batch.schedule import Journal, Row, Schedule
from tsuiseki.tracking.batch.sources import jobs_of
from tsuiseki.tracking.batch.tasks import TOKEN, Task
from tsuiseki.tracking.cli.commands import EVALUATE, TRACK
from tsuiseki.tracking.cli.options import Output
from tsuiseki.tracking.cli.parser import call, is_shared, options_of
from tsuiseki.tracking.errors import Interrupted, RequestError, signal_of
from tsuiseki.tracking.onnx import cores_of
from tsuiseki.tracking.options import NO_OPTION
from tsuiseki.tracking.output import held, whole_file

SOURCES = (
    "videos, folders of them, globs, addresses that fsspec reads (s3://, gs://, https://), or manifests: CSV or YAML "
    "with a row a video, its source, name, and options of its own"
)


@dataclass(frozen=True, kw_only=True)
class BatchOptions(Output):
    """How a batch is done.

    Attributes:
        out: folder for the results, one folder a video, index.html and summary.csv; all machines must see it.
        overwrite: replace results of other settings.
        workers: tasks at a time on this machine; 0 takes a process a core.
        ray: do the tasks on Ray: host:port of a cluster, or auto for the one around this machine; by itself it starts a
            Ray here.
        gpus: on Ray, share of a GPU that a task takes, such as 0.25.
        stretch: seconds of video that one task of track people looks at; no more is lost when a process dies.
        continuous: the files of track people follow each other, and who is in several keeps the id; by the times in
            their names, such as 20260131_235959, or the seconds in the column start of a manifest.
    """

    workers: int = 0
    ray: str | None = None
    gpus: float = 0.0
    stretch: float = 60.0
    continuous: bool = False

    def check(self) -> None:
        """See `Shared.check`."""
        if self.out.exists() and not self.out.is_dir():
            raise RequestError(f"`out`: expected the name of a folder, but {self.out} is a file")
        cores_of(self.workers, "workers")
        if not self.stretch > 0:
            raise RequestError(f"`stretch`: expected seconds above 0, got {self.stretch:g}")
        if not self.gpus >= 0:
            raise RequestError(f"`gpus`: expected a share of a GPU from 0, got {self.gpus:g}")
        if self.gpus and self.ray is None:
            raise RequestError("expected `gpus` with `ray`, got it alone")


@dataclass(frozen=True)
class BatchResult(Sequence[Row]):
    """What became of each video.

    Attributes:
        rows: in the order of the sources.
        out: folder of the results; that of a row lies at ``out / row.name``.
    """

    rows: Sequence[Row]
    out: Path

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        return self.rows[index]

    @property
    def failed(self) -> list[Row]:
        """Those without a whole result."""
        return [row for row in self.rows if row.status == "failed"]


def batch(
    command: str,
    sources: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    workers: int = 0,
    ray: str | None = None,
    gpus: float = 0.0,
    stretch: float = 60.0,
    continuous: bool = False,
    overwrite: bool = False,
    **options: Any,
) -> BatchResult:
    """A command on many videos; results that are there stay, and what was interrupted goes on.

    Args:
        command: such as ``track people`` or ``count``.
        sources: as on the command line, see ``tsuiseki batch``.
        out: folder for the results.
        workers: tasks at a time on this machine; 0 takes a process a core.
        ray: see `BatchOptions`; ``"here"`` starts Ray on this machine.
        gpus: on Ray, share of a GPU that a task takes.
        stretch: seconds of video that one task of ``track people`` looks at.
        continuous: the files follow each other, see `BatchOptions`.
        overwrite: replace results of other settings.
        options: of the command, by their names with underscores.

    Returns:
        What became of each video. One that failed is a row that says why; the others go on.

    Raises:
        RequestError: an option, a source or the folder is wrong, or Ray does not answer.
        RunError: the disk is full, or Ray has gone; the same call goes on from there.
    """
    how = BatchOptions(
        out=Path(out),
        overwrite=overwrite,
        workers=workers,
        ray=ray,
        gpus=gpus,
        stretch=stretch,
        continuous=continuous,
    )
    how.check()
    given = [sources] if isinstance(sources, str | Path) else sources
    plain = json.loads(json.dumps(options, default=str))
    job = Job(tuple(command.split()), "", "", plain)
    known = [option.name for option in options_of(job.function)]
    if unknown := [name for name in options if name not in known]:
        raise RequestError(f"expected options of `{command}`, got {unknown[0]!r}")
    return run_batch([str(source) for source in given], job, how)


def run_batch(sources: Sequence[str], job: Job, how: BatchOptions, said: Callable[[str], object] = str) -> BatchResult:
    """`batch` with what was checked; ``said`` is told in a line what is finished."""
    jobs = jobs_of(sources, job)
    if how.continuous:
        if job.command != ("track", "people"):
            raise RequestError(f"expected `continuous` with track people, got it with {' '.join(job.command)}")
        jobs = in_order(jobs)
    # What is wrong with the options shows before anything is done, and so do results of others.
    for each in jobs if not how.overwrite else ():
        Place.of(how.out, each).refuse_others(each)
    jobs[0].arguments(jobs[0].source, how.out / jobs[0].name)
    state = how.out / STATE
    try:
        state.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RequestError(f"cannot write to {how.out}: {error.strerror}; choose another place") from error
    with ExitStack() as stack:
        if not held(state, stack):
            raise RequestError(f"another batch is writing {how.out} at this moment; choose another name")
        token, command = secrets.token_hex(8), " ".join(job.command)
        with whole_file(state / TOKEN) as file:
            file.write(token.encode())
        journal = Journal(how.out)
        stack.callback(journal.close)
        journal.note("batch", command=command, sizes={each.name: _size(each) for each in jobs})
        schedule: Schedule
        executor, alone = _executor(how)
        files = tuple(jobs) if how.continuous else ()
        make = partial(_task, files=files, batch=how.out.resolve(), token=token, how=how, alone=alone)

        def changed() -> None:
            write_pages(how.out, command, schedule.rows)
            ended = [row for row in schedule.rows if row.status in ("done", "failed", "kept")]
            row = next(row for row in reversed(ended) if row.name == schedule.last)
            said(f"[{len(ended)}/{len(jobs)}] {row.name}: {row.status}{f', {row.line}' if row.line else ''}")

        schedule = Schedule(jobs, make, journal, changed, how.continuous)
        stack.callback(executor.close)
        try:
            schedule.run(executor)
        except KeyboardInterrupt as error:
            raise Interrupted(signal_of(error), "what is finished is kept; the same command goes on") from error
        for each in jobs if how.continuous else ():
            Place.of(how.out, each).clear()
        write_pages(how.out, command, schedule.rows)
    return BatchResult(schedule.rows, how.out)


def _executor(how: BatchOptions) -> tuple[Executor, bool]:
    count = cores_of(how.workers)
    if how.ray is None:
        return Processes(count), count == 1
    from tsuiseki.tracking.batch.ray_tasks import RayTasks

    return RayTasks(how.ray, count, how.gpus), False


def _task(
    order: int,
    turn: int,
    part: int,
    kind: Any,
    job: Job,
    files: tuple[Job, ...],
    batch: Path,
    token: str,
    how: BatchOptions,
    alone: bool,
) -> Task:
    return Task(order, turn, part, kind, job, batch, token, how.overwrite, how.stretch, alone, files)


def _size(job: Job) -> float:
    """What a video is likely to take, beside the others: its bytes."""
    path = Path(job.source)
    if job.is_address:
        return 1.0
    files = [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]
    return max(float(sum(file.stat().st_size for file in files)), 1.0)


def track(words: Sequence[str]) -> int:
    """`tsuiseki batch track WHAT SOURCES…`."""
    return _several("track", TRACK, words)


def evaluate(words: Sequence[str]) -> int:
    """`tsuiseki batch evaluate WHAT TRUTH…`."""
    return _several("evaluate", EVALUATE, words)


def count(words: Sequence[str]) -> int:
    """`tsuiseki batch count RESULT…`."""
    return _call(("count",), words)


def _several(group: str, names: Any, words: Sequence[str]) -> int:
    if not words or words[0] not in names:
        if words and words[0] not in ("-h", "--help", "--help-all"):
            raise RequestError(f"expected `tsuiseki batch {group}` and one of {', '.join(names)}, got {words[0]}")
        print(f"usage: tsuiseki batch {group} WHAT …\n\nWHAT is {', '.join(names)}. Of people:\n")
        words = ["people", *words[:1]] if words else ["people", "--help"]
    return _call((group, words[0]), words[1:])


def _call(command: tuple[str, ...], words: Sequence[str]) -> int:
    status: int = call(" ".join(["tsuiseki batch", *command]), batched(command), _with_ray(words))
    return status


def _with_ray(words: Sequence[str]) -> list[str]:
    """``--ray`` alone means here."""
    found = list(words)
    for place, word in enumerate(words):
        following = words[place + 1] if place + 1 < len(words) else "--"
        if word == "--ray" and not (following == "auto" or ":" in following):
            found[place] = "--ray=here"
    return found


def batched(command: tuple[str, ...]) -> Callable[..., int]:
    """The function of ``tsuiseki batch COMMAND``: its options are those of a batch and of the command."""
    function, own = function_of(command), {option.name for option in options_of(partial_of(BatchOptions))}
    place = next(option.name for option in options_of(function) if option.by_place)

    def run(sources: list[str], /, doing: BatchOptions, **_: Any) -> int:
        defaults = {option.name: option.default for option in options_of(function)}
        given = {
            name: value
            for name, value in doing.settings.items()
            if name in defaults and name not in own and value != _plain(defaults[name])
        }
        result = run_batch(sources, Job(command, "", "", given), doing, print)
        print(f"{summary_of(result.rows)}: {doing.out / 'index.html'}")
        return 1 if result.failed else 0

    parameters = [
        inspect.Parameter("sources", inspect.Parameter.POSITIONAL_ONLY, annotation=list[str]),
        inspect.Parameter("doing", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=BatchOptions),
    ]
    for one in inspect.signature(function, eval_str=True).parameters.values():
        if is_shared(one.annotation):
            hidden = _without(one.annotation, own | {place})
            default = one.default if one.default is one.empty else _as(hidden, one.default)
            parameters.append(one.replace(annotation=hidden, default=default, kind=one.KEYWORD_ONLY))
        elif one.name != place:
            parameters.append(one.replace(kind=one.KEYWORD_ONLY))
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    text = inspect.getdoc(function) or ""
    text += "" if "Args:" in text else "\n\nArgs:"
    run.__doc__ = f"{text}\n    sources: {SOURCES}."
    return run


def partial_of(kind: type) -> Callable[..., Any]:
    """A function whose options are the fields of ``kind``."""

    def function(how: Any) -> None: ...

    function.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [inspect.Parameter("how", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=kind)]
    )
    return function


def _without(kind: type, names: set[str]) -> type:
    """Options without some, which a batch gives; and unchecked, for each video checks its own."""

    hints = get_type_hints(kind)
    hidden = [
        (one.name, hints[one.name], field(default="" if one.default is MISSING else one.default, metadata=NO_OPTION))
        for one in dataclasses.fields(kind)
        if one.name in names
    ]
    by_name = [one for one in dataclasses.fields(kind) if one.metadata.get("positional") and one.name not in names]
    # What a command takes by place beside the source is an option here, and one for each video.
    hidden += [(one.name, (get_args(hints[one.name]) or (hints[one.name],))[0], field(default="")) for one in by_name]
    unchecked = {"check": lambda _: None, "__doc__": kind.__doc__}
    return make_dataclass(kind.__name__, hidden, bases=(kind,), frozen=True, kw_only=True, namespace=unchecked)


def _as(kind: type, value: Any) -> Any:

    return kind(**{one.name: getattr(value, one.name) for one in dataclasses.fields(value)})


def _plain(value: Any) -> Any:

    if value is MISSING:
        return value
    return json.loads(json.dumps(dataclasses.asdict(value) if dataclasses.is_dataclass(value) else value, default=str))  # type: ignore[arg-type]
