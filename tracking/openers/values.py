"""Dataclasses, named tuples and plain values in one file: arrays as NumPy's, and how they belong together as JSON.

What is read is put together from fields alone: no constructor runs, and nothing is imported or unpickled. A class is
looked up by its name among the modules that are loaded.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.openers.json_files import json_of
from tsuiseki.tracking.openers.text import LARGEST_WHOLE, refusing

# Of the array that holds the JSON; the others are called by their type.
_STRUCTURE = "structure"
# Types of arrays: booleans, numbers and words.
_KINDS = "?biufcUS"
_CONTAINERS: Mapping[str, type[Any]] = {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}


def write_values(file: BinaryIO, value: Any) -> None:
    """Write dataclasses, containers, arrays, numbers, words and paths, for `read_values`.

    Raises:
        TypeError: there is something else among them.
    """
    arrays = list[NDArray[Any]]()
    structure = json.dumps(_described(value, arrays)).encode()
    kinds = {array.dtype.str for array in arrays}
    # Thousands of small members would take longer than what is in them.
    columns: dict[str, Any] = {
        kind: np.concatenate([a.ravel() for a in arrays if a.dtype.str == kind]) for kind in kinds
    }
    np.savez_compressed(file, **columns | {_STRUCTURE: np.frombuffer(structure, np.uint8)})


def read_values(path: Path, what: str) -> Any:
    """What `write_values` wrote.

    Raises:
        RequestError: there is no such file of ``what``, it is something else, or a class in it is not loaded.
    """
    columns = read_arrays(path, what)
    with refusing(f"{path}: expected {what}, got something else: ", repr):
        return _made(json_of(columns.pop(_STRUCTURE).tobytes(), str(path), what), columns, dict.fromkeys(columns, 0))


def _described(value: Any, arrays: list[NDArray[Any]]) -> Any:
    """``value`` as JSON; its arrays go to ``arrays``, in order."""
    kind, name = type(value), type(value).__name__
    if kind in (bool, str, float, type(None)) or (kind is int and abs(value) <= LARGEST_WHOLE):
        return value
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in _KINDS:
        arrays.append(np.asarray(value))
        return {"array": [value.dtype.str, *value.shape], "alone": isinstance(value, np.generic)}
    if _CONTAINERS.get(name) is kind:
        return {name: [_described(entry, arrays) for entry in value]}
    if kind is dict:
        return {"dict": [[_described(key, arrays), _described(entry, arrays)] for key, entry in value.items()]}
    if isinstance(value, Path):
        return {"path": str(value)}
    if (names := _fields(kind)) is not None:
        fields = {name: _described(getattr(value, name), arrays) for name in names}
        return {"module": kind.__module__, "class": kind.__qualname__, "fields": fields}
    raise TypeError(f"expected plain values, arrays and dataclasses, got {value!r:.80} of {kind.__module__}.{name}")


def _made(form: Any, columns: Mapping[str, NDArray[Any]], place: dict[str, int]) -> Any:
    """The value that `_described` gave as ``form``; arrays lie in the columns, next at ``place``."""
    if isinstance(form, list):
        raise ValueError("a list of no kind")
    if not isinstance(form, dict):
        return form
    if "array" in form:
        kind, *shape = form["array"]
        start, place[kind] = place[kind], place[kind] + int(np.prod(shape, dtype=np.int64))
        array = columns[kind][start : place[kind]].reshape(shape)
        return array[()] if form["alone"] else array
    if "class" in form:
        return _instance(form, {name: _made(entry, columns, place) for name, entry in form["fields"].items()})
    if "path" in form:
        return Path(form["path"])
    ((name, entries),) = form.items()
    if name == "dict":
        return {_made(key, columns, place): _made(entry, columns, place) for key, entry in entries}
    return _CONTAINERS[name](_made(entry, columns, place) for entry in entries)


def _fields(kind: type[Any]) -> tuple[str, ...] | None:
    """Names of the fields of a dataclass or a named tuple; None of another class."""
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind))
    return getattr(kind, "_fields", None) if issubclass(kind, tuple) else None


def _instance(form: Mapping[str, Any], fields: Mapping[str, Any]) -> Any:
    kind: Any = sys.modules.get(form["module"])
    for name in form["class"].split("."):
        kind = vars(kind)[name]
    if not isinstance(kind, type) or _fields(kind) != tuple(fields):
        raise ValueError(f"{form['module']}.{form['class']} has other fields")
    if issubclass(kind, tuple):
        return tuple.__new__(kind, fields.values())
    value = object.__new__(kind)
    for name, entry in fields.items():
        object.__setattr__(value, name, entry)
    return value
