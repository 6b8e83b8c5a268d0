"""Arguments by their types: `typed` makes a value of a word or YAML, `check_sensible` refuses what is out of hand."""

from __future__ import annotations

import difflib
import inspect
import re
import stat
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from numbers import Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import yaml
from pydantic import ValidationError

from tsuiseki.tracking.bounds import refusal
from tsuiseki.tracking.errors import RequestError

# What a value of a type is called, and several.
KINDS = {int: "a whole number", float: "a number", bool: "True or False", str: "a text", Path: "a path"}
LISTS = {int: "whole numbers", float: "numbers"}
NAMES = {"NoneType": "None", "ndarray": "array", "Callable": "a function"}
SEVERAL = (tuple, list, Sequence, Collection, Iterable)
TIMES, LARGEST, SMALLEST = 1000, 1e6, 1e-9


def kinds_of(kind: Any) -> tuple[Any, ...]:
    """The types of a union without None, or ``kind`` alone."""
    several = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    return tuple(one for one in several if one is not NoneType)


def is_several(kind: Any, lists: bool = False) -> bool:
    """Whether ``kind`` is a list or tuple, of ``lists`` where that is asked, maybe an optional one."""
    first = kinds_of(kind)[0]
    return get_origin(first) in (tuple, list) and (not lists or is_several(get_args(first)[0]))


