"""Values that no option can sensibly have, refused before anything is done: devices, pipes, numbers out of hand."""

from __future__ import annotations

import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError

TIMES, LARGEST, SMALLEST = 1000, 1e6, 1e-9


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
        _check_number(name, value, default)


def check_regular(name: str, path: Path) -> None:
    """Refuse a device or a pipe, which may never end.

    Raises:
        RequestError: ``path`` is one.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # no such thing: whoever needs it says so
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        option = f"`{name}`: " if name else ""
        raise RequestError(f"{option}expected a file or a folder, but {path} is a device or a pipe; copy it to a file")


def _check_number(name: str, value: float, default: Any) -> None:
    defaults = default if isinstance(default, list) else [default]
    usual = max((abs(each) for each in defaults if isinstance(each, int | float)), default=0)
    limit, why = (TIMES * usual, f", {TIMES} times the default") if usual else (LARGEST, "")
    if 0 < abs(value) < SMALLEST:
        raise RequestError(f"`{name}`: expected 0 or a number from {SMALLEST:g}, got {value:g}")
    if value != default and not abs(value) < limit:
        raise RequestError(f"`{name}`: expected a number below {limit:g}{why}, got {value:g}")
