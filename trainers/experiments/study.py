"""An experiment as data: rows × units, computed through the store, and the tables, numbers and plots of what came out.

`Store.study` takes rows (what is compared), units (clips, sequences or seeds) and a function that measures one row on
one unit. `tabulated` turns the measurements into a table with intervals over the units and the paper's values beside
ours, `curves` into a plot. An experiment's module has a function ``reproduce(store, option, …) -> Outcome``; it neither
prints nor writes, as `tsuiseki reproduce` does that for all of them alike.

What was computed is kept: a value is taken from disk where the same function was given the same arguments before. An
entry's name is a digest of the function, its arguments, the data they name and the version of the code: all of our
sources, and the versions of the packages that results depend on. So an experiment that was stopped goes on where it
was, and nothing stale is ever taken. What other code made of the same arguments is removed when it is computed anew.
"""

from __future__ import annotations

import hashlib
import inspect
import io
import json
import pickle
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeAlias, TypeVar

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import t

from tsuiseki.datamodules.scenes.clip import Clip, write_clip
from tsuiseki.tracking.errors import Interrupted, RequestError, signal_of
from tsuiseki.tracking.evaluation.tables import score_table
from tsuiseki.tracking.output import output_folder, versions
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.runs.run import Output
from tsuiseki.tracking.types import FloatArray

P = ParamSpec("P")
T = TypeVar("T")
Name: TypeAlias = str | tuple[str, ...]
"""Of a row: the cells that begin its line in a table."""
Show: TypeAlias = Callable[[FloatArray, str], str]
"""Text of the values ``(S,)`` of S units, from the values and the format of a number."""
SAMPLES = 10_000
FROM_ZERO = ("seed", "first_seed", "fast_seeds", "places", "streets")
"""Numbers of experiments that may be 0."""
PACKAGES = ("tracking", "datamodules", "models", "trainers")