def shown(kind: Any) -> str:
    """A type in words.

    >>> shown(float | None), shown(Literal["auto", "cpu"]), shown(Path | str), shown(tuple[float, float])
    ('a number or None', "one of 'auto', 'cpu'", 'a path', '2 numbers')
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        words = [shown(each) for each in inner]
        if Path in inner:
            words = [word for word in words if word != KINDS[str]]
        return " or ".join(word for word in dict.fromkeys(words) if not word.startswith("_"))
    if origin is Literal:
        return f"one of {', '.join(map(repr, inner))}"
    if origin in SEVERAL:
        several = LISTS.get(inner[0])
        if origin is tuple and inner[-1] is not ...:
            return f"{len(inner)} {(len(set(inner)) == 1 and several) or 'values'}"
        return several or f"a list of {shown(inner[0])}"
    name = str(getattr(kind, "__name__", kind))
    return KINDS.get(kind) or NAMES.get(name, name)


def option_shown(name: str) -> str:
    """An option as it is typed."""
    return "--" + name.replace("_", "-")


def unknown(name: str, options: Iterable[str]) -> RequestError:
    """The error of an option that is not among ``options``."""
    typed_as = option_shown(name.lstrip("-"))
    close = difflib.get_close_matches(typed_as, [option_shown(one) for one in options], n=1, cutoff=0.6)
    return RequestError(f"unknown option {typed_as}; {f'did you mean {close[0]}?' if close else '--help lists them'}")


def usual_of(one: Field[Any]) -> Any:
    """The default of a field."""
    return one.default if one.default_factory is MISSING else one.default_factory()


def typed(kind: Any, value: Any, name: str, default: Any = MISSING) -> Any:
    """``value`` as one of type ``kind``.

    Args:
        kind: a plain type, a literal, a list or tuple, a dataclass, or a union.
        value: a word, or what YAML holds.
        name: of the option, with underscores, for errors.
        default: a dataclass, of which fields are taken that ``value`` lacks.

    Raises:
        RequestError: it cannot be one.
    """
    several = kinds_of(kind)
    optional, words = several != (kind,), value
    if optional and value in (None, "null"):
        return None
    if is_dataclass(several[0]):
        return _settings(several[0], value, name, default, optional)
    try:
        if is_several(kind) and isinstance(value, str):
            commas = value.removesuffix(",").split(",") if value else []
            words = yaml.safe_load(value) if value.startswith("[") else [part.strip() for part in commas]
        for one in several:
            try:
                return _plain_value(one, words)
            except (ValueError, TypeError):
                continue
    except yaml.YAMLError:
        pass
    named = [get_args(several[0])[0]] if is_several(kind, lists=True) else several
    wanted = " or ".join(map(shown, named)) + " separated by commas" * is_several(several[0])
    got = ",".join(map(str, words)) if isinstance(words, list) else words
    raise RequestError(f"{option_shown(name)}: expected {wanted}, got '{got}'")


def _plain_value(kind: Any, value: Any) -> Any:
    """``value`` as one of a type that is no union and no dataclass; raises ValueError or TypeError."""
    parts, origin, text = get_args(kind), get_origin(kind), str(value)
    if origin is Literal:
        return parts[[str(part) for part in parts].index(text)]
    if origin in (list, tuple):
        if not isinstance(value, list | tuple):
            raise TypeError
        inner = parts[:1] * len(value) if origin is list or Ellipsis in parts else parts
        return origin(typed(one, each, "") for one, each in zip(inner, value, strict=True))
    if kind is bool:
        return bool(("false", "true").index(text.lower()))
    if isinstance(value, bool | Mapping | list | None) or (isinstance(value, float) and kind is int):
        raise TypeError
    return kind(text)


def _settings(kind: Any, value: Any, name: str, default: Any, optional: bool) -> Any:
    """A dataclass from a mapping of some of its fields."""
    if not isinstance(value, Mapping):
        option, null = (option_shown(name), "null or ") if optional else (name, "")
        raise RequestError(f"{option}: expected {null}options of its own below it, got {value!r}")
    hints = get_type_hints(kind)
    made = {
        one.name: usual_of(one) if default in (MISSING, None) else getattr(default, one.name) for one in fields(kind)
    }
    for field, given in value.items():
        if field not in made:
            raise unknown(f"{name}.{field}", [f"{name}.{one}" for one in made])
        made[field] = typed(hints[field], given, f"{name}.{field}", made[field])
    if missing := [field for field in made if made[field] is MISSING]:
        raise RequestError(f"missing: {option_shown(f'{name}.{missing[0]}')}")
    try:
        return kind(**made)
    except ValidationError as error:
        raise RequestError(refusal(error, name)) from error
    except ValueError as error:
        # It speaks of the field: of `min_time` for --flow.min-time.
        meant = [field for field in value if re.search(rf"\b{re.escape(field)}\b", str(error))]
        named = len(meant) != 1 or str(error).startswith("`")
        option = "" if named else f"{option_shown(f'{name}.{meant[0]}')}: "
        raise RequestError(f"{option}{error}") from error


def check_sensible(name: str, value: Any, default: Any) -> None:
    """Refuse what would run without end or fill the memory.

    A number is to be below `TIMES` times its default; where that is 0, none or no number, at most `LARGEST`. It is 0 or
    from `SMALLEST` on. Seeds and times of day may be any. What names something in the file system is to name a file or
    a folder.

    Args:
        name: of the argument, with those above it before dots; empty where it is given by place.
        value: a number or a text; settings and lists are checked inside.
        default: of the argument, of the same kind.

    Raises:
        RequestError: it is of no use.
    """
    if is_dataclass(value) and not isinstance(value, type):
        usual = default if type(default) is type(value) else type(value)() if is_settings(value) else None
        for one in fields(value):
            check_sensible(f"{name}.{one.name}", getattr(value, one.name), getattr(usual, one.name, None))
    elif isinstance(value, list | tuple):
        for each in value:
            check_sensible(name, each, default)
    elif isinstance(value, str | Path):
        check_regular(name, Path(value))
    elif isinstance(value, Real) and not isinstance(value, bool) and "seed" not in name and name != "time":
        defaults = default if isinstance(default, list | tuple) else [default]
        largest = max((abs(each) for each in defaults if isinstance(each, int | float)), default=0)
        limit, why = (TIMES * largest, f", {TIMES} times the default") if largest else (LARGEST, "")
        number = value if isinstance(value, int | float) else float(value)
        if 0 < abs(number) < SMALLEST:
            raise RequestError(f"`{name}`: expected 0 or a number from {SMALLEST:g}, got {number:g}")
        if number != default and not abs(number) < limit:
            raise RequestError(f"`{name}`: expected a number below {limit:g}{why}, got {number:g}")


def check_regular(name: str, path: Path) -> None:
    """Refuse a device or a pipe, which may never end; raises RequestError."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # no such thing: whoever needs it says so
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        option = f"`{name}`: " if name else ""
        raise RequestError(f"{option}expected a file or a folder, but {path} is a device or a pipe; copy it to a file")


def is_settings(value: Any) -> bool:
    """Whether this is a dataclass that can be made without any argument."""
    if not is_dataclass(value) or isinstance(value, type):
        return False
    return all(p.default is not p.empty for p in inspect.signature(type(value)).parameters.values())
