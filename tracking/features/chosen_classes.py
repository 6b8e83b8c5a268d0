"""The classes that are wanted of a detector that gives more: a function, or an object of other people's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from tsuiseki.tracking.types import Detections, ImageArray
from tsuiseki.tracking.types.class_choice import ClassChoice

if TYPE_CHECKING:
    from tsuiseki.tracking.features.exported import Detect


class ChosenClasses:
    """A detector of some classes only.

    Args:
        detector: gives classes.
        choice: those that are wanted.
        names: of the classes in order, from 0, where its detections do not tell them.
    """

    def __init__(self, detector: Detect, choice: ClassChoice, names: Sequence[str] | None = None) -> None:
        self.detector, self.choice = detector, choice
        self.names = dict(enumerate(names or ()))

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """See `Detect`.

        Raises:
            RequestError: see `ClassChoice.chosen`.
        """
        found = [one if one.names else replace(one, names=self.names) for one in self.detector.detect(images)]
        return [self.choice.chosen(one, "the detector") for one in found]
