"""Which classes a user wants, by number or name, among those that a detector, a file or labels have."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import Detections

# What classes of people are called.
PERSON_NAMES = ("person", "pedestrian", "people", "human", "persons", "pedestrians")
# Classes that a message lists.
_LISTED = 12


@dataclass(frozen=True)
class ClassChoice:
    """The classes that are wanted.

    Attributes:
        classes: numbers and names, at least one; names in any case, digits are numbers.
        across: boxes of different classes suppress each other and share tracks.

    Raises:
        RequestError: there is none, or one stands twice.
    """

    classes: Sequence[int | str]
    across: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.classes, str) or not len(self.classes):
            raise RequestError(f"`classes`: expected a list of numbers or names, got {self.classes!r}")
        if twice := [name for name in self.plain if self.plain.count(name) > 1]:
            raise RequestError(f"`classes`: expected each class once, got {twice[0]} twice")

    @property
    def plain(self) -> tuple[int | str, ...]:
        """Numbers, and names in small letters."""
        return tuple(_plain(name) for name in self.classes)

    def numbers(self, names: Mapping[int, str], there: Collection[int] | None, what: object) -> tuple[int, ...]:
        """Their numbers.

        Args:
            names: of the classes, by number, as far as they are known.
            there: numbers of the classes that there are; None where that is not known.
            what: has the classes, for messages.

        Raises:
            RequestError: one is missing, names are not known, a name is that of several, or two are the same.
        """
        available = sorted(names if there is None else there)
        chosen = [self._number(name, names, available, what) for name in self.plain]
        if twice := [number for number in chosen if chosen.count(number) > 1]:
            raise RequestError(f"`classes`: expected each class once, got {twice[0]} by number and by name")
        return tuple(chosen)

    @staticmethod
    def _number(choice: int | str, names: Mapping[int, str], available: Sequence[int], what: object) -> int:
        fitting = [number for number in available if choice in (number, _plain(names.get(number, "")))]
        if isinstance(choice, int) and choice >= 0 and not available:
            return choice
        if len(fitting) == 1:
            return fitting[0]
        listed = [f"{number} {names.get(number, '')}".strip() for number in available[:_LISTED]]
        there = ", ".join([*listed, *(["…"] if len(available) > _LISTED else [])]) or "none"
        if fitting:
            numbers = ", ".join(map(str, fitting))
            raise RequestError(f"`classes`: {what} calls the classes {numbers} {choice}; give the number")
        advice = "" if names else "; it names none, so give numbers, or their names with `detector_options.classes`"
        raise RequestError(
            f"`classes`: expected classes of {what} ({there}), got {choice}{advice if isinstance(choice, str) else ''}"
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
        if names.keys() - present or (not names and any(isinstance(name, str) for name in self.plain)):
            self.numbers(names, names.keys() | present, what)
        numbers = [number for name in self.plain for number in called(name, names)]
        return detections.select(np.isin(detections.classes, numbers))


def called(choice: int | str, names: Mapping[int, str]) -> list[int]:
    """Numbers of the classes that a number or a name, as in `ClassChoice.plain`, stands for."""
    return [choice] if isinstance(choice, int) else [number for number, name in names.items() if _plain(name) == choice]


def only_people(names: Mapping[int, str]) -> bool:
    """Whether a detector detects people alone: one class of such a name, or the usual one without."""
    return all(_plain(name) in PERSON_NAMES for name in names.values())


def _plain(name: int | str) -> int | str:
    text = str(name).strip().lower()
    return int(text) if text.removeprefix("-").isdecimal() else text
