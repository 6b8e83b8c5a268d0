"""Bodies by name or file, for the command line and for files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from tsuiseki.tracking.bodies.ball import Ball
from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.bodies.goldfish import Goldfish
from tsuiseki.tracking.bodies.learnt import read_body
from tsuiseki.tracking.errors import RequestError

BODIES: Mapping[str, Callable[..., Body]] = {"goldfish": Goldfish, "ball": Ball}


def parse_body(text: str) -> Body:
    """A body by name, with its sizes where they differ from the usual ones, or a file of `tsuiseki train body`.

    >>> parse_body("goldfish,length=40,width=14").card["length"]
    40.0

    Raises:
        RequestError: there is no such body, size or file, or a size is no number.
    """
    if text.endswith(".json"):
        return read_body(Path(text))
    name, *sizes = (part.strip() for part in text.split(","))
    values: dict[str, object] = {"body": name}
    for size in sizes:
        key, equals, value = size.partition("=")
        if not equals:
            raise RequestError(f"expected sizes of a body as name=number, got {size!r} in {text!r}")
        values[key.strip()] = value.strip()
    return body_of_card(values)


def body_of_card(card: Mapping[str, object]) -> Body:
    """The goldfish or ball that a :attr:`Body.card` describes; numbers may be text.

    Raises:
        RequestError: as :func:`parse_body`.
    """
    make = BODIES.get(str(card.get("body")))
    if make is None:
        raise RequestError(
            f"expected a body of {', '.join(BODIES)} or a file .json of tsuiseki train body, got {card.get('body')!r}"
        )
    known = {field.name: _number_type(field.type) for field in fields(make)}  # type: ignore[arg-type]
    sizes: dict[str, Any] = {}
    for key, value in card.items():
        if key == "body":
            continue
        if key not in known:
            raise RequestError(f"expected sizes of the {card['body']} among {', '.join(known)}, got {key!r}")
        try:
            sizes[key] = known[key](value)
        except (TypeError, ValueError) as error:
            raise RequestError(f"expected a number for {key} of the {card['body']}, got {value!r}") from error
    return make(**sizes)


def _number_type(annotation: object) -> Callable[[Any], float | int]:
    return int if annotation == "int" else float
