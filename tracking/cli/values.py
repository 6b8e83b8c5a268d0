"""Values of options: from words or YAML to the type of an option, and those that no option can sensibly have."""

from __future__ import annotations

import difflib
import json
import re
import stat
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from importlib import resources
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import yaml

from tsuiseki.tracking.errors import RequestError

# What a value of a type is called, alone and in a list; and what stands for it in the help.
KINDS = {int: "a whole number", float: "a number", bool: "true or false", str: "text", Path: "a file"}
LISTS = {int: "whole numbers", float: "numbers"}
METAVARS = {int: "N", float: "X", str: "TEXT", Path: "FILE"}
MOST_BYTES = 1_000_000
TIMES, LARGEST, SMALLEST = 1000, 1e6, 1e-9


def kinds_of(kind: Any) -> tuple[Any, ...]:
    """The types of a union without None, or ``kind`` alone."""
    several = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    return tuple(one for one in several if one is not NoneType)


def is_several(kind: Any, lists: bool = False) -> bool:
    """Whether ``kind`` is a list or tuple, of ``lists`` where that is asked, maybe an optional one."""
    first = kinds_of(kind)[0]
    return get_origin(first) in (tuple, list) and (not lists or is_several(get_args(first)[0]))


def _choices(kind: Any) -> list[Any]:
    return [value for one in kinds_of(kind) if get_origin(one) is Literal for value in get_args(one)]


def metavar(kind: Any, name: str = "", text: str = "") -> str:
    """What to show for the value of the option ``name`` of type ``kind``, which the help describes by ``text``.

    >>> metavar(float | None)
    'X'
    """
    first, parts = kinds_of(kind)[0], [metavar(part) for part in get_args(kinds_of(kind)[0]) if part is not Ellipsis]
    if named := _choices(kind):
        return "{" + ",".join(map(str, named)) + "}"
    if is_several(first):
        return ",".join(parts if len(parts) > 1 else [*parts, "…"])
    shown = "{true,false,null}" if first is bool else METAVARS.get(first, "VALUE")
    if shown == "FILE" and text.startswith("folder"):
        return "DIR"
    return "FIRST-LAST" if (name, shown) == ("frames", "TEXT") else shown


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
    optional = several != (kind,)
    if optional and value in (None, "null"):
        return None
    if is_dataclass(several[0]):
        return _settings(several[0], value, name, default, optional)
    if is_several(kind) and isinstance(value, str):
        try:
            commas = value.removesuffix(",").split(",") if value else []
            value = yaml.safe_load(value) if value.startswith("[") else [part.strip() for part in commas]
        except yaml.YAMLError:
            raise _wrong(kind, value, name) from None
    for one in several:
        try:
            return _plain_value(one, value)
        except (ValueError, TypeError):
            continue
    raise _wrong(kind, value, name)


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


def _wrong(kind: Any, value: Any, name: str) -> RequestError:
    first = kinds_of(kind)[0]
    parts = [part for part in get_args(first) if part is not Ellipsis]
    shown = ",".join(map(str, value)) if isinstance(value, list) else value
    if named := _choices(kind):
        expected = f"one of {', '.join(map(repr, named))}"
    elif is_several(first):
        inner = get_args(parts[0])[0] if is_several(parts[0]) else parts[0]
        expected = f"{len(parts)} values" if len(parts) > 1 else f"{LISTS.get(inner, 'values')}"
        expected += " separated by commas"
    else:
        expected = " or ".join(KINDS[one] for one in kinds_of(kind))
    return RequestError(f"{option_shown(name)}: expected {expected}, got '{shown}'")


def _settings(kind: Any, value: Any, name: str, default: Any, optional: bool) -> Any:
    """A dataclass from a mapping of some of its fields."""
    if not isinstance(value, Mapping):
        shown, null = (option_shown(name), "null or ") if optional else (name, "")
        raise RequestError(f"{shown}: expected {null}options of its own below it, got {value!r}")
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
    except ValueError as error:
        # It speaks of the field: of `min_time` for --flow.min-time.
        meant = [field for field in value if re.search(rf"\b{re.escape(field)}\b", str(error))]
        shown = f"{option_shown(f'{name}.{meant[0]}')}: " if len(meant) == 1 else ""
        raise RequestError(f"{shown}{error}") from error


def usual_of(one: Field[Any]) -> Any:
    """The default of a field."""
    return one.default if one.default_factory is MISSING else one.default_factory()


def option_shown(name: str) -> str:
    """An option as it is typed."""
    return "--" + name.replace("_", "-")


