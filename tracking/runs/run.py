"""The frame of every command: where the video comes from, and what happens to the result, whatever happens.

A command is a function of typed options; those that several share stand below and in `tracking.runs.following`.

    def blobs(video: Video, output: SeededOutput, particles: int = 500) -> int:
        source = video.open()                                   # checked before anything is computed
        tracker = BlobTracker(..., output.seed)
        with output.run() as run:
            steps = run.steps(run.frames(source))
            result = blob_result(tracker, steps, ...)           # what the function for Python returns, too
            run.save(result, lambda: video.draw(run, source, result))
            run.done(f"{len(result)} objects: {output.out / 'tracks.txt'}")
        return run.status

* `Run.frames` ends where the source breaks off; `Run.steps` ends where it does or where the user interrupts (Ctrl-C,
  TERM, HUP), in both cases between two steps: networks under way are dropped, what follows writes what is finished.
  Before the first finished step, either is an end without a result. A second interrupt ends at once.
* `Run.write` makes a file whole or not at all. What it has written is kept from then on, even where something later
  fails. `Run.draw` makes what takes long and can be missed: an interrupt or a full disk there costs nothing else.
* At the end of the ``with`` block the files come to lie in the output folder with ``run.json``, marked partial where
  they are; one line says what came out. `Run.status` is 0, 1 where the run failed late, or 128 + the signal.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path, PurePath
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

from tsuiseki.tracking.errors import Dropped, Interrupted, RequestError, RunError, signal_of
from tsuiseki.tracking.options import NO_OPTION, Seed, Shared
from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder
from tsuiseki.tracking.runs.ending import DEADLINE, DONE, FAILED, LATE, NOTES, complain, message_of, on_signals
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.weights.catalogue import records_of

if TYPE_CHECKING:
    from tsuiseki.tracking.result import Result
    from tsuiseki.tracking.types import Frame
    from tsuiseki.tracking.video.source import Source

T = TypeVar("T")
PARTS = ".parts"
# Seconds within which a signal that comes again is the same: `timeout` sends it to the process and to its group.
TWICE = 0.25


class Run:
    """A run of a command that fills a folder; see the head of this file.

    Attributes:
        times: seconds of each stage.
        columns: what happened in each frame, for ``run.json``: one list a column.
        facts: what the run found out about its input, or chose by itself; likewise.
        results: what is known of each result, by its folder; likewise.
        sources: videos that it read.
        count: finished steps.
        status: exit status, known after the ``with`` block.
        asked: the signal by which the user asked to end, 0 where none came: begin no other part.
    """

    def __init__(self, output: Output) -> None:
        self.output = output
        self.times = StageTimes()
        self.columns: Mapping[str, Sequence[Any]] = {}
        self.facts: dict[str, Any] = {}
        self.results: dict[str, Any] = {}
        self.sources: list[Source] = []
        self.count, self._before = 0, 0
        self.status, self.asked, self._asked_at = DONE, 0, 0.0
        self._patient = self._written = self._live = False
        self._summary = self._reason = ""
        self._first: int | None = None
        self._expected: int | None = None
        self._recording: Path | None = None
        self._kept: Path | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Run:
        with ExitStack() as stack:
            stack.enter_context(on_signals(self._ask))
            self.work = stack.enter_context(output_folder(self.output.out, self.output.overwrite))
            (self.work / PARTS).mkdir()
            self._stack = stack.pop_all()
        return self

    def _ask(self, number: int, _: FrameType | None = None) -> None:
        """The first interrupt waits for the end of a step, where there are steps."""
        DEADLINE.answered += 1
        if self.asked == number and time.monotonic() - self._asked_at < TWICE:
            return
        if self.asked or not self._patient:
            DEADLINE.keeps = self._written or self._live or self._kept is not None
            raise Interrupted(number)
        self.asked, self._asked_at = number, time.monotonic()
        DEADLINE.drop()

    def frames(self, source: Source, record: bool = False) -> Iterator[Frame]:
        """The frames of ``source``, up to where it breaks off; ``record`` keeps those of a live one for `replay`."""
        self.sources.append(source)
        self._expected = source.frames_expected
        if not source.live:
            return self._read(source.frames())
        return self._read(self.unending(source.frames()), source.frame_rate if record else None)

    def unending(self, items: Iterable[T]) -> Iterator[T]:
        """``items`` of a live source: an interrupt ends them at once, and what came before is kept."""
        self._live, iterator = True, iter(items)
        while not self.asked:
            try:
                with self.waiting():
                    item = next(iterator)
            except StopIteration:
                return
            except KeyboardInterrupt as error:
                self.asked = signal_of(error)
                return
            yield item

    def _read(self, frames: Iterator[Frame], recorded_rate: float | None = None) -> Iterator[Frame]:
        with ExitStack() as stack:
            writer = None
            if recorded_rate is not None:
                from tsuiseki.tracking.video.webm import VideoWriter

                self._recording = self.work / PARTS / "recording.webm"
                writer = stack.enter_context(VideoWriter(self._recording, recorded_rate))
            try:
                for frame in frames:
                    if writer is not None:
                        writer.write(frame.image)
                    self._first = frame.index if self._first is None else self._first
                    yield frame
            except LATE as error:
                if self._first is None:
                    raise
                self._fail(error)

    def kept(
        self, name: str, items: Iterable[tuple[int, T]], line: Callable[[int, T], str] | None
    ) -> Iterator[tuple[int, T]]:
        """Numbered ``items``; where no time is left to make more of them, the file ``name`` of their lines is kept.

        Args:
            name: of the file.
            items: of a run that is interrupted again soon after the first interrupt, unless it writes by then.
            line: of a number and an item; None where nothing is lost with them.
        """
        DEADLINE.brief, path = True, self.work / PARTS / name
        with path.open("w", encoding="utf-8") as file:
            for number, item in items:
                if line is not None:
                    file.write(line(number, item))
                    file.flush()
                    self._kept = path
                yield number, item

    def steps(self, items: Iterable[T], what: str = "tracking", total: int | None = None) -> Iterator[T]:
        """``items``, with progress, up to an interrupt or to where they fail.

        The ``total`` is by default that of the frames of the last source, where it is known.

        Raises:
            RunError: there is none.
            KeyboardInterrupt: before the first step was finished.
        """
        self._patient, before = True, self.count
        self._before = before
        watched, end = progress(items, what, self._expected if total is None else total), object()
        try:
            while (item := self._next(watched, end)) is not end:
                yield item  # type: ignore[misc]
                self.count += 1
                DEADLINE.keeps = True
        except LATE as error:
            if self.count == before:
                raise
            self._fail(error)
        watched.close()
        if self.count == before:
            raise Interrupted(self.asked) if self.asked else RunError("expected frames, got none")

    def _next(self, items: Iterator[T], end: object) -> T | object:
        """The next of ``items``, or ``end``, also where an interrupt ends the networks that work on it."""
        with DEADLINE.droppable(), suppress(Dropped):
            return end if self.asked else next(items, end)
        return end

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Within it an interrupt is heard at once: in a step that waits for the user there is nothing to finish."""
        patient, self._patient = self._patient, False
        try:
            yield
        finally:
            self._patient = patient

    def replay(self, source: Source) -> Iterator[Frame]:
        """The finished frames again, to draw on.

        Raises:
            KeyboardInterrupt: the user interrupts.
        """
        from tsuiseki.tracking.video.source import open_source

        first, length = self._first, self.count - self._before
        if self._recording is None or first is None:
            # A video that broke off is not asked for more than it had.
            return self.watched(islice(source.frames(), None if first is None else length), "drawing", length)
        recorded = open_source(self._recording, FrameRange(0, length - 1)).frames()
        return self.watched((replace(frame, index=frame.index + first) for frame in recorded), "drawing", length)

    def watched(self, items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        """``items`` with progress; an interrupt from now on ends them with KeyboardInterrupt."""
        asked = self.asked

        def each() -> Iterator[T]:
            for item in progress(items, what, total):
                if self.asked != asked:
                    raise Interrupted(self.asked)
                yield item

        return each()

    def write(self, name: str, write: Callable[..., object], *more: object) -> Path:
        """Make the file ``name`` of the result by ``write(path, *more)``; it is kept from then on."""
        part, whole = self.work / PARTS / name, self.work / name
        part.parent.mkdir(parents=True, exist_ok=True)
        try:
            write(part, *more)
            whole.parent.mkdir(parents=True, exist_ok=True)
            self._written, self._kept = True, None
            return part.replace(whole)
        except BaseException:
            part.unlink(missing_ok=True)
            with suppress(OSError):
                whole.parent.rmdir()
            raise

    def fill(self, write: Callable[[Path], object]) -> None:
        """Make all files of a result that ``write`` puts into a folder; they are kept from then on."""
        # What is written may take its name from the folder.
        part = self.work / PARTS / self.output.out.resolve().name
        write(part)
        for path in sorted(part.iterdir()):
            path.replace(self.work / path.name)
        self._written = True

    def save(self, result: Result[Any], draw: Callable[[], object] = lambda: None, folder: str = "") -> None:
        """Write the files of ``result``, and take what it knows into ``run.json``.

        ``draw`` makes what the pages of the result show, when all other files are written; ``folder`` lies inside the
        output folder.
        """
        if self.output.page is not None and result.page is not None:
            result = self.output.page(result)
        DEADLINE.brief, self.columns = False, result.frames
        self.facts |= result.facts
        self.results[folder or "."] = result.known()
        for pages in (False, True):
            for name, write in result.files.items():
                if (name.startswith("report/") or name.endswith((".html", ".png"))) == pages:
                    self.write(str(PurePath(folder, name)), write, self.work / folder)
            if not pages:
                draw()
                # Who interrupts waits for no page or plot.
                DEADLINE.brief = not (self._live and self.asked)
        DEADLINE.brief = False

    def draw(self, name: str, write: Callable[[Path], object]) -> Path | None:
        """Likewise, where the result is one without it, too; None where it was not made."""
        if self.asked and not self._live:
            return None
        try:
            with self.times.measure("draw"):
                return self.write(name, write)
        except KeyboardInterrupt as error:
            self.asked = signal_of(error)
            self._say(f"interrupted while {name} was drawn", 128 + self.asked)
        except LATE as error:
            self._fail(error, "" if isinstance(error, RequestError) else f"{name} could not be written: ")
        return None

    def done(self, summary: str) -> None:
        """What to tell of a whole result, in one line or several."""
        self._summary = summary

    def _fail(self, error: BaseException, prefix: str = "") -> None:
        self._say(prefix + message_of(error), FAILED)

    def _say(self, reason: str, status: int) -> None:
        if not self._reason:
            self._reason, self.status = reason, status

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        DEADLINE.brief = False
        with ExitStack() as stack:
            stack.push(self._stack.pop_all().__exit__)
            if self._kept is not None and isinstance(error, (KeyboardInterrupt, *LATE)):
                self._keep(self._kept, error)
            if error is not None and not (self._written and isinstance(error, (KeyboardInterrupt, *LATE))):
                # The stack clears away.
                stack.pop_all().__exit__(kind, error, trace)
                return False
            if isinstance(error, KeyboardInterrupt):
                self._say("interrupted", 128 + signal_of(error))
            elif error is not None:
                self._fail(error)
            elif not self._written:
                # The stack clears away: there is no result, which is no failure.
                stack.pop_all().__exit__(RunError, RunError(), None)
                self._report()
                return True
            elif self.asked and not self._live and not self._reason:
                self._say("interrupted", 128 + self.asked)
            self._patient = True
            self._record()
        self._report()
        return True

    def _keep(self, path: Path, error: BaseException) -> None:
        """What came of the frames, for a run that made no more of it."""
        path.replace(self.work / path.name)
        self._written = True
        if isinstance(error, KeyboardInterrupt):
            self._say(f"interrupted; {path.name} can be given to go on from", 128 + signal_of(error))

    def _record(self) -> None:
        shutil.rmtree(self.work / PARTS, ignore_errors=True)
        command, settings, seconds = self.output.command, self.output.settings, self.times.seconds
        facts = self.facts | self._facts_of_sources()
        for name, found in (("notes", [*NOTES]), ("models", records_of(settings.values()))):
            facts |= {name: found} if found else {}
        record = RunRecord(command, settings, int(settings.get("seed", 0)), seconds, self.columns)
        record.partial, record.reason = bool(self._reason), self._reason
        record.facts, record.results = facts, self.results
        record.write(self.work)

    def _facts_of_sources(self) -> dict[str, Any]:
        """Where the times of their frames come from, whether these are even, and where a live one had gaps."""
        from tsuiseki.tracking.video.frame_source import uneven

        found = {}
        for source in self.sources:
            facts = {} if source.live else uneven(list(source.times.values()))
            gaps = getattr(source, "gaps", [])
            found[source.name] = {"timed_by": source.timed_by, **facts, **({"gaps": gaps} if gaps else {})}
        return {"frame_times": found} if found else {}

    def _report(self) -> None:
        if self._reason:
            numbers = self.columns.get("frame")
            place = f"frame {numbers[-1] + 1}" if numbers else f"{self.count} steps"
            where = f" up to {place}" if self.count else ""
            complain(f"{self._reason}; the partial result{where} is in {self.output.out}, marked in its run.json", 0)
        elif self._summary:
            print(self._summary)


@dataclass(frozen=True)
class Output(Shared):
    """Where the result goes.

    Attributes:
        out: folder for the results.
        overwrite: replace an earlier result in the folder.
        command: the program's words, for ``run.json``.
        settings: every option with its value, as a file for ``--config`` has them; likewise.
        page: adds the page to a result that has `PageContent`; None for none.
    """

    out: Path
    overwrite: bool = False
    command: Sequence[str] = field(default=("tsuiseki",), metadata=NO_OPTION)
    settings: Mapping[str, Any] = field(default_factory=dict, metadata=NO_OPTION)
    page: Callable[[Any], Any] | None = field(default=None, metadata=NO_OPTION)

    def check(self) -> None:
        """See `Shared.check`."""
        check_output_folder(self.out, self.overwrite)

    def run(self) -> Run:
        """A run that writes there."""
        return Run(self)


@dataclass(frozen=True)
class SeededOutput(Seed, Output):
    """Where the result of something random goes."""
