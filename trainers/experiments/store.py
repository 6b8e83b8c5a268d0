"""What was computed is kept: a value is taken from disk where the same function was given the same arguments before.

An entry's name is a digest of the function, its arguments, the data they name and the version of the code: the sources
of the function's module and of all that it imports of ours, and the versions of the packages that results depend on.
So an experiment that was stopped goes on where it was, and nothing stale is ever taken. What other code made of the
same arguments is removed when it is computed anew.
"""

from __future__ import annotations

import ast
import dataclasses
import hashlib
import importlib.util
import io
import pickle
import shutil
import types
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

from tsuiseki.tracking.output import output_file, output_folder, versions

P = ParamSpec("P")
T = TypeVar("T")
OURS = "tsuiseki."


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
            compute: a function of a module. All that it depends on is an argument or imported; its value is pickled.
            args: what pickle takes; paths stand for what is in them, and an object with a ``fingerprint`` for that.
            kwargs: likewise.

        Raises:
            PicklingError, AttributeError: ``compute`` or an argument has no lasting name, such as a lambda.
        """
        path = self._entry(compute, args, kwargs).with_suffix(".pickle")
        if path.is_file():
            return pickle.loads(path.read_bytes())  # type: ignore[no-any-return]
        value = compute(*args, **kwargs)
        path.parent.mkdir(parents=True, exist_ok=True)
        with output_file(path, overwrite=True) as work:
            work.write_bytes(pickle.dumps(value))
        _clear_older(path)
        return value

    def made(self, name: str, write: Callable[Concatenate[Path, P], Any], *args: P.args, **kwargs: P.kwargs) -> Path:
        """The folder ``name`` that ``write(folder, *args, **kwargs)`` fills, from an earlier run where it is there.

        Raises:
            PicklingError, AttributeError: as `recall`.
        """
        home = self._entry(write, (name, *args), kwargs)
        # A run that was killed leaves its folder behind, without what it was to hold.
        if not (home / name).is_dir():
            with output_folder(home, overwrite=True) as work:
                write(work / name, *args, **kwargs)
            _clear_older(home)
        return home / name

    def _entry(self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Path:
        """The path of an entry, without suffix: its name tells what was asked, and what answered."""
        asked = io.BytesIO()
        call = _CallPickler(asked)
        call.dump((function, args, sorted(kwargs.items())))
        answered = f"{code_version(call.modules)} {sorted(versions().items())}"
        return self.folder / function.__name__ / f"{_digest(asked.getvalue())}-{_digest(answered.encode())}"


class _CallPickler(pickle.Pickler):
    """Bytes that are the same for the same call: no memory of objects, files by their content."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, protocol=5)
        self.fast = True
        self.modules: set[str] = set()
        """Of the functions and classes in the call."""

    def persistent_id(self, value: Any) -> Any:
        """What stands for a value; None for itself."""
        if isinstance(value, type | types.FunctionType):
            self.modules.add(value.__module__)
        elif isinstance(value, Path):
            return _content(value)
        elif isinstance(fingerprint := getattr(value, "fingerprint", None), str):
            return fingerprint
        return None

    def reducer_override(self, value: Any) -> Any:
        """Of a dataclass its fields alone, whatever else was computed on it since."""
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return type(value), tuple(getattr(value, field.name) for field in dataclasses.fields(value))
        return NotImplemented


def _digest(value: bytes) -> str:
    return hashlib.sha256(value).hexdigest()[:32]


def _clear_older(entry: Path) -> None:
    """Remove what other code made of the same arguments as ``entry``."""
    asked = entry.name.partition("-")[0]
    for path in entry.parent.glob(f"{asked}-*"):
        if path == entry:
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def code_version(modules: Iterable[str]) -> str:
    """A digest of the sources of some modules and of all that they import of ours, at any depth.

    Small tables that ship beside the models count as source; models are data, and arguments name them.
    """
    waiting, sources = [name for name in modules if name.startswith(OURS)], dict[str, str]()
    while waiting:
        name = waiting.pop()
        if name not in sources:
            sources[name], imported = _source(name)
            waiting += imported
    lines = [f"{name} {digest}" for name, digest in sorted(sources.items())]
    return hashlib.sha256("\n".join([*lines, _shipped_tables()]).encode()).hexdigest()[:32]


@cache
def _source(name: str) -> tuple[str, tuple[str, ...]]:
    """A digest of a module's source, and our modules that it imports, inside functions too."""
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        return "", ()
    text = Path(spec.origin).read_bytes()
    imported = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(OURS):
            imported |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
        elif isinstance(node, ast.Import):
            imported |= {one.name for one in node.names if one.name.startswith(OURS)}
    return hashlib.sha256(text).hexdigest(), tuple(sorted(one for one in imported if _is_module(one)))


@cache
def _is_module(name: str) -> bool:
    """Whether ``name`` is a module and not something in one."""
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


@lru_cache(maxsize=1)
def _shipped_tables() -> str:
    folder = Path(str(resources.files("tsuiseki.tracking") / "weights"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(folder.glob("*.json")))).hexdigest()


def _content(path: Path) -> Any:
    """A digest of a file, or of the files in a folder by name."""
    if path.is_dir():
        return {p.relative_to(path).as_posix(): _content(p) for p in sorted(path.rglob("*")) if p.is_file()}
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
