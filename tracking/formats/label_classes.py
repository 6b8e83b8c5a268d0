"""Which labels count as the class that is asked for, by the numbers and names of a layout."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types.class_choice import PERSON_NAMES, ClassChoice

# What asks for people as every layout counts them.
PEOPLE = "person"


class NothingLabelledError(RequestError):
    """A sequence has no box that counts."""


def wanted_numbers(
    wanted: int | str | None, names: Mapping[int, str], people: Collection[int], what: object
) -> tuple[int, ...]:
    """Numbers of the classes of a layout that count.

    Args:
        wanted: a number, a name, or ``person`` or None for people.
        names: of all classes, by number.
        people: numbers of those that are people.
        what: has them, for messages.

    Raises:
        RequestError: there is no such class.
    """
    if wanted is None or ClassChoice((wanted,)).plain == (PEOPLE,):
        return tuple(people)
    return ClassChoice((wanted,)).numbers(names, names.keys(), what)


def same_class(one: str, other: str) -> bool:
    """Whether two names are of one class; all names of people are.

    >>> same_class("Person", "pedestrian"), same_class("car", "Car"), same_class("car", "truck")
    (True, True, False)
    """
    first, second = one.strip().lower(), other.strip().lower()
    return first == second or {first, second} <= set(PERSON_NAMES)
