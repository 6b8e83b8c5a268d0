"""Options as dataclasses: what a typed function takes, and how the command line shows it.

A function whose parameter is such a dataclass has its fields as options of the command itself. A field marked
`BY_PLACE` is given by place, without its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral
from pathlib import Path
from typing import ClassVar, TypeVar

from tsuiseki.tracking.errors import Interrupted, RequestError, signal_of
from tsuiseki.tracking.output import check_output_file, output_file

T = TypeVar("T")
PLOT_KINDS = (".png", ".svg", ".pdf")

# Metadata of fields of `Shared` dataclasses: given by place (a list takes all words that follow); no option at all.
BY_PLACE: Mapping[str, bool] = {"positional": True}
NO_OPTION: Mapping[str, bool] = {"option": False}


class Shared:
    """A dataclass whose fields are options of the command itself, not below the parameter's name.

    The texts for the help stand under ``Attributes:``; a command may word one of its own under ``Args:``.
    """

    def check(self) -> None:
        """Refuse values; called by the parser.

        Raises:
            RequestError: with names of options in backquotes.
        """


@dataclass(frozen=True)
class Seed(Shared):
    """For chance.

    Attributes:
        seed: of all random numbers.
    """

    seed: int = 0

    def check(self) -> None:
        super().check()
        if not isinstance(self.seed, Integral) or self.seed < 0:
            raise RequestError(f"`seed`: expected a whole number from 0, got {self.seed!r}")


@dataclass(frozen=True, kw_only=True)
class Files(Shared):
    """Files to write, each whole or not at all.

    Attributes:
        overwrite: replace existing files.
    """

    overwrite: bool = False
    written: list[Path] = field(default_factory=list, metadata=NO_OPTION)
    # Options that name a file to write.
    file_options: ClassVar[Sequence[str]] = ()

    def check(self) -> None:
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


@dataclass(frozen=True, kw_only=True)
class OutputFile(Files):
    """A file to write.

    Attributes:
        out: file to write.
    """

    file_options: ClassVar[Sequence[str]] = ("out",)
    out: Path


@dataclass(frozen=True, kw_only=True)
class PlottedFile(OutputFile):
    """A file to write, and a picture of it.

    Attributes:
        plot: also draw a plot into this file (PNG, SVG or PDF).
    """

    file_options: ClassVar[Sequence[str]] = ("out", "plot")
    plot: Path | None = None
