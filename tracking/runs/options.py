"""Options that several commands take: the seed, where the result goes, and files to write."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import NonNegativeInt
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import Interrupted, RequestError, signal_of
from tsuiseki.tracking.fields import HIDDEN, Options
from tsuiseki.tracking.output import LIVE_FILE, check_output_file, check_output_folder, output_file
from tsuiseki.tracking.runs.run import Run

T = TypeVar("T")
PLOT_KINDS = (".png", ".svg", ".pdf")


@dataclass(frozen=True, config=SETTINGS)
class Seed(Options):
    """For chance.

    Attributes:
        seed: of all random numbers.
    """

    seed: NonNegativeInt = 0


@dataclass(frozen=True, config=SETTINGS)
class Output(Options):
    """Where the result goes.

    Attributes:
        out: folder for the results.
        overwrite: replace an earlier result in the folder.
        command: the program's words, for ``run.json``.
        settings: every option with its value, as a file for ``--config`` has them; likewise.
        page: adds the page to a result that has `PageContent`; None for none.
        chosen: names of the settings that the user gave.
    """

    out: Path
    overwrite: bool = False
    command: Annotated[tuple[str, ...], HIDDEN] = ("tsuiseki",)
    settings: Annotated[dict[str, Any], HIDDEN] = field(default_factory=dict)
    page: Annotated[Callable[[Any], Any] | None, HIDDEN] = None
    chosen: Annotated[tuple[str, ...], HIDDEN] = ()

    def check(self) -> None:
        """Refuse, before anything is computed, a folder that cannot be filled; raises RequestError.

        Whether a live run may go on in it is asked when it begins.
        """
        check_output_folder(self.out, self.overwrite or (self.out / LIVE_FILE).is_file())

    def run(self) -> AbstractContextManager[Run]:
        """A run that writes there."""
        return Run(self.out, self.overwrite, self.command, self.settings, self.page, self.chosen).opened()


@dataclass(frozen=True, config=SETTINGS)
class SeededOutput(Seed, Output):
    """Where the result of something random goes."""


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Files(Options):
    """Files to write, each whole or not at all.

    Attributes:
        overwrite: replace existing files.
    """

    overwrite: bool = False
    written: Annotated[list[Path], HIDDEN] = field(default_factory=list)
    # Options that name a file to write.
    file_options: ClassVar[Sequence[str]] = ()

    def check(self) -> None:
        """Refuse, before anything is computed, files that cannot be written; raises RequestError."""
        for name in self.file_options:
            path = getattr(self, name)
            if path is not None:
                check_output_file(path, self.overwrite)
            if name == "plot" and path is not None and path.suffix.lower() not in PLOT_KINDS:
                raise RequestError(f"`plot`: expected a file name ending in {', '.join(PLOT_KINDS)}, got {path}")

    def write(self, path: Path, write: Callable[[Path], T]) -> T:
        """Make the file ``path``; returns what ``write`` does."""
        try:
            with output_file(path, self.overwrite) as work:
                result = write(work)
        except KeyboardInterrupt as error:
            if not self.written:
                raise
            raise Interrupted(signal_of(error), f"{', '.join(map(str, self.written))} is written") from error
        self.written.append(path)
        return result

    def draw(self, save: Callable[[Path], object]) -> None:
        """Write the ``plot``, where that is wanted."""
        plot: Path | None = getattr(self, "plot", None)
        if plot is not None:
            self.write(plot, save)


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class OutputFile(Files):
    """A file to write.

    Attributes:
        out: file to write.
    """

    file_options: ClassVar[Sequence[str]] = ("out",)
    out: Path


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class PlottedFile(OutputFile):
    """A file to write, and a picture of it.

    Attributes:
        plot: also draw a plot into this file (PNG, SVG or PDF).
    """

    file_options: ClassVar[Sequence[str]] = ("out", "plot")
    plot: Path | None = None
