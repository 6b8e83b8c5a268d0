"""Arguments and results of experiments as JSON: to name them by a digest, to write them, and to read them back."""

from __future__ import annotations

import dataclasses
import hashlib
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

PLAIN = (str, int, float, bool, type(None))


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
