"""What was computed is kept: a value is taken from disk where the same function was given the same arguments before.

An entry's name is a digest of the function, its arguments, the data they name and the version of the code: all of our
sources, and the versions of the packages that results depend on. So an experiment that was stopped goes on where it
was, and nothing stale is ever taken. What other code made of the same arguments is removed when it is computed anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import pickle
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.output import output_folder, versions

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
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return type(value), tuple(getattr(value, field.name) for field in dataclasses.fields(value))
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
