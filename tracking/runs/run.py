"""A run: the frame of every command that fills a folder, and what a signal does to it.

    with output.run() as run:
        steps = run.steps(run.frames(source))
        result = blob_result(tracker, steps, ...)               # what the function for Python returns, too
        run.save(result, lambda: video.draw(run, source, result))
        run.done(f"{len(result)} objects: {output.out / 'tracks.txt'}")
    return run.status

A run is in one of these states. SIGINT (Ctrl-C), SIGTERM and SIGHUP do the same in each:

    state    what happens                                          a signal
    idle     nothing is worth finishing: no step is finished, a    ends it at once: `Interrupted`
             user or a camera is waited for, or an overlay is drawn
    running  steps are made, linked and written                    → asked
    asked    the step under way is the last one; what is           ends it at once: `Interrupted`
             finished is linked and written
    writing  whole files take their names, run.json the last       nothing: this takes no time

    idle, running → writing → done        exit status 0
    asked → writing → partial             128 + the signal; run.json says partial, and why
    running → writing → partial           1: the source broke off or the disk was full, after the first step
    idle, running, asked → failed         128 + the signal, 1, or 2 for a wrong request; the folder is as it was before

With `overwrite` a partial result lies beside a whole one, in OUT.partial, and the whole one stays.

What is finished is a file that `RunFiles.write` has made whole, or the lines of `RunFiles.kept`. A run that is ended at
once with something finished is partial, not failed. In an overlay a signal ends the drawing alone: the rest is written.
A live source ends by a signal in no other way than by its end: the run is done, not partial.

* A signal that the process was started to ignore stays ignored (`on_signals`).
* A long call of a library is not cut short: the signals wait for its end. SIGKILL does not. It leaves nothing half
  under a final name, and the next run clears up (`output_folder`).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from tsuiseki.tracking.errors import Interrupted, RunError, signal_of
from tsuiseki.tracking.output import check_there, landing, output_folder
from tsuiseki.tracking.runs.ending import DONE, FAILED, SIGNALLED, is_late, on_signals
from tsuiseki.tracking.runs.files import PARTS, RunFiles
from tsuiseki.tracking.runs.messages import complain, message_of
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.runs.reading import Reading

if TYPE_CHECKING:
    from tsuiseki.tracking.types import Frame
    from tsuiseki.tracking.video.source import Source

T = TypeVar("T")
# Loaded before the first step, for steps and results: where memory ends meanwhile, some would wait for it for ever.
LIBRARIES = (
    "scipy.fft",
    "scipy.ndimage",
    "scipy.optimize",
    "scipy.sparse.csgraph",
    "matplotlib.figure",
    "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_svg",
    "jinja2",
    "PIL.Image",
)
# Names of pages, of which a folder has one.
PAGES = ("report.html", "index.html")
State = Enum("State", ["IDLE", "RUNNING", "ASKED", "WRITING"])


def where_to_look(folder: Path) -> str:
    """The last line of every command that writes a page, such as ``open answers/report.html``; empty without one."""
    return next((f"open {folder / name}" for name in PAGES if (folder / name).is_file()), "")


@dataclass(repr=False, eq=False)
class Run(RunFiles):
    """A run of a command that fills a folder; see the head of this file.

    Attributes:
        state: see there.
        count: finished steps.
        status: exit status, known after the ``with`` block.
        signal: the signal by which the user asked to end, 0 where none came: begin no other part.
    """

    state: State = State.IDLE
    count: int = 0
    status: int = DONE
    signal: int = 0
    _reading: Reading = field(default_factory=Reading)
    _expected: int | None = None
    _start: int = 0
    _live: bool = False
    _reason: str = ""
    _summary: str = ""

    @contextmanager
    def opened(self) -> Iterator[Run]:
        """Within the ``with`` block its files come into being; at the end they lie in the output folder."""
        folder = output_folder(self.out, self.overwrite)
        with on_signals(self._hear), folder as self.work:
            (self.work / PARTS).mkdir()
            try:
                yield self
            except (KeyboardInterrupt, Exception) as error:
                self.state = State.WRITING
                if not (isinstance(error, KeyboardInterrupt) or is_late(error)):
                    raise
                check_there(self.work, self.out)
                lines = self.keep_lines()
                if not self.finished:
                    raise
                self.mark_partial(error, f"; {lines} can be given to go on from" if lines else "")
            self.state = State.WRITING
            if self.signal and not self._live:
                self.mark_partial(Interrupted(self.signal))
            check_there(self.work, self.out)
            self.record(self._reason)
            place = landing(self.work, self.out)
        self._report(place)

    def _hear(self, number: int) -> None:
        """What a signal does in each state."""
        state = self.state
        if state is not State.WRITING:
            self.state, self.signal = State.ASKED, number
            if state is not State.RUNNING:
                raise Interrupted(number)
            complain("interrupted: what is finished is being written; another interrupt ends at once")

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Within the ``with`` block it is idle: a signal is heard at once, for nothing there needs finishing."""
        state, self.state = self.state, State.IDLE
        try:
            yield
        finally:
            self.state = state if self.state is State.IDLE else self.state

    def frames(self, source: Source, record: bool = False) -> Iterator[Frame]:
        """The frames of ``source``, up to where it breaks off; ``record`` keeps those of a live one for `replay`."""
        self.sources.append(source)
        self._expected = source.frames_expected
        self._reading = Reading(self.work / PARTS / "recording.webm" if record and source.live else None)
        frames = self.unending(source.frames()) if source.live else source.frames()
        return self._reading.frames(frames, source.frame_rate, self.mark_partial)

    def unending(self, items: Iterable[T]) -> Iterator[T]:
        """``items`` of a live source: a signal ends them at once, and what came before is kept."""
        self._live, iterator = True, iter(items)
        while not self.signal:
            try:
                with self.waiting():
                    item = next(iterator)
            except (KeyboardInterrupt, StopIteration):
                return
            yield item

    def steps(self, items: Iterable[T], what: str = "tracking", total: int | None = None) -> Iterator[T]:
        """``items``, with progress, up to a signal or to where they fail, see `reported_to`.

        The ``total`` is by default that of the frames of the last source, where it is known.

        Raises:
            RunError: there is none.
            KeyboardInterrupt: before the first step was finished.
        """
        self._start = start = self.count
        for library in LIBRARIES:
            importlib.import_module(library)
        self.state = State.RUNNING if self.state is State.IDLE else self.state
        try:
            for item in () if self.signal else progress(items, what, self._expected if total is None else total):
                yield item
                self.count += 1
                if self.signal:
                    break
        except Exception as error:
            if self.count == start or not is_late(error):
                raise
            self.mark_partial(error)
        if self.count == start:
            raise Interrupted(self.signal) if self.signal else RunError("expected frames, got none")

    def replay(self, source: Source) -> Iterator[Frame]:
        """The finished frames again, to draw on."""
        length = self.count - self._start
        return progress(self._reading.replay(source, length), "drawing", length)

    def draw(self, name: str, write: Callable[[Path], object]) -> Path | None:
        """Make the file ``name``, without which the result is one, too; None where it was not made."""
        if self.signal and not self._live:
            return None
        try:
            with self.waiting(), self.times.measure("draw"):
                return self.write(name, write)
        except (KeyboardInterrupt, Exception) as error:
            if not (isinstance(error, KeyboardInterrupt) or is_late(error)):
                raise
            self.mark_partial(error, f" while {name} was drawn")
        return None

    def mark_partial(self, error: BaseException, where: str = "") -> None:
        """The result is not whole, because of ``error``; the first one counts."""
        if not self._reason:
            stopped = isinstance(error, KeyboardInterrupt)
            self._reason = ("interrupted" if stopped else message_of(error)) + where
            self.status = SIGNALLED + signal_of(error) if isinstance(error, KeyboardInterrupt) else FAILED

    def done(self, summary: str) -> None:
        """What to tell of a whole result, in one line or several."""
        self._summary = summary

    def _report(self, folder: Path) -> None:
        if self._reason:
            numbers = self.columns.get("frame")
            place = f"frame {numbers[-1] + 1}" if numbers else f"{self.count} steps"
            where = f" up to {place}" if self.count else ""
            whole = "" if folder == self.out else f"; the whole one in {self.out} stays"
            complain(f"{self._reason}; the partial result{where} is in {folder}, marked in its run.json{whole}")
        else:
            for line in filter(None, (self._summary, where_to_look(folder))):
                print(line)
