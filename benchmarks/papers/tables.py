"""Measurements of rows on units as a table: intervals over the units, and the paper's values beside ours."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from scipy.stats import t

from tsuiseki.tracking.evaluation.tables import score_table
from tsuiseki.tracking.types import FloatArray

Name: TypeAlias = str | tuple[str, ...]
"""Of a row: the cells that begin its line in a table."""
Show: TypeAlias = Callable[[FloatArray, str], str]
"""Text of the values ``(S,)`` of S units, from the values and the format of a number."""
# Samples of a bootstrap interval.
SAMPLES = 10_000


def interval(values: FloatArray) -> tuple[float, float, float]:
    """Mean of ``values`` ``(S,)`` and its interval of 95 % by Student's t; NaN ends for one value.

    >>> interval(np.array([1.0, 2.0, 3.0]))[0]
    2.0
    """
    mean = float(np.mean(values))
    if len(values) < 2:
        return mean, float("nan"), float("nan")
    half = float(t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return mean, mean - half, mean + half


def bootstrap(values: FloatArray) -> tuple[float, float, float]:
    """Mean of ``values`` ``(S,)`` and its interval of 95 % over samples of S values drawn with replacement."""
    rng = np.random.default_rng(0)
    means = values[rng.integers(len(values), size=(SAMPLES, len(values)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(values.mean()), float(low), float(high)


def mean_only(values: FloatArray, form: str) -> str:
    """The mean."""
    return f"{np.mean(values):{form}}"


def at_quantile(values: FloatArray, form: str, share: float) -> str:
    """The value below which a ``share`` of them lies."""
    return f"{np.quantile(values, share):{form}}"


def share_of_all(values: FloatArray, form: str) -> str:
    """The sum of parts over that of wholes, percent, from values that are a part and a whole by turns."""
    part, total = values.reshape(-1, 2).sum(axis=0)
    return f"{100 * part / max(total, 1):{form}}"


def with_error(values: FloatArray, form: str, ddof: int = 1) -> str:
    """The mean and its standard error, from the sum of squares over ``S - ddof``."""
    error = np.std(values, ddof=ddof) / np.sqrt(len(values)) if len(values) > ddof else float("nan")
    return f"{np.mean(values):{form}} ± {error:{form.lstrip('+')}}"


def _between(values: FloatArray, form: str, ends: Callable[[FloatArray], tuple[float, float, float]]) -> str:
    mean, low, high = (f"{value:{form}}" for value in ends(values))
    return f"{mean} [{low}, {high}]" if len(values) > 1 else mean


median_only: Show = partial(at_quantile, share=0.5)
"""The median."""
with_interval: Show = partial(_between, ends=interval)
"""The mean and its interval by Student's t."""
with_bootstrap: Show = partial(_between, ends=bootstrap)
"""The mean and its bootstrap interval."""


@dataclass(frozen=True)
class Column:
    """A column of a table of measurements.

    Attributes:
        heading: above it.
        value: of a unit: a function, or its field or key; dots lead into nested ones and entries by number. A
            number, or an array of which all units' together are shown.
        form: format of a number.
        factor: times the value, such as 100 for percent.
        show: the values of all units as text.
        paper: the paper's value by row; a column of them then stands to the right.
        beside: its heading.
        gain: shows the differences to the base of `tabulated`, unit by unit, in a column to the right.
    """

    heading: str
    value: str | Callable[[Any], Any] = float
    form: str = ".2f"
    factor: float = 1.0
    show: Show = mean_only
    paper: Mapping[Any, float] = field(default_factory=dict)
    beside: str = "paper"
    gain: Show | None = None

    def values(self, measured: Iterable[Any]) -> FloatArray:
        """``(S,)`` values of S units."""
        return self.factor * np.concatenate([np.atleast_1d(self._value(unit)) for unit in measured]).astype(np.float64)

    def _value(self, unit: Any) -> Any:
        if callable(self.value):
            return self.value(unit)
        for part in self.value.split("."):
            unit = (
                unit[part] if isinstance(unit, Mapping) else unit[int(part)] if part.isdigit() else getattr(unit, part)
            )
        return unit


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
        """The table in Markdown, without its title."""
        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        escaped = [[cell.replace("|", r"\|") for cell in line] for line in lines]
        return "\n".join(f"| {' | '.join(line)} |" for line in escaped)

    def text(self) -> str:
        """The table for a terminal."""
        from rich.console import Console

        table = score_table(self.columns[:1], self.columns[1:], [self.rows])
        table.title, table.title_justify = self.title or None, "left"
        # A table squeezed into too few columns loses digits; a line that wraps does not.
        console = Console(width=1000, color_system=None)
        with console.capture() as capture:
            console.print(table)
        return capture.get()


def tabulated(
    measured: Mapping[Any, Iterable[Any]],
    columns: Sequence[Column],
    heads: Sequence[str] = ("",),
    title: str = "",
    base: Callable[[Any], Name] | Name | None = None,
) -> Table:
    """A line for each row.

    Args:
        measured: measurements by row, one a unit, the units in the same order.
        columns: of the table.
        heads: headings of the cells of a row's name.
        title: stands above.
        base: the row that gains are over, or a function that names it for a row.
    """
    headings = list(heads)
    for column in columns:
        over = f" over {base}" if isinstance(base, str) else ", gain"
        headings += [column.heading, *([column.beside] if column.paper else [])]
        headings += [f"{column.heading}{over}"] if column.gain else []
    lines = []
    for name, measurements in measured.items():
        cells: list[str] = [name] if isinstance(name, str) else list(name)
        below = base(name) if callable(base) else base
        for column in columns:
            values = column.values(measurements)
            cells.append(column.show(values, column.form))
            if column.paper:
                cells.append(f"{column.paper[name]:{column.form}}" if name in column.paper else "")
            if column.gain:
                alone = below in (None, name)
                cells.append("" if alone else column.gain(values - column.values(measured[below]), f"+{column.form}"))
        lines.append(cells)
    return Table(title, headings, lines)


def values_of(measured: Mapping[Any, Iterable[Any]], heads: Sequence[str] = ("row",)) -> list[dict[str, Any]]:
    """All measurements for results.json: of each row its name, a key a head, and ``runs``, one a unit."""
    names = {name: (name,) if isinstance(name, str) else name for name in measured}
    return [{**dict(zip(heads, names[name], strict=True)), "runs": runs} for name, runs in measured.items()]
