"""What an experiment is given and what it hands back.

An experiment is a module with a function ``reproduce(bench, option, …) -> Outcome``. It computes through
``bench.store``, and neither prints nor writes: `tsuiseki reproduce` does that for all of them alike.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import ImageArray
from tsuiseki.trainers.experiments.store import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")
# Columns of a terminal that a table may have.
LEAST_WIDTH = 160


class Watch:
    """Who is told how far an experiment is; this one tells nobody."""

    fingerprint = "how progress is shown makes no difference"

    def over(self, items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        """Pass ``items`` through; ``what`` is being done, for the line, and ``total`` their number if known."""
        del what, total
        yield from items

    def say(self, line: str) -> None:
        """A line of progress."""


@dataclass(frozen=True)
class Bench:
    """Where an experiment works.

    Attributes:
        store: keeps what was computed.
        watch: is told how far it is.
    """

    store: Store
    watch: Watch = field(default_factory=Watch)


@dataclass(frozen=True)
class Table:
    """A table as it is printed.

    Attributes:
        title: stands above it.
        columns: headings.
        rows: one cell a column.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """The table in Markdown."""
        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        return "\n".join([f"{self.title}\n" if self.title else "", *(f"| {' | '.join(line)} |" for line in lines)])

    def text(self) -> str:
        """The table for a terminal."""
        from rich.box import SIMPLE_HEAD
        from rich.console import Console
        from rich.table import Table as Shown

        shown = Shown(title=self.title or None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
        for number, heading in enumerate(self.columns):
            shown.add_column(heading, justify="right" if number else "left")
        for row in self.rows:
            shown.add_row(*row)
        console = Console(width=max(LEAST_WIDTH, Console().width), color_system=None)
        with console.capture() as capture:
            console.print(shown)
        return capture.get()


@dataclass(frozen=True)
class Outcome:
    """What an experiment found.

    Attributes:
        values: all numbers, for results.json: dictionaries, lists and plain values.
        tables: the paper's and ours.
        plots: figures by name, written as NAME.png.
        files: what else is written, by name: text, or the bytes of a picture.
        notes: lines that stand below the tables.
        finished: False where it was stopped by its own limit: then nothing but the notes is shown, and running it
            again goes on.
    """

    values: Any = None
    tables: Sequence[Table] = ()
    plots: Mapping[str, Figure] = field(default_factory=dict)
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    notes: Sequence[str] = ()
    finished: bool = True

    def parts(self) -> Iterator[tuple[str, Callable[[Path], Any]]]:
        """The files of the result: the name of each, and what writes it to a path."""
        yield "results.json", partial(_write, content=json.dumps(self.values, indent=1) + "\n")
        text = "\n\n".join([*(table.markdown() for table in self.tables), *self.notes])
        yield "tables.md", partial(_write, content=text.strip() + "\n")
        for name, figure in self.plots.items():
            yield f"{name}.png", partial(figure.savefig, facecolor="white")
        for name, content in self.files.items():
            yield name, partial(_write, content=content)


def _write(path: Path, content: str | bytes) -> None:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def png(image: ImageArray) -> bytes:
    """A picture as the bytes of a PNG file."""
    import cv2

    return bytes(cv2.imencode(".png", np.ascontiguousarray(image[:, :, ::-1]))[1])


def at_least_one(**numbers: float) -> None:
    """Refuse arguments below 1.

    Raises:
        RequestError: names the first of them.
    """
    for name, value in numbers.items():
        if value < 1:
            raise RequestError(f"`{name}`: expected at least 1, got {value}")
