"""The files of a run: each is made whole or not at all, and what is whole is kept, whatever ends the run."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from tsuiseki.tracking.output import RunRecord, check_there, naming, remove_if_empty
from tsuiseki.tracking.privacy import PRIVACY
from tsuiseki.tracking.runs.messages import NOTES
from tsuiseki.tracking.runs.reading import facts_of_sources
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.weights.catalogue import records_of

if TYPE_CHECKING:
    from tsuiseki.tracking.result import Result
    from tsuiseki.tracking.video.source import Source

T = TypeVar("T")
# Name of the fact that says which settings the user gave, with their values.
CHOSEN = "options"
# Settings that say where a result goes, not what it is.
PLACES = ("out", "overwrite", "overlay", "overlay_format")
# Sub-folder of files that are not whole yet.
PARTS = ".parts"


@dataclass(repr=False, eq=False)
class RunFiles:
    """Files that come into being in a working folder, and what ``run.json`` says of them.

    Attributes:
        out: the folder that they are for.
        overwrite: replace an earlier result there.
        command: the program's words, for ``run.json``.
        settings: every option with its value; likewise.
        page: adds the page to a result that has `PageContent`; None for none.
        chosen: names of the settings that the user gave.
        work: the working folder.
        times: seconds of each stage.
        columns: what happened in each frame, for ``run.json``: one list a column.
        facts: what the run found out about its input, or chose by itself; likewise.
        results: what is known of each result, by its folder; likewise.
        sources: videos that it read.
        finished: whether there is a whole file.
    """

    out: Path
    overwrite: bool = False
    command: Sequence[str] = ("tsuiseki",)
    settings: Mapping[str, Any] = field(default_factory=dict)
    page: Callable[[Any], Any] | None = None
    chosen: Sequence[str] = ()
    work: Path = field(init=False)
    times: StageTimes = field(default_factory=StageTimes)
    columns: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    sources: list[Source] = field(default_factory=list)
    finished: bool = False
    _lines: Path | None = None

    @property
    def asked(self) -> dict[str, Any]:
        """The settings that the user gave and that say what the result is, with their values."""
        return {name: self.settings[name] for name in self.chosen if name not in PLACES}

    def write(self, name: str, write: Callable[..., object], *values: object) -> Path:
        """Make the file ``name`` of the result by ``write(path, *values)``; it is kept from then on."""
        part, final = self.work / PARTS / name, self.work / name
        check_there(self.work, self.out)
        part.parent.mkdir(parents=True, exist_ok=True)
        try:
            with naming(self.out / name):
                write(part, *values)
            final.parent.mkdir(parents=True, exist_ok=True)
            self.finished, self._lines = True, None
            return part.replace(final)
        except BaseException:
            part.unlink(missing_ok=True)
            remove_if_empty(final.parent)
            raise

    def fill(self, write: Callable[[Path], object]) -> None:
        """Make all files of a result that ``write`` puts into a folder; they are kept from then on."""
        # What is written may take its name from the folder.
        part = self.work / PARTS / self.out.resolve().name
        check_there(self.work, self.out)
        with naming(self.out):
            write(part)
        for path in sorted(part.iterdir()):
            path.replace(self.work / path.name)
        self.finished = True

    def save(self, result: Result[Any], draw: Callable[[], object] = lambda: None, folder: str = "") -> None:
        """Write the files of ``result``, and take what it knows into ``run.json``.

        ``draw`` makes what the pages of the result show, when all other files are written; ``folder`` lies inside the
        output folder.
        """
        if asked := self.asked:
            result = replace(result, facts={**result.facts, CHOSEN: asked})
        if PRIVACY in self.facts:
            result = replace(result, facts={**result.facts, PRIVACY: self.facts[PRIVACY]})
        if self.page is not None and result.page is not None:
            result = self.page(result)
        self.columns = result.frames
        self.facts |= result.facts
        self.results[folder or "."] = result.video_record()
        for pages in (False, True):
            for name, write in result.files.items():
                if (name.startswith("report/") or name.endswith((".html", ".png"))) == pages:
                    self.write(str(PurePath(folder, name)), write, self.work / folder)
            if not pages:
                draw()

    def kept(
        self, name: str, items: Iterable[tuple[int, T]], line: Callable[[int, T], str] | None
    ) -> Iterator[tuple[int, T]]:
        """Numbered ``items``; where the run ends before it has made more of them, the file ``name`` has their lines.

        Args:
            name: of the file.
            items: that take long to make.
            line: of a number and an item; None where nothing is lost with them.
        """
        path = self.work / PARTS / name
        check_there(self.work, self.out)
        with path.open("w", encoding="utf-8") as file:
            for number, item in items:
                if line is not None:
                    with naming(self.out / name):
                        file.write(line(number, item))
                        file.flush()
                    self._lines = path
                yield number, item

    def keep_lines(self) -> str:
        """Make a whole file of the lines of `kept`, where nothing was made of them; returns its name, or nothing."""
        if self._lines is None:
            return ""
        self.finished = True
        return self._lines.replace(self.work / self._lines.name).name

    def record(self, reason: str) -> None:
        """Write ``run.json``: the run is partial where there is a ``reason``."""
        shutil.rmtree(self.work / PARTS, ignore_errors=True)
        facts = self.facts | facts_of_sources(self.sources)
        for name, values in (("notes", [*NOTES]), ("models", records_of(self.settings.values()))):
            facts |= {name: values} if values else {}
        record = RunRecord(
            self.command, self.settings, int(self.settings.get("seed", 0)), self.times.seconds, self.columns
        )
        record.partial, record.reason = bool(reason), reason
        record.facts, record.results = facts, self.results
        record.write(self.work)
