"""The correlation filter beside a network: where it sees the target, and how sure it is.

A network knows things in general, the filter of `regularised` learns this target while it is followed. Their errors
differ: the network jumps to another thing of the kind, the filter slides off one that turns. So the filter votes on
the place that particles and response choose. Where both mean the same place, the box is between theirs. Where they do
not, the filter moves to the network's place if it responds there nearly as much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.single import regularised
from tsuiseki.tracking.single.combined import Evidence
from tsuiseki.tracking.single.regularised import Model, RegularisedSettings, RegularisedTarget
from tsuiseki.tracking.single.tracker import box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray

# Standard deviation of the vote about the filter's place, sides of the target.
REACH = 0.3
# Distance of the places, in sides of the target, up to which both mean the same place.
AGREED = 0.5
# Share of the filter in a box on which both agree.
SHARE = 0.5
# Share of its response that the filter must have at the network's place to move there.
NEARLY = 0.9


@dataclass(frozen=True)
class Opinion:
    """What the filter says of a place.

    Attributes:
        target: as the filter has it there.
        agrees: whether the place is the filter's own.
        response: of the filter there, over its running median, at most 2.
        colours: mean colour probability there, likewise.
    """

    target: RegularisedTarget
    agrees: bool
    response: float
    colours: float


class FilterVote:
    """Follows one target by itself, and gives its opinion of places.

    Args:
        image: the first frame.
        box: ``(4,)`` of the target in it.

    Attributes:
        located: where the filter sees the target in the present frame.
    """

    def __init__(self, image: ImageArray, box: FloatArray) -> None:
        self._model = Model.of(RegularisedSettings(), *(box[2:] - box[:2]).tolist())
        self._target = self.located = regularised.start(self._model, image, box_centre(box))
        self._evidence = Evidence()

    def locate(self, image: ImageArray) -> None:
        """Look for the target in the next frame."""
        self.located = regularised.locate(self._model, self._target, image)

    def votes(self, places: FloatArray, side: float) -> FloatArray:
        """``(...)`` votes in [0, 1] for ``(..., 2)`` places: a bell about the filter's, as high as it is sure.

        Args:
            places: pixels.
            side: of the target, pixels.
        """
        squares = ((places - self.located.centre) ** 2).sum(axis=-1) / (REACH * side) ** 2
        return np.asarray(min(self._evidence.shares(self.located)[0], 1.0) * np.exp(-0.5 * squares))

    def opinion(self, image: ImageArray, centre: FloatArray, size: FloatArray) -> Opinion:
        """What the filter says of a target of ``size`` ``(2,)`` at ``centre`` ``(2,)``."""
        agrees = bool((np.abs(centre - self.located.centre) < AGREED * size).all())
        there = self.located
        if not agrees:
            there = regularised.locate(self._model, replace(self._target, centre=centre), image)
        response, colours = self._evidence.shares(there)
        return Opinion(there, agrees, min(response, 2.0), min(colours, 2.0))

    def box_between(self, centre: FloatArray, size: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Centre ``(2,)`` and size ``(2,)`` between those and the filter's, pixels."""
        own = self._model.target * self.located.size
        return (1 - SHARE) * centre + SHARE * self.located.centre, size ** (1 - SHARE) * own**SHARE

    def learn(self, image: ImageArray, opinion: Opinion, certain: bool) -> None:
        """Learn from the filter's place, or move to the place of the opinion.

        Args:
            image: the present frame.
            opinion: of the place that was chosen.
            certain: whether the target is surely there.
        """
        moves = certain or opinion.target.peak > NEARLY * self.located.peak
        there = opinion.target if opinion.agrees or moves else self.located
        self._target = regularised.update(self._model, there, image)
        if opinion.agrees:
            self._evidence.add(there)
