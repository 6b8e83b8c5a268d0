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
import json
import shutil
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Concatenate, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from tsuiseki.tracking.output import output_file, output_folder, versions

P = ParamSpec("P")
T = TypeVar("T")
OURS = "tsuiseki"
PLAIN = (str, int, float, bool, type(None))


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


def described(value: Any) -> Any:
    """JSON that is the same for the same value and differs for every other; files and arrays by their content.

    Raises:
        TypeError: the value has no lasting name, such as a lambda or an object without ``fingerprint``.
    """
    if isinstance(value, PLAIN):
        return value
    if isinstance(fingerprint := getattr(value, "fingerprint", None), str):
        return {"fingerprint": fingerprint}
    if isinstance(value, Path):
        return {"content": _content(value)}
    if isinstance(value, np.ndarray | np.generic):
        array = np.ascontiguousarray(value)
        return {"array": [str(array.dtype), list(array.shape), hashlib.sha256(array.tobytes()).hexdigest()]}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: described(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {"type": _name(type(value)), "fields": fields}
    if isinstance(value, Mapping):
        return {"mapping": sorted(([described(k), described(v)] for k, v in value.items()), key=repr)}
    if isinstance(value, set | frozenset):
        return {"set": sorted(map(described, value), key=repr)}
    if isinstance(value, Sequence):
        return [described(one) for one in value]
    if isinstance(value, type | types.FunctionType):
        return {"name": _name(value)}
    raise TypeError(f"expected an argument that a digest can name, got {type(value).__qualname__}")


def modules_of(value: Any) -> set[str]:
    """Modules that define the dataclasses and functions in ``value``."""
    if isinstance(value, type | types.FunctionType):
        return {value.__module__}
    if isinstance(value, Mapping):
        return set().union(*map(modules_of, [*value, *value.values()]))
    if isinstance(value, Sequence | set | frozenset) and not isinstance(value, str | bytes):
        return set().union(*map(modules_of, value))
    if dataclasses.is_dataclass(value):
        inside = (getattr(value, field.name) for field in dataclasses.fields(value))
        return {type(value).__module__}.union(*map(modules_of, inside))
    return set()


def plain(value: Any) -> Any:
    """``value`` in JSON's terms: dataclasses as objects, tuples and arrays as lists.

    >>> plain({"a": (1, np.float64(0.5))})
    {'a': [1, 0.5]}
    """
    if isinstance(value, PLAIN) and not isinstance(value, np.generic):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(name): plain(one) for name, one in value.items()}
    if isinstance(value, Sequence | set | frozenset):
        return [plain(one) for one in value]
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"expected a value that JSON can hold, got {type(value).__qualname__}")


def restored(kind: Any, value: Any) -> Any:
    """What `plain` was given, by its type.

    >>> restored(tuple[float, ...], [1.0, 2.0])
    (1.0, 2.0)
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is Any or kind in PLAIN or origin is Literal:
        return value
    if origin in (Union, types.UnionType):
        return None if value is None else restored(next(a for a in arguments if a is not type(None)), value)
    if kind is np.ndarray or origin is np.ndarray:
        return np.array(value, dtype=get_args(arguments[1])[0] if arguments else None)
    if dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: restored(hints[name], one) for name, one in value.items()})  # type: ignore[operator]
    if origin is tuple:
        each = [arguments[0]] * len(value) if arguments[1:] == (Ellipsis,) else arguments
        return tuple(restored(one, part) for one, part in zip(each, value, strict=True))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {arguments[0](name): restored(arguments[1], one) for name, one in value.items()}
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return [restored(arguments[0], one) for one in value]
    raise TypeError(f"expected a type that can be read back, got {kind}")


def _content(path: Path) -> Any:
    """A digest of a file, or of the files in a folder by name."""
    if path.is_dir():
        return {p.relative_to(path).as_posix(): _content(p) for p in sorted(path.rglob("*")) if p.is_file()}
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _name(value: Any) -> str:
    if "<" in value.__qualname__:
        raise TypeError(f"expected a function of a module, got {value.__qualname__}")
    return f"{value.__module__}.{value.__qualname__}"