@dataclass(frozen=True)
class Store:
    """Values and folders by what made them.

    Attributes:
        folder: of all entries, made when the first is written.
    """

    folder: Path

    def recall(self, compute: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """``compute(*args, **kwargs)``, from disk where it is there.

        Args:
            compute: a function of a module, or a `partial` of one. All that it depends on is an argument or imported;
                its value is pickled.
            args: what pickle takes; paths stand for what is in them, and an object with a ``fingerprint`` for that.
            kwargs: likewise.

        Raises:
            PicklingError, AttributeError: ``compute`` or an argument has no lasting name, such as a lambda.
        """
        home = self._entry(compute, args, kwargs)
        path = _kept(home / "value.pickle", lambda path: path.write_bytes(pickle.dumps(compute(*args, **kwargs))))
        return pickle.loads(path.read_bytes())  # type: ignore[no-any-return]

    def each(self, compute: Callable[..., T], jobs: Sequence[Iterable[Any]], what: str) -> list[T]:
        """``compute(*job)`` of every job, as `recall`; ``what`` names them in the line of progress."""
        return [self.recall(compute, *job) for job in progress(jobs, what, len(jobs))]

    def study(
        self, rows: Mapping[Any, Callable[[Any], T]], units: Sequence[Any], what: str = "runs"
    ) -> dict[Any, list[T]]:
        """Measurements of each row, one a unit; each is kept at once, so that an interrupted study goes on.

        Args:
            rows: how each row measures a unit, by its name in the order of the table: a function of a module, or a
                `partial` of one with the row's settings. It gives a number, or a dataclass or dictionary of numbers.
            units: what every row is measured on.
            what: names the runs in the line of progress.
        """
        measured: dict[Any, list[T]] = {name: [] for name in rows}
        jobs = [(unit, name) for unit in units for name in rows]
        for unit, name in progress(jobs, what, len(jobs)):
            measured[name].append(self.recall(rows[name], unit))
        return measured

    def made(self, name: str, write: Callable[Concatenate[Path, P], Any], *args: P.args, **kwargs: P.kwargs) -> Path:
        """The file or folder ``name`` that ``write(path, *args, **kwargs)`` makes, from an earlier run if it is there.

        Raises:
            PicklingError, AttributeError: as `recall`.
        """
        return _kept(self._entry(write, (name, *args), kwargs) / name, lambda path: write(path, *args, **kwargs))

    def _entry(self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Path:
        """The folder of an entry: its name tells what was asked, and what answered."""
        asked = io.BytesIO()
        _CallPickler(asked).dump((function, args, sorted(kwargs.items())))
        answered = f"{code_version()} {sorted(versions().items())}"
        name = getattr(function, "func", function).__name__
        return self.folder / name / f"{_digest(asked.getvalue())}-{_digest(answered.encode())}"


def _kept(path: Path, write: Callable[[Path], Any]) -> Path:
    """The file or folder at ``path``, written if it is not there; then what other code made of the same call goes."""
    home = path.parent
    # A run that was killed leaves its folder behind, without what it was to hold.
    if not path.exists():
        with output_folder(home, overwrite=True) as work:
            write(work / path.name)
        for older in home.parent.glob(f"{home.name.partition('-')[0]}-*"):
            if older != home:
                shutil.rmtree(older, ignore_errors=True)
    return path


class _CallPickler(pickle.Pickler):
    """Bytes that are the same for the same call: no memory of objects, files by their content."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, protocol=5)
        self.fast = True

    def persistent_id(self, value: Any) -> Any:
        """What stands for a value; None for itself."""
        if isinstance(value, Path):
            return _content(value)
        fingerprint = getattr(value, "fingerprint", None)
        return fingerprint if isinstance(fingerprint, str) else None

    def reducer_override(self, value: Any) -> Any:
        """Of a dataclass its fields alone, whatever else was computed on it since."""
        if is_dataclass(value) and not isinstance(value, type):
            return type(value), tuple(getattr(value, field.name) for field in fields(value))
        return NotImplemented


def _digest(value: bytes) -> str:
    return hashlib.sha256(value).hexdigest()[:32]


@cache
def code_version() -> str:
    """A digest of all our sources, and of the small tables that ship beside the models; arguments name models."""
    packages = [Path(str(resources.files(f"tsuiseki.{name}"))) for name in PACKAGES]
    files = [*(path for package in packages for path in package.rglob("*.py")), *packages[0].glob("weights/*.json")]
    return _digest(b"".join(str(path.name).encode() + path.read_bytes() for path in sorted(files)))


def _content(path: Path) -> Any:
    """A digest of a file, or of the files in a folder by name."""
    if path.is_dir():
        return {p.relative_to(path).as_posix(): _content(p) for p in sorted(path.rglob("*")) if p.is_file()}
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_planned(folder: Path, plan: Callable[..., Clip[Any]], *args: Any) -> None:
    """Draw the clip that ``plan(*args)`` plans; for `Store.made`."""
    write_clip(folder, plan(*args))


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
    part, whole = values.reshape(-1, 2).sum(axis=0)
    return f"{100 * part / max(whole, 1):{form}}"


def with_error(values: FloatArray, form: str, ddof: int = 1) -> str:
    """The mean and its standard error, from the sum of squares over ``S - ddof``."""
    error = np.std(values, ddof=ddof) / np.sqrt(len(values)) if len(values) > ddof else float("nan")
    return f"{np.mean(values):{form}} ± {error:{form.lstrip('+')}}"


def with_deviation(values: FloatArray, form: str) -> str:
    """The mean and the standard deviation of the values."""
    return f"{np.mean(values):{form}} ± {np.std(values):{form.lstrip('+')}}"


def _between(values: FloatArray, form: str, ends: Callable[[FloatArray], tuple[float, float, float]]) -> str:
    mean, low, high = (f"{one:{form}}" for one in ends(values))
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
        value: of a measurement: a function, or its field or key; dots lead into nested ones and entries by number. A
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
        return self.factor * np.concatenate([np.atleast_1d(self._value(one)) for one in measured]).astype(np.float64)

    def _value(self, one: Any) -> Any:
        if callable(self.value):
            return self.value(one)
        for part in self.value.split("."):
            one = one[part] if isinstance(one, Mapping) else one[int(part)] if part.isdigit() else getattr(one, part)
        return one


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
        from rich.console import Console

        shown = score_table(self.columns[:1], self.columns[1:], [self.rows])
        shown.title, shown.title_justify = self.title or None, "left"
        # A table squeezed into too few columns loses digits; a line that wraps does not.
        console = Console(width=1000, color_system=None)
        with console.capture() as capture:
            console.print(shown)
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
    for name, own in measured.items():
        cells: list[str] = [name] if isinstance(name, str) else list(name)
        below = base(name) if callable(base) else base
        for column in columns:
            values = column.values(own)
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


@dataclass(frozen=True)
class Curve:
    """A line of a plot.

    Attributes:
        label: in the legend.
        x: ``(N,)``.
        y: ``(N,)``.
        error: ``(N,)``, or ``(2, N)`` below and above, of the bars; None for none.
        style: of Matplotlib.
    """

    label: str
    x: Sequence[float] | FloatArray
    y: Sequence[float] | FloatArray
    error: FloatArray | Sequence[float] | None = None
    style: str = "o-"


def curves(
    panels: Mapping[str, Sequence[Curve]], across: Sequence[str], up: str, size: tuple[float, float] = (4.5, 3.6)
) -> Figure:
    """A panel beside the other, each with its lines and a legend; its axes can be changed afterwards.

    Args:
        panels: lines by title.
        across: label of the horizontal axis of each panel.
        up: label of the vertical axis of the first.
        size: of a panel, inches.
    """
    figure = Figure(figsize=(size[0] * len(panels), size[1]), dpi=100, layout="constrained")
    for place, (title, lines) in enumerate(panels.items()):
        axes = figure.add_subplot(1, len(panels), place + 1)
        for number, one in enumerate(lines):
            colour = COLOURS[number % len(COLOURS)]
            axes.errorbar(one.x, one.y, one.error, fmt=one.style, color=colour, label=one.label, capsize=2)
        axes.set_title(title, loc="left")
        axes.set(xlabel=across[place], ylabel=up if place == 0 else "")
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize="small")
    return figure


@dataclass(frozen=True)
class Outcome:
    """What an experiment found.

    Attributes:
        values: all numbers, for results.json: dictionaries, lists, dataclasses, arrays and plain values.
        tables: the paper's and ours.
        plots: figures by name, written as NAME.png.
        files: what else is written, by name: text, or the bytes of a picture.
        notes: lines that stand below the tables.
    """

    values: Any = None
    tables: Sequence[Table] = ()
    plots: Mapping[str, Figure] = field(default_factory=dict)
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    notes: Sequence[str] = ()

    def parts(self) -> Iterator[tuple[str, Callable[[Path], Any]]]:
        """The files of the result: the name of each, and what writes it to a path."""
        yield "results.json", partial(_write, content=json.dumps(self.values, indent=1, default=_plain) + "\n")
        text = "\n\n".join([*(table.markdown() for table in self.tables), *self.notes])
        yield "tables.md", partial(_write, content=text.strip() + "\n")
        for name, figure in self.plots.items():
            yield f"{name}.png", partial(figure.savefig, facecolor="white")
        for name, content in self.files.items():
            yield name, partial(_write, content=content)


def _plain(value: Any) -> Any:
    """What JSON cannot hold, in its terms."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value) if isinstance(value, Path) else vars(value)


def _write(path: Path, content: str | bytes) -> None:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def some_of(known: Sequence[str], **asked: Sequence[str]) -> None:
    """Refuse arguments with other words than the ``known`` ones, or with none.

    Raises:
        RequestError: names the first of them.
    """
    for name, words in asked.items():
        if not words or not set(words) <= set(known):
            wrong = next((word for word in words if word not in known), "none")
            raise RequestError(f"`{name}`: expected some of {', '.join(known)}, got {wrong!r}")


@dataclass(frozen=True)
class Reproduction(Output):
    """Where an experiment computes, and where its result goes.

    Attributes:
        out: folder for results.json, tables.md, plots, pictures and run.json.
        cache: folder that keeps what was computed, so that an experiment that was stopped goes on where it was; what
            other arguments, data or code made is never taken.
    """

    cache: Path = Path("out/cache/experiments")


def command(name: str, experiment: Callable[..., Outcome]) -> Callable[..., int]:
    """The command for an experiment: its own options, and those that every experiment has.

    Numbers are at least 1, but for those in `FROM_ZERO`.
    """

    def reproduce(output: Reproduction, **options: Any) -> int:
        for option, value in options.items():
            least, kind = (0, "a whole number from 0") if option in FROM_ZERO else (1, "at least 1")
            if isinstance(value, int) and value < least:
                raise RequestError(f"`{option}`: expected {kind}, got {value}")
        with output.run() as run:
            try:
                with run.times.measure("experiment"):
                    outcome = experiment(Store(output.cache), **options)
            except KeyboardInterrupt as error:
                kept = f"what was computed is kept in {output.cache}: run the same command again to go on"
                raise Interrupted(signal_of(error), kept) from error
            for file, write in outcome.parts():
                run.write(file, write)
            tables = [table.text() for table in outcome.tables if table.rows]
            run.done("\n".join([*tables, *outcome.notes, f"results: {output.out}"]))
        return run.status

    store, *own = inspect.signature(experiment, eval_str=True).parameters.values()
    output = store.replace(name="output", annotation=Reproduction, default=Reproduction(Path("out") / name))
    every = [p.replace(kind=p.KEYWORD_ONLY) for p in (*own, output)]
    reproduce.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    reproduce.__doc__ = inspect.getdoc(experiment)
    return reproduce
