"""Which classes a user wants, by number or name, among those that a detector, a file or labels have."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import Detections

# What classes of people are called.
PERSON_NAMES = ("person", "pedestrian", "people", "human", "persons", "pedestrians")
_SHOWN = 12


@dataclass(frozen=True)
class ClassChoice:
    """The classes that are wanted.

    Attributes:
        wanted: numbers and names, at least one; names in any case, digits are numbers.
        across: boxes of different classes suppress each other and share tracks.

    Raises:
        RequestError: there is none, or one stands twice.
    """

    wanted: Sequence[int | str]
    across: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.wanted, str) or not len(self.wanted):
            raise RequestError(f"`classes`: expected a list of numbers or names, got {self.wanted!r}")
        if twice := [one for one in self.plain if self.plain.count(one) > 1]:
            raise RequestError(f"`classes`: expected each class once, got {twice[0]} twice")

    @property
    def plain(self) -> tuple[int | str, ...]:
        """Numbers, and names in small letters."""
        return tuple(_plain(one) for one in self.wanted)

    def numbers(self, names: Mapping[int, str], there: Collection[int] | None, what: object) -> tuple[int, ...]:
        """Their numbers.

        Args:
            names: of the classes, by number, as far as they are known.
            there: numbers of the classes that there are; None where that is not known.
            what: has the classes, for messages.

        Raises:
            RequestError: one is missing, names are not known, a name is that of several, or two are the same.
        """
        known = sorted(names if there is None else there)
        found = [self._number(one, names, known, what) for one in self.plain]
        if twice := [number for number in found if found.count(number) > 1]:
            raise RequestError(f"`classes`: expected each class once, got {twice[0]} by number and by name")
        return tuple(found)

    @staticmethod
    def _number(one: int | str, names: Mapping[int, str], known: Sequence[int], what: object) -> int:
        fitting = [number for number in known if one in (number, _plain(names.get(number, "")))]
        if isinstance(one, int) and one >= 0 and not known:
            return one
        if len(fitting) == 1:
            return fitting[0]
        listed = [f"{number} {names.get(number, '')}".strip() for number in known[:_SHOWN]]
        there = ", ".join([*listed, *(["…"] if len(known) > _SHOWN else [])]) or "none"
        if fitting:
            numbers = ", ".join(map(str, fitting))
            raise RequestError(f"`classes`: {what} calls the classes {numbers} {one}; give the number")
        advice = "" if names else "; it names none, so give numbers, or their names with `detector_options.classes`"
        raise RequestError(
            f"`classes`: expected classes of {what} ({there}), got {one}{advice if isinstance(one, str) else ''}"
        )

    def chosen(self, detections: Detections, what: object) -> Detections:
        """The detections of a frame that are of these classes.

        Raises:
            RequestError: detections have no classes, or names are wanted and they have none; or their names tell more
                classes than are in the frame, and one that is wanted is none of them.
        """
        if not len(detections):
            return detections
        if detections.classes is None:
            raise RequestError(f"`classes`: expected classes of {what}, got boxes without; leave `classes` out")
        present, names = set(detections.classes.tolist()), detections.names
        # A list of all names tells what can never come.
        if names.keys() - present or (not names and any(isinstance(one, str) for one in self.plain)):
            self.numbers(names, names.keys() | present, what)
        wanted = [number for one in self.plain for number in called(one, names)]
        return detections.select(np.isin(detections.classes, wanted))


def called(one: int | str, names: Mapping[int, str]) -> list[int]:
    """Numbers of the classes that a number or a name, as in `ClassChoice.plain`, stands for."""
    return [one] if isinstance(one, int) else [number for number, name in names.items() if _plain(name) == one]


def only_people(wanted: Mapping[int, str]) -> bool:
    """Whether a detector detects people alone: one class of such a name, or the usual one without."""
    return all(_plain(name) in PERSON_NAMES for name in wanted.values())


def _plain(one: int | str) -> int | str:
    text = str(one).strip().lower()
    return int(text) if text.removeprefix("-").isdecimal() else text
