"""How people are counted."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.fields import Options

Anchor = Literal["feet", "centre", "head", "floor"]
PERSON = 1.7
"""Height of a person, metres: the unit of shares of a height on a floor."""
Heights = Annotated[float, Field(ge=0, le=10)]


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class CountSettings(Options):
    """How people are counted.

    Attributes:
        anchor: point of a box that stands for its person: feet (middle of the lower edge), centre, head (middle of the
            upper edge), or floor (the feet, in metres on the floor); by default floor for scenes in metres, else feet.
        band: of a line or border, to each side, in heights of the person (on a floor, of 1.7 m): steps to and fro
            within it are not counted.
        interval: seconds over which flows are summed.
        waiting: speed below which a person in a zone waits, heights a second.
        gathering: largest distance between people who gather, in heights; three or more gather.
    """

    anchor: Anchor | None = None
    band: Heights = 0.2
    interval: Annotated[float, Field(ge=0.1, le=1_000_000)] = 60.0
    waiting: Heights = 0.2
    gathering: Heights = 0.8
