"""Calls from Python, checked as the command line is: the type of every argument, and numbers out of hand.

`guarded` is put around each public name where it is first used.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from tsuiseki.tracking.cli.values import check_sensible
from tsuiseki.tracking.errors import RequestError

# What types say badly, by the name of the argument and whether it may be a text.
TOLD = {
    ("frames", True): "FIRST-LAST as a text, such as 301-400",
    ("source", True): "a video file, a folder of images, a camera's number or a list of images (H, W, 3) uint8",
}
# Made by the thousand.
PLENTY = ("Detections", "Targets")


def guarded(public: Any) -> Any:
    """A public function that checks its arguments, or a public class whose making and whose methods do.

    Of `PLENTY`, which check themselves, only what they raise becomes a RequestError.
    """
    if inspect.isfunction(public):
        checked = _checked(public)
        # Where another process finds it.
        checked.__module__ = "tsuiseki"
        return checked
    if inspect.isclass(public) and not issubclass(public, Exception):
        plenty = public.__name__ in PLENTY
        for name, member in [*vars(public).items()]:
            if name == "__init__":
                setattr(public, name, _refusing(member if plenty else _checked(member, not is_dataclass(public))))
            elif not (name.startswith("_") or plenty):
                if inspect.isfunction(member):
                    setattr(public, name, _checked(member))
                elif isinstance(member, classmethod):
                    setattr(public, name, classmethod(_checked(member.__func__)))
    return public


def _refusing(make: Callable[..., None]) -> Callable[..., None]:
    @wraps(make)
    def made(self: Any, *given: Any, **named: Any) -> None:
        try:
            make(self, *given, **named)
        except RequestError:
            raise
        except (AttributeError, IndexError, OverflowError, TypeError, ValueError) as error:
            inspect.signature(make).bind(self, *given, **named)  # raises TypeError for unknown names
            raise RequestError(str(error)) from error

    return made


def _checked(function: Callable[..., Any], bounded: bool = True) -> Callable[..., Any]:
    """``function`` whose arguments are checked, and ``bounded`` numbers; those of settings are where these are used."""
    signature = inspect.signature(function)

    @cache
    def kinds() -> dict[str, Any]:
        try:
            return get_type_hints(function)
        except NameError:  # one of a package that need not be there
            return {}

    @wraps(function)
    def checked(*given: Any, **named: Any) -> Any:
        for name, value in signature.bind(*given, **named).arguments.items():
            parameter = signature.parameters[name]
            if name not in kinds() or parameter.kind is parameter.VAR_POSITIONAL:
                continue
            if parameter.kind is not parameter.VAR_KEYWORD:
                check_argument(name, value, kinds()[name], parameter.default, bounded)
                continue
            known = get_type_hints(*get_args(kinds()[name])) if get_args(kinds()[name]) else {}
            for inner, each in value.items():
                if known and inner not in known:
                    kind = TypeError if function.__name__ == "__init__" else RequestError
                    raise kind(f"expected the keywords {', '.join(known)}, got {inner!r}")
                check_argument(inner, each, known.get(inner, Any), parameter.empty)
        return function(*given, **named)

    return checked


def check_argument(name: str, value: Any, kind: Any, default: Any, bounded: bool = True) -> None:
    """Refuse a value that is not of its type, is NaN, or runs without end; settings are looked into.

    Args:
        name: of the argument, with those above it before dots.
        value: what came.
        kind: its type, resolved.
        default: of the argument; empty where there is none, and its numbers are of any size.
        bounded: look at the size of numbers, and into settings.

    Raises:
        RequestError: it cannot be used.
    """
    if not fits(value, kind):
        wanted = TOLD.get((name, str in get_args(kind))) or shown(kind)
        raise RequestError(f"`{name}`: expected {wanted}, got {_short(value)}")
    if name.rpartition(".")[2] in ("seed", "threads") and isinstance(value, Real) and value < 0:
        raise RequestError(f"`{name}`: expected a whole number from 0, got {value!r}")
    if bounded and isinstance(value, Real) and not isinstance(value, bool):
        number = value if isinstance(value, int | float) else float(value)
        check_sensible(name, number, number if default is inspect.Parameter.empty else default)
    elif bounded and is_settings(value):
        usual, types = type(value)(), get_type_hints(type(value))
        for one in fields(value):
            check_argument(f"{name}.{one.name}", getattr(value, one.name), types[one.name], getattr(usual, one.name))


def is_settings(value: Any) -> bool:
    """Whether this is a dataclass that can be made without any argument."""
    if not is_dataclass(value) or isinstance(value, type):
        return False
    return all(p.default is not p.empty for p in inspect.signature(type(value)).parameters.values())


def fits(value: Any, kind: Any) -> bool:
    """Whether ``value`` is of the type ``kind``, as far as can be told without looking into arrays and iterators."""
    origin, inner = get_origin(kind), get_args(kind)
    base = origin or kind
    if base in (Union, UnionType):
        return (_of_arrays(inner) and _like_array(value)) or any(fits(value, each) for each in inner)
    if base is Literal:
        return any(isinstance(value, type(each)) and value == each for each in inner)
    if base is Path:
        return isinstance(value, str | PathLike)
    if base in (float, int, bool):
        truth = type(value).__name__ == "bool"
        number = isinstance(value, Real if base is float else Integral) and not truth and value == value
        return truth if base is bool else number
    if getattr(base, "_is_protocol", False):
        asked = [name for each in base.__mro__ for name in vars(each) if not name.startswith("_")]
        return all(hasattr(value, name) for name in asked) if asked else callable(value)
    if base is Any or not isinstance(base, type):
        return True
    if base.__name__ == "ndarray":
        return _like_array(value)
    if base in (tuple, list, Sequence, Collection, Iterable):
        if isinstance(value, str | bytes | Mapping):
            return False
        listed = isinstance(value, list | tuple)
        if base is tuple and inner[-1:] != (...,):
            return listed and len(value) == len(inner) and all(map(fits, value, inner))
        if listed and inner:
            return all(fits(each, inner[0]) for each in value)
        return isinstance(value, Iterable) and (base is Iterable or hasattr(value, "__len__"))
    return isinstance(value, base)


def _of_arrays(kinds: tuple[Any, ...]) -> bool:
    return any(getattr(each, "__module__", "").startswith("numpy._typing") for each in kinds)


def _like_array(value: Any) -> bool:
    return hasattr(value, "__array__") or (isinstance(value, Collection) and not isinstance(value, str | bytes))


def shown(kind: Any) -> str:
    """A type in words.

    >>> shown(float | None), shown(Literal["auto", "cpu"]), shown(Path | str)
    ('a number or None', 'auto or cpu', 'a path')
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        words = ["an array"] if _of_arrays(inner) else []
        words += [shown(each) for each in inner if not words or each not in (bool, int, float, complex, bytes)]
        if Path in inner:
            words = [word for word in words if word != "a text"]
        return " or ".join(word for word in dict.fromkeys(words) if not word.startswith("_"))
    if origin is Literal:
        return " or ".join(map(str, inner))
    if origin is tuple and inner[-1] is not ...:
        return f"{len(inner)} values ({', '.join(map(shown, inner))})"
    if origin in (tuple, list, Sequence, Collection, Iterable):
        return f"a list of {shown(inner[0])}"
    plain = {float: "a number", int: "a whole number", str: "a text", Path: "a path", bool: "True or False"}
    name = str(getattr(kind, "__name__", kind))
    return plain.get(kind) or {"NoneType": "None", "ndarray": "array", "Callable": "a function"}.get(name, name)


def _short(value: Any) -> str:
    text = repr(value) if isinstance(value, str | Real | NoneType | list | tuple) else ""
    return text if 0 < len(text) < 80 else type(value).__name__