def unknown(name: str, options: Iterable[str]) -> RequestError:
    """The error of an option that is not among ``options``."""
    shown = option_shown(name.lstrip("-"))
    close = difflib.get_close_matches(shown, [option_shown(one) for one in options], n=1, cutoff=0.6)
    return RequestError(f"unknown option {shown}" + (f"; did you mean {close[0]}?" if close else "; --help lists them"))


def named_config(path: str | Path) -> Path:
    """A file of options as it is given; a bare word names one that ships, such as ``detector_mot``.

    Raises:
        RequestError: none of that name ships.
    """
    path = Path(path)
    if path.suffix or len(path.parts) != 1 or path.exists():
        return path
    shipped = Path(str(resources.files("tsuiseki.configs")))
    if (file := shipped / f"{path}.yaml").is_file():
        return file
    names = ", ".join(sorted(one.stem for one in shipped.glob("*.yaml")))
    raise RequestError(f"`config`: expected a YAML file or one of {names}; got {path}")


def read_config(path: Path, command: Sequence[str]) -> dict[str, Any]:
    """The options in a file: YAML, what ``--print-config`` prints, or the ``run.json`` of an earlier run.

    Args:
        path: of the file.
        command: the program's words; a ``run.json`` must be of the same command.

    Raises:
        RequestError: there is no such file, it is no YAML of options, or the record of another command.
    """
    path = named_config(path)
    check_regular("config", path)
    wrong = f"`config`: expected YAML of options, name: value, in {path}, got"
    try:
        if path.stat().st_size > MOST_BYTES:
            raise RequestError(f"{wrong} a file of {path.stat().st_size} bytes")
        text = path.read_text(encoding="utf-8-sig")
        # Nested aliases stand for billions of values in a few lines.
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
            raise RequestError(f"{wrong} aliases; write their values out")
        found = yaml.safe_load(text)
    except OSError as error:
        raise RequestError(f"`config`: cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RequestError(f"{wrong} something binary") from error
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise RequestError(f"{wrong} something that cannot be read{where}") from error
    if not isinstance(found, dict | None):
        raise RequestError(f"{wrong} no such lines")
    if found is None or not found.keys() >= {"command", "settings", "versions"}:
        return found or {}
    if list(found["command"]) != list(command):
        wanted, got = " ".join(command), " ".join(found["command"])
        raise RequestError(f"`config`: expected the record of `{wanted}` in {path}, got one of `{got}`")
    # That the run replaced an earlier result is not taken over.
    return {name: value for name, value in found["settings"].items() if name != "overwrite"}


def plain(value: Any) -> Any:
    """As ``run.json`` has it: dataclasses as mappings, paths as text."""

    def simple(part: Any) -> Any:
        return {one.name: getattr(part, one.name) for one in fields(part)} if is_dataclass(part) else str(part)

    return json.loads(json.dumps(value, default=simple))


def check_sensible(name: str, value: Any, default: Any) -> None:
    """Refuse what would run without end or fill the memory.

    A number is to be below `TIMES` times its default; where that is 0, none or no number, at most `LARGEST`. It is 0 or
    from `SMALLEST` on. Seeds may be any. What names something in the file system is to name a file or a folder.

    Args:
        name: of the option, with those above it before dots; empty where it is given by place.
        value: a number or a text; of a group of options a mapping, of a list a sequence.
        default: likewise.

    Raises:
        RequestError: it is of no use.
    """
    if isinstance(value, Mapping):
        for inner, each in value.items():
            check_sensible(f"{name}.{inner}", each, default.get(inner) if isinstance(default, Mapping) else None)
    elif isinstance(value, list | tuple):
        for each in value:
            check_sensible(name, each, default)
    elif isinstance(value, str):
        check_regular(name, Path(value))
    elif isinstance(value, int | float) and "seed" not in name:
        defaults = default if isinstance(default, list) else [default]
        usual = max((abs(each) for each in defaults if isinstance(each, int | float)), default=0)
        limit, why = (TIMES * usual, f", {TIMES} times the default") if usual else (LARGEST, "")
        if 0 < abs(value) < SMALLEST:
            raise RequestError(f"`{name}`: expected 0 or a number from {SMALLEST:g}, got {value:g}")
        if value != default and not abs(value) < limit:
            raise RequestError(f"`{name}`: expected a number below {limit:g}{why}, got {value:g}")


def check_regular(name: str, path: Path) -> None:
    """Refuse a device or a pipe, which may never end; raises RequestError."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # no such thing: whoever needs it says so
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        option = f"`{name}`: " if name else ""
        raise RequestError(f"{option}expected a file or a folder, but {path} is a device or a pipe; copy it to a file")
