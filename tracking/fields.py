"""What fields of settings are on the command line.

A command is a function of typed parameters. Those of a class below `Options` give their fields as options of the
command itself; other parameters are options by their own names::

    def blobs(video: Video, *, output: SeededOutput, particles: Particles = 500) -> int: ...
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_origin

from cyclopts import Parameter
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError, WrapValidator

from tsuiseki.tracking.bounds import refusal
from tsuiseki.tracking.errors import RequestError

T = TypeVar("T")


def _parts(words: Any) -> Any:
    """The parts between the commas of words; lists of YAML and Python stay as they are."""
    if not isinstance(words, list):
        return words
    return [part for word in words for part in (word.strip().split(",") if isinstance(word, str) else [word])]


def _rows(words: Any) -> Any:
    """Lists in a list: each word is one of them, with commas between its parts."""
    return [_parts([word]) if isinstance(word, str) else word for word in words] if isinstance(words, list) else words


def converted(kind: Any, tokens: Sequence[Any]) -> Any:
    """The words of an option as one of type ``kind``; raises ValidationError."""
    words = [token.value for token in tokens]
    if get_origin(kind) is Literal and words[0].isdecimal():
        words = [int(words[0])]
    return TypeAdapter(kind).validate_python(words if get_origin(kind) in (list, tuple) else words[0])


def _split(kind: Any, tokens: Sequence[Any]) -> Any:
    return TypeAdapter(kind).validate_python(_parts([token.value for token in tokens]))


def _words(value: Any, checked: Any) -> Any:
    return checked(value) if isinstance(value, str) else value


# A list or tuple that is one word with commas, and lists in a list, where the option is repeated.
Commas: TypeAlias = Annotated[
    T, BeforeValidator(_parts), Parameter(n_tokens=1, allow_leading_hyphen=True, converter=_split)
]
Rows: TypeAlias = Annotated[T, BeforeValidator(_rows), Parameter(n_tokens=1, allow_leading_hyphen=True)]
# Classes by number or name.
ClassNames: TypeAlias = Commas[list[Annotated[int | str, Field(union_mode="left_to_right")]]]
# Python calls give networks, functions, arrays and trackers in the place of a file and of a name.
OBJECTS = WrapValidator(_words)
FileLike: TypeAlias = Annotated[Path | None, OBJECTS]
# Frames a second.
FrameRate: TypeAlias = Annotated[float, Field(gt=0, le=1000)]
Threads: TypeAlias = Annotated[int, Field(ge=0, le=10_000)]
# What the command line does not show.
HIDDEN = Parameter(parse=False)


def showing(*names: str) -> Parameter:
    """Of a group of settings, these fields alone are on the command line; the group itself and those between too."""
    return Parameter(parse=f"^({'|'.join(names)})$")


@Parameter(name="*")
class Options:
    """A dataclass whose fields are options of the command itself, not below the parameter's name.

    The texts for the help stand under ``Attributes:``. A command rewords one under ``Args:`` as ``parameter.field``.
    """


@contextmanager
def refused() -> Iterator[None]:
    """Within the ``with`` block a wrong value is a RequestError, in a line."""
    try:
        yield
    except ValidationError as error:
        raise RequestError(refusal(error)) from error
