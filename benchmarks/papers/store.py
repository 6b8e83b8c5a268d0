"""What an experiment has computed: kept on disk, so that one that was stopped goes on where it was.

A value is taken from disk where the same function was given the same arguments before, by the same code: all of our
sources, and the versions of the packages that results depend on. Data are known by the names of their files alone:
remove the folder of the store where a file has changed.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Concatenate, ParamSpec, TypeAlias, TypeVar

from cyclopts import Parameter

from tsuiseki.datamodules.scenes.clip import Clip, write_clip
from tsuiseki.tracking.openers.values import read_values, write_values
from tsuiseki.tracking.output import output_folder, versions, whole_file
from tsuiseki.tracking.runs.progress import progress

P = ParamSpec("P")
T = TypeVar("T")
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
                its value is written by `write_values`.
            args: what pickle takes, of which a digest alone is kept.
            kwargs: likewise.

        Raises:
            PicklingError, AttributeError: ``compute`` or an argument has no lasting name, such as a lambda.
            TypeError: its value is more than dataclasses, containers, arrays and plain values.
            RequestError: the entry was damaged since.
        """
        path = self.folder / code_version() / f"{_named(compute, args, kwargs)}.npz"
        if not path.exists():
            value = compute(*args, **kwargs)
            with whole_file(path) as file:
                write_values(file, value)
        return read_values(path, "a value of an experiment")  # type: ignore[no-any-return]

    def each(self, compute: Callable[..., T], jobs: Sequence[Iterable[Any]], what: str) -> list[T]:
        """``compute(*job)`` of the jobs in their order, as `recall`; ``what`` names them in the line of progress."""
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
        home = self.folder / code_version() / _named(write, (name, *args), kwargs)
        # A run that was killed leaves its folder behind, without what it was to hold.
        if not (home / name).exists():
            with output_folder(home, overwrite=True) as work:
                write(work / name, *args, **kwargs)
        return home / name


Cached: TypeAlias = Annotated[Store, Parameter(parse=False)]
"""The store of an experiment, no option of its command."""


def _named(function: Callable[..., Any], args: Sequence[Any], kwargs: Mapping[str, Any]) -> str:
    """The name of an entry: a digest of what is called."""
    call = io.BytesIO()
    pickler = _CallPickler(call, protocol=5)
    pickler.fast = True
    pickler.dump((function, args, sorted(kwargs.items())))
    return f"{getattr(function, 'func', function).__name__}-{hashlib.sha256(call.getbuffer()).hexdigest()[:32]}"


class _CallPickler(pickle.Pickler):
    """Bytes that are the same for the same call, if ``fast``: without references to what was pickled before."""

    def reducer_override(self, value: Any) -> Any:
        """Of a dataclass its fields alone, whatever else was computed on it since."""
        if is_dataclass(value) and not isinstance(value, type):
            return type(value), tuple(getattr(value, field.name) for field in fields(value))
        return NotImplemented


@cache
def code_version() -> str:
    """A digest of our sources, of the small tables that ship beside the models, and of the versions of packages."""
    packages = [Path(str(resources.files(f"tsuiseki.{name}"))) for name in PACKAGES]
    folders = [*packages, Path(__file__).parent]
    files = [*(path for folder in folders for path in folder.rglob("*.py")), *packages[0].glob("weights/*.json")]
    sources = b"".join(str(path.name).encode() + path.read_bytes() for path in sorted(files))
    return hashlib.sha256(sources + str(sorted(versions().items())).encode()).hexdigest()[:16]


def write_planned(folder: Path, plan: Callable[..., Clip[Any]], *args: Any) -> None:
    """Draw the clip that ``plan(*args)`` plans; for `Store.made`."""
    write_clip(folder, plan(*args))
