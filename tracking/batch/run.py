"""`tsuiseki batch`: a command on many videos, by processes of this machine or on Ray."""

from __future__ import annotations

import csv
import io
import secrets
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from cyclopts import App, Parameter
from pydantic import NonNegativeFloat, PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.batch.continuous import in_order
from tsuiseki.tracking.batch.executors import Processes, RayTasks
from tsuiseki.tracking.batch.jobs import STATE, Job, Place, options_of
from tsuiseki.tracking.batch.schedule import JOURNAL, Row, Schedule, note, status
from tsuiseki.tracking.batch.sources import jobs_of
from tsuiseki.tracking.batch.tasks import TOKEN, Doing
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.cli.request import plain, request_of
from tsuiseki.tracking.errors import Interrupted, RequestError, a_path, signal_of
from tsuiseki.tracking.fields import Threads, refused
from tsuiseki.tracking.onnx import cores_of
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import held, whole_file, writable
from tsuiseki.tracking.report.rendering import render
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.run import where_to_look
from tsuiseki.tracking.video.source import file_of

COLUMNS = ("name", "status", "frames", "tracks", "seconds", "source", "line")
# Files of a result of which the first that is there is linked.
PAGES = ("report.html", "run.json", "scores.json")


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class BatchOptions(Output):
    """How a batch is done.

    Attributes:
        out: folder for the results, one folder a video, index.html and summary.csv; all machines must see it.
        overwrite: replace results of other settings.
        workers: tasks at a time on this machine; 0 takes a process a core.
        ray: do the tasks on Ray: host:port of a cluster, auto for the one around this machine, or here, which starts
            one.
        gpus: on Ray, share of a GPU that a task takes, such as 0.25.
        segment: seconds of video in one task of track people; no more is lost when a process dies.
        continuous: the files of track people follow each other, and who is in several keeps the id; by the times in
            their names, such as 20260131_235959, or the seconds in the column start of a manifest.
    """

    workers: Threads = 0
    ray: str | None = None
    gpus: NonNegativeFloat = 0.0
    segment: PositiveFloat = 60.0
    continuous: bool = False

    def check(self) -> None:
        if self.out.exists() and not self.out.is_dir():
            raise RequestError(f"`out`: expected the name of a folder, but {self.out} is a file")

    def __post_init__(self) -> None:
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
    overwrite: bool = False,
    workers: int = 0,
    ray: str | None = None,
    gpus: float = 0.0,
    segment: float = 60.0,
    continuous: bool = False,
    **options: object,
) -> BatchResult:
    """A command on many videos; results that are there stay, and what was interrupted goes on.

    Args:
        command: such as ``track people`` or ``count``.
        sources: as on the command line, see ``tsuiseki batch``.
        out: folder for the results.
        overwrite: see `BatchOptions`, as for all up to ``continuous``.
        workers: 0 takes a process a core.
        ray: ``here`` starts Ray on this machine.
        gpus: on Ray, share of a GPU that a task takes.
        segment: seconds of video in one task of track people.
        continuous: the files of track people follow each other.
        options: of the command, by their names with underscores.

    Returns:
        What became of each video. One that failed is a row that says why; the others go on.

    Raises:
        RequestError: an option, a source or the folder is wrong, or Ray does not answer.
        RunError: the disk is full, or Ray has gone; the same call goes on from there.
    """
    with refused():
        how = BatchOptions(
            out=a_path(out, "out"),
            overwrite=overwrite,
            workers=workers,
            ray=ray,
            gpus=gpus,
            segment=segment,
            continuous=continuous,
        )
    how.check()
    job = Job(tuple(command.split()), "", "", plain(options))
    names = options_of(job.command)
    if unknown := [name for name in options if name not in names]:
        raise RequestError(f"expected options of `{command}`, got {unknown[0]!r}")
    return run_batch([str(source) for source in ([sources] if isinstance(sources, str | Path) else sources)], job, how)


def run_batch(sources: Sequence[str], job: Job, how: BatchOptions, emit: Callable[[str], object] = str) -> BatchResult:
    """`batch` with what was checked; ``emit`` gets a line for what is finished."""
    jobs = jobs_of(sources, job)
    if how.continuous and job.command != ("track", "people"):
        raise RequestError(f"expected `continuous` with track people, got it with {' '.join(job.command)}")
    jobs = in_order(jobs) if how.continuous else jobs
    # What is wrong with the options shows before anything is done, and so do results of others.
    for video in jobs if not how.overwrite else ():
        Place.of(how.out, video).refuse_others(video)
    jobs[0].request(jobs[0].source, how.out / jobs[0].name)
    state, command = how.out / STATE, " ".join(job.command)
    with writable(how.out):
        state.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        if not held(state, stack):
            raise RequestError(f"another batch is writing {how.out} at this moment; choose another name")
        token = secrets.token_hex(8)
        with whole_file(state / TOKEN) as file:
            file.write(token.encode())
        journal = stack.enter_context((state / JOURNAL).open("a", encoding="utf-8"))
        note(journal, "batch", command=command, sizes={video.name: _size(video) for video in jobs})
        executor, alone = _executor(how)
        stack.callback(executor.close)
        files = tuple(jobs) if how.continuous else ()
        schedule = Schedule(jobs, Doing(how.out.resolve(), token, how.overwrite, how.segment, alone, files), journal)

        def changed() -> None:
            write_pages(how.out, command, schedule.rows)
            ended = [row for row in schedule.rows if row.status in ("done", "failed", "kept")]
            row = next(row for row in reversed(ended) if row.name == schedule.last)
            emit(f"[{len(ended)}/{len(jobs)}] {row.name}: {row.status}{f', {row.line}' if row.line else ''}")

        try:
            schedule.run(executor, changed)
        except KeyboardInterrupt as error:
            raise Interrupted(signal_of(error), "what is finished is kept; the same command goes on") from error
        for video in files:
            Place.of(how.out, video).clear()
        write_pages(how.out, command, schedule.rows)
    return BatchResult(schedule.rows, how.out)


