"""How people are counted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import Shared

Anchor = Literal["feet", "centre", "head", "floor"]
PERSON = 1.7
"""Height of a person, metres: the unit of shares of a height on a floor."""


@dataclass(frozen=True)
class CountSettings(Shared):
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
    band: float = 0.2
    interval: float = 60.0
    waiting: float = 0.2
    gathering: float = 0.8

    def check(self) -> None:
        """See `Shared.check`."""
        if self.anchor not in (None, "feet", "centre", "head", "floor"):
            raise RequestError(f"`anchor`: expected feet, centre, head or floor, got {self.anchor!r}")
        for name in ("band", "waiting", "gathering"):
            if not 0 <= getattr(self, name) <= 10:
                raise RequestError(f"`{name}`: expected 0 to 10 heights, got {getattr(self, name):g}")
        if not 0.1 <= self.interval <= 1e6:
            raise RequestError(f"`interval`: expected 0.1 to 1000000 seconds, got {self.interval:g}")
