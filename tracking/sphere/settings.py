"""How a ball in space is followed: the settings of `tsuiseki track sphere`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.filters.motion.space import Ballistic, ConstantVelocity3D, RandomWalk3D
from tsuiseki.tracking.options import Shared

PresetName = Literal["extended", "paper"]
MotionName = Literal["constant-velocity", "random-walk", "ballistic"]
LikelihoodName = Literal["contour", "background"]


@dataclass(frozen=True)
class SphereSettings(Shared):
    """How a ball is followed; lengths in metres.

    Attributes:
        preset: extended, or paper: the filter as printed, with the plain sum over the contour (section 2.2.2) or the
            background difference (2.2.1), multiplied over the cameras, and particles weighed at once. It needs a start,
            never searches, and takes no camera for covered.
        spread: standard deviation of the start, metres.
        particles: how many; more are more exact and slower.
        motion: how the ball moves: with a velocity, by random steps as in the paper, or in free flight with bounces; by
            default constant-velocity, with the preset paper random-walk.
        agitation: how restless the motion is: change of velocity in one second, m/s (random walk: of position, m); by
            default 1.5 (random walk 0.15, ballistic 1).
        floor: height of the floor off which a ballistic ball bounces, metres.
        bounce: speed after a bounce over the speed before, 0 to 1.
        drag: of a ballistic ball by the air: deceleration over the speed squared, 1/m; a tennis ball's is about 0.02.
        spin: X,Y,Z of a ballistic ball: its acceleration is the cross product of this with the velocity, 1/s.
        likelihood: the ball's outline, or the difference from the background.
        faint: the ball's outline is faint, as with a lens out of focus: what says nothing is measured beside the ball;
            by default where the ball is less than 12 pixels across. Covered cameras are noticed less surely then.
        tolerance: frames of different videos within so many seconds count as taken together; by default a quarter of
            the shortest time between frames, half of it with live cameras.
    """

    preset: PresetName = "extended"
    spread: float = 0.05
    particles: int = 500
    motion: MotionName | None = None
    agitation: float | None = None
    floor: float = 0.0
    bounce: float = 0.75
    drag: float = 0.0
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    likelihood: LikelihoodName = "contour"
    faint: bool | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if not self.spread > 0:
            raise RequestError(f"`spread`: expected metres above 0, got {self.spread:g}")
        if self.particles < 10:
            raise RequestError(f"`particles`: expected at least 10, got {self.particles}")
        if self.agitation is not None and not self.agitation > 0:
            raise RequestError(f"`agitation`: expected a number above 0, got {self.agitation:g}")
        if self.faint is not None and (self.preset == "paper" or self.likelihood == "background"):
            raise RequestError("`faint`: expected only with the outline of the preset extended; leave it out")
        if not 0 <= self.bounce <= 1:
            raise RequestError(f"`bounce`: expected 0 to 1, got {self.bounce:g}")
        if not 0 <= self.drag < np.inf:
            raise RequestError(f"`drag`: expected a number from 0, got {self.drag:g}")


def chosen_motion(settings: SphereSettings, radius: float) -> Motion:
    """The motion that the settings name."""
    agitation = settings.agitation
    motion = settings.motion or ("random-walk" if settings.preset == "paper" else "constant-velocity")
    if motion == "random-walk":
        return RandomWalk3D(0.15 if agitation is None else agitation)
    if motion == "ballistic":
        restless = 1.0 if agitation is None else agitation
        return Ballistic(
            radius, settings.floor, restitution=settings.bounce, agitation=restless, drag=settings.drag,
            spin=settings.spin,
        )  # fmt: skip
    return ConstantVelocity3D(1.5 if agitation is None else agitation)