def _executor(how: BatchOptions) -> tuple[Processes | RayTasks, bool]:
    count = cores_of(how.workers)
    return (Processes(count), count == 1) if how.ray is None else (RayTasks(how.ray, count, how.gpus), False)


def write_pages(batch: Path, command: str, rows: Sequence[Row]) -> None:
    """Write ``summary.csv`` and ``index.html``: every video with what became of it, and the counts over all."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([*(getattr(row, name) for name in COLUMNS[:4]), round(row.seconds, 1), row.source, row.line]
                     for row in rows)  # fmt: skip
    page = render(
        "batch.html.j2",
        title=f"{len(rows)} videos: {command}",
        introduction=f"{summary_of(rows)}.",
        crossings=_crossings(batch, rows),
        rows=[(row, next((name for name in PAGES if (batch / row.name / name).exists()), None)) for row in rows],
        failed={row.name: row.line for row in rows if row.status == "failed"},
    )
    for name, text in (("summary.csv", table.getvalue()), ("index.html", page)):
        with whole_file(batch / name) as file:
            file.write(text.encode())


def summary_of(rows: Sequence[Row]) -> str:
    """How many videos are done, failed and so on, and frames and tracks of all."""
    counts = Counter(row.status for row in rows)
    parts = [f"{counts[name]} {name}" for name in ("done", "kept", "failed", "running", "waiting") if counts[name]]
    parts.append(f"{sum(row.frames for row in rows)} frames")
    if any(row.tracks is not None for row in rows):
        parts.append(f"{sum(row.tracks or 0 for row in rows)} tracks")
    return ", ".join(parts)


def _crossings(batch: Path, rows: Sequence[Row]) -> dict[str, str]:
    """Of each line in each direction over all results of `tsuiseki count`; empty where there is none."""
    sums: Counter[str] = Counter()
    for row in rows:
        path = batch / row.name / "answers.json"
        if row.status != "failed" and path.is_file():
            lines = read_json(path, "answers of tsuiseki count").get("lines", {})
            for line, way, count in zip(*(lines.get(name, []) for name in ("line", "direction", "count")), strict=True):
                sums[f"{line}, {way}"] += count
    return {name: str(count) for name, count in sorted(sums.items())}


def _size(job: Job) -> float:
    """What a video is likely to take, beside the others: its bytes."""
    if "://" in job.source:
        return 1.0
    path = file_of(job.source) or Path(job.source)
    files = [path] if path.is_file() else [entry for entry in path.rglob("*") if entry.is_file()]
    return max(float(sum(file.stat().st_size for file in files)), 1.0)


Words: TypeAlias = Annotated[str, Parameter(allow_leading_hyphen=True, show=False)]


BATCH = App("batch")
BATCH.command(status)


@BATCH.default
def on_many(*words: Words, how: BatchOptions) -> int:
    """Run a command on many videos: `tsuiseki batch track people VIDEO… --out DIR`, with options of the command.

    The command is one of `track` or `evaluate`, or `count`; it runs once for each video. A VIDEO is a file, a folder of
    files, a glob, an address that fsspec reads (s3://, gs://, https://), or a manifest: CSV or YAML with a row a video,
    its source, name, and options of its own. In an option, {name} stands for the name of the video, such as in `batch
    evaluate people TRUTH… --results results/{name}/tracks.txt`.
    """
    group, what = {"track": 2, "evaluate": 2, "count": 1}, words[0] if words else "nothing"
    if what not in group:
        raise RequestError(f"expected `tsuiseki batch` and one of {', '.join(group)}, got {what}")
    if what == "evaluate" and not any(word.partition("=")[0] == "--results" for word in words):
        raise RequestError("missing: `results`, such as results/{name}/tracks.txt")
    return _of_words(words, group[what], how)


def _of_words(words: Sequence[str], length: int, how: BatchOptions) -> int:
    """A batch of the command that the first ``length`` words name, by the others."""
    command = tuple(words[:length])
    place, *names = options_of(command)
    out = {"out": str(how.out)} if "out" in names else {}
    request = request_of([*command, *words[length:]], out | {"overwrite": True}, spare=True)
    options = {name: request.settings[name] for name in request.chosen}
    sources = options.pop(place)
    job = Job(command, "", "", {name: value for name, value in options.items() if name not in ("out", "overwrite")})
    result = run_batch([*(sources if isinstance(sources, list) else [sources]), *request.spare], job, how, print)
    print(f"{summary_of(result.rows)}\n{where_to_look(how.out)}")
    return 1 if result.failed else 0
