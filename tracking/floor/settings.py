"""Settings of tracking on one floor, and the options of the command."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.floor.floor_flow import FloorFlow
from tsuiseki.tracking.floor.foot_points import FootNoise
from tsuiseki.tracking.options import Shared

OneFloorMethod = Literal["flow", "lmb"]


@dataclass(frozen=True)
class OneFloorSettings(Shared):
    """How people are followed on one floor.

    Attributes:
        method: flow links the whole video at the end; lmb decides at each moment, and knows nothing of certain ids.
        tolerance: frames of different cameras within so many seconds count as taken together; by default a quarter of
            the shortest time between frames.
        floor: X1,Y1,X2,Y2 of the plan, metres; by default that of cameras.yaml, or what the measurements span.
        noise: how exactly a detection tells where somebody stands.
        flow: settings of the flow.
    """

    method: OneFloorMethod = "flow"
    tolerance: float | None = None
    floor: tuple[float, float, float, float] | None = None
    noise: FootNoise = field(default_factory=FootNoise)
    flow: FloorFlow = field(default_factory=FloorFlow)

    def check(self) -> None:
        """See `Shared.check`."""
        if self.tolerance is not None and not self.tolerance >= 0:
            raise RequestError(f"`tolerance`: expected seconds from 0, got {self.tolerance:g}")
        if self.floor is not None and not (self.floor[0] < self.floor[2] and self.floor[1] < self.floor[3]):
            raise RequestError(f"`floor`: expected X1 < X2 and Y1 < Y2, got {self.floor}")
