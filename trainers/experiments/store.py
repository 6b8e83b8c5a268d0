"""What was computed is kept: a value is taken from disk where the same function was given the same arguments before.

An entry's name is a digest of the function, its arguments, the data they name and the version of the code: the sources
of the function's module and of all that it imports of ours, and the versions of the packages that results depend on.
So an experiment that was stopped goes on where it was, and nothing stale is ever taken. What other code made of the
same arguments is removed when it is computed anew.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar, get_type_hints

from tsuiseki.tracking.output import output_file, output_folder, versions
from tsuiseki.trainers.experiments.values import described, modules_of, plain, restored

P = ParamSpec("P")
T = TypeVar("T")
OURS = "tsuiseki"


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
            compute: a function of a module, annotated with what it returns: plain values, arrays, dataclasses, and
                lists, tuples and dictionaries of them. All that it depends on is an argument or imported.
            args: plain values, arrays, dataclasses, functions of a module; paths stand for what is in them. An object
                with a ``fingerprint`` stands for that.
            kwargs: likewise.

        Raises:
            TypeError: ``compute`` or an argument has no lasting name, such as a lambda.
        """
        path = self._entry(compute, args, kwargs).with_suffix(".json")
        kind = get_type_hints(compute)["return"]
        if path.is_file():
            return restored(kind, json.loads(path.read_text(encoding="utf-8"))["value"])  # type: ignore[no-any-return]
        value = plain(compute(*args, **kwargs))
        path.parent.mkdir(parents=True, exist_ok=True)
        entry = {**_key(compute, args, kwargs), "value": value}
        with output_file(path, overwrite=True) as work:
            work.write_text(json.dumps(entry) + "\n", encoding="utf-8")
        _clear_older(path)
        return restored(kind, value)  # type: ignore[no-any-return]

    def has(self, compute: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> bool:
        """Whether `recall` would find the value on disk."""
        return self._entry(compute, args, kwargs).with_suffix(".json").is_file()

    def made(self, name: str, write: Callable[Concatenate[Path, P], Any], *args: P.args, **kwargs: P.kwargs) -> Path:
        """The folder ``name`` that ``write(folder, *args, **kwargs)`` fills, from an earlier run where it is there.

        Raises:
            TypeError: as `recall`.
        """
        home = self._entry(write, (name, *args), kwargs)
        # A run that was killed leaves its folder behind, without what it was to hold.
        if not (home / name).is_dir():
            with output_folder(home, overwrite=True) as work:
                write(work / name, *args, **kwargs)
            _clear_older(home)
        return home / name

    def has_made(
        self, name: str, write: Callable[Concatenate[Path, P], Any], *args: P.args, **kwargs: P.kwargs
    ) -> bool:
        """Whether `made` would find the folder on disk."""
        return (self._entry(write, (name, *args), kwargs) / name).is_dir()

    def _entry(self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Path:
        """The path of an entry, without suffix: its name tells what was asked, and what answered."""
        key = _key(function, args, kwargs)
        answered = {name: key.pop(name) for name in ("code", "versions")}
        return self.folder / function.__name__ / f"{_digest(key)}-{_digest(answered)}"


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:32]


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


def _key(function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> dict[str, Any]:
    return {
        "function": described(function),
        "arguments": [described(value) for value in args],
        "named": {name: described(value) for name, value in sorted(kwargs.items())},
        "code": code_version({function.__module__, *modules_of((args, kwargs))}),
        "versions": versions(),
    }


def code_version(modules: Iterable[str]) -> str:
    """A digest of the sources of some modules and of all that they import of ours, at any depth.

    Small tables that ship beside the models count as source; models are data, and arguments name them.
    """
    waiting, sources = [name for name in modules if _is_ours(name)], dict[str, str]()
    while waiting:
        name = waiting.pop()
        if name not in sources:
            sources[name], imported = _source(name)
            waiting += imported
    lines = [f"{name} {digest}" for name, digest in sorted(sources.items())]
    return hashlib.sha256("\n".join([*lines, _shipped_tables()]).encode()).hexdigest()[:32]


def _is_ours(name: str) -> bool:
    return name.startswith(f"{OURS}.")


@cache
def _source(name: str) -> tuple[str, tuple[str, ...]]:
    """A digest of a module's source, and our modules that it imports, inside functions too."""
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        return "", ()
    text = Path(spec.origin).read_bytes()
    imported = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module and _is_ours(node.module):
            imported |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
        elif isinstance(node, ast.Import):
            imported |= {one.name for one in node.names if _is_ours(one.name)}
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
