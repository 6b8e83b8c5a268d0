"""What all settings have in common: bounds of their numbers, and how a refusal reads in one line.

Settings are frozen dataclasses of pydantic. They refuse a name that is no field, a value of another type, NaN and
infinity, and a number out of the bounds of its field, whether they are made in Python, by the command line or of YAML::

    @dataclass(frozen=True, config=SETTINGS)
    class SortSettings:
        min_iou: PositiveShare = 0.3
        max_age: Age = 10
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import ConfigDict, Field, ValidationError

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

S = TypeVar("S", bound="DataclassInstance")

SETTINGS = ConfigDict(extra="forbid", allow_inf_nan=False)

Share = Annotated[float, Field(ge=0, le=1)]
PositiveShare = Annotated[float, Field(gt=0, le=1)]
# A day: no gap, window or patience is longer.
Seconds = Annotated[float, Field(ge=0, le=86_400)]
PositiveSeconds = Annotated[float, Field(gt=0, le=86_400)]
# Several minutes at any frame rate; whoever is missed for longer is somebody else.
Age = Annotated[int, Field(ge=0, le=10_000)]
# A million of particles fill some hundred megabytes for each target.
Particles = Annotated[int, Field(ge=1, le=1_000_000)]
# Cosine distance of two features.
CosineDistance = Annotated[float, Field(ge=0, le=2)]


# Mistakes in names, by pydantic's word for them.
ABSENT = {
    "unexpected_keyword_argument": "there is no such setting",
    "missing": "expected a value, got none",
    "missing_argument": "expected a value, got none",
}


def as_settings(settings: S | None, kind: type[S], name: str = "settings") -> S:
    """The settings, or the default ones for None; raises RequestError where ``name`` is of another kind."""
    if settings is None:
        return kind()
    if not isinstance(settings, kind):
        raise RequestError(f"`{name}`: expected {kind.__name__}, got {type(settings).__name__}")
    return settings


def changed(settings: S, kind: type[S], values: Mapping[str, object]) -> S:
    """The settings with those of the values, by the names of fields, that are not None; other names say nothing.

    Raises:
        RequestError: the settings are of another kind.
        ValidationError: a change is out of its bounds.
    """
    settings = as_settings(settings, kind)
    names = [option.name for option in fields(kind) if values.get(option.name) is not None]
    return replace(settings, **{name: values[name] for name in names})


def refusal(error: ValidationError, prefix: str = "") -> str:
    """The first mistake in a line: the field in backquotes, after a prefix; what was expected, what came.

    >>> from pydantic import TypeAdapter
    >>> try:
    ...     TypeAdapter(Share).validate_python(2)
    ... except ValidationError as error:
    ...     print(refusal(error))
    expected a number less than or equal to 1, got 2
    """
    first: Any = error.errors(include_url=False)[0]
    field = ".".join(part for part in [prefix, *first["loc"]] if part and isinstance(part, str))
    if first["type"] == "value_error":
        return str(first["ctx"]["error"])
    if first["type"] in ABSENT:
        return f"`{field}`: {ABSENT[first['type']]}"
    number = " a number" if first["type"].startswith(("greater", "less")) else ""
    expected = first["msg"].replace("Input should be", f"expected{number}", 1)
    return f"`{field}`: {expected}, got {first['input']!r}" if field else f"{expected}, got {first['input']!r}"
