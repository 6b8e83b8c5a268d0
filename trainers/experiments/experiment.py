"""What an experiment is given and what it hands back.

An experiment is a module with a function ``reproduce(bench, option, …) -> Outcome``. It computes through
``bench.store``, and neither prints nor writes: `tsuiseki reproduce` does that for all of them alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import ImageArray
from tsuiseki.trainers.experiments.store import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")


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
            raise RequestError(f"{name}: expected at least 1, got {value}")
