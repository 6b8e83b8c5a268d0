"""The arms of the goldfish experiment: how particles are expected to move, and what is added to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.motion.bodies import BodyFixedVelocity, BodyMotion
from tsuiseki.tracking.filters.motion.learnt import LearntMotion
from tsuiseki.tracking.filters.particles.particle_filter import AdaptiveNumber
from tsuiseki.trainers.bodies.motion import Steps, components_of, regression

# Columns of `conditions` for a body with one shape column: velocity and bend; the last changes of heading and bend.
VELOCITY_AND_BEND, LAG = (0, 1, 2, 3), (4, 5)
WIDER = 1.6
"""Times the learnt deviations; the best of 1, 1.3 and 1.6 with 100 and 200 particles on development clips."""


@dataclass(frozen=True)
class Learnt:
    """What the learning run taught.

    Attributes:
        motion: see `LearntMotion`.
        steps: that it was learnt from.
    """

    motion: LearntMotion
    steps: Steps

    def depending_on(self, columns: Sequence[int]) -> BodyFixedVelocity:
        """(16)-(17) whose increments depend on some of the conditions, see `conditions`."""
        gain = np.zeros((self.motion.dimension, self.steps.conditions.shape[1]))
        used = list(columns)
        gain[:, used], rest = regression(self.steps.conditions[:, used], self.steps.increments)
        return BodyFixedVelocity(components_of(rest).noise(), self.motion.velocity.noise(), gain)


@dataclass(frozen=True)
class Arm:
    """One way to move particles.

    Attributes:
        title: for people.
        motion: from what was learnt.
        layers: 1, or 2 with half the particles in each.
        adaptive: the number of particles of an arm varies about the nominal one.
    """

    title: str
    motion: Callable[[Learnt], BodyMotion]
    layers: int = 1
    adaptive: bool = False

    def number(self, nominal: int) -> AdaptiveNumber | None:
        """The adaptive number about ``nominal``; None where it is fixed.

        The bins are about a third of the deviations in which particles spread, so that the bound, too, is near it.
        """
        if not self.adaptive:
            return None
        bins = np.array([16.0, 16.0, 0.6, 1.0, np.inf, np.inf, np.inf, np.inf])
        return AdaptiveNumber(bins, error=20.0 / nominal, minimum=nominal // 4, maximum=4 * nominal)


ARMS: Mapping[str, Arm] = {
    "A": Arm("A: random walk (8)", lambda learnt: learnt.motion.random_walk()),
    "B": Arm("B: body-fixed velocity (16)-(17), independent", lambda learnt: learnt.motion.independent()),
    "C": Arm("C: body-fixed velocity (16)-(18), learnt together", lambda learnt: learnt.motion.proposal()),
    "D": Arm("D: constant velocity (9)", lambda learnt: learnt.motion.constant_velocity()),
    "P": Arm("C as printed, by (14)", lambda learnt: learnt.motion.printed_proposal()),
}
"""The four arms of the experiment, and the third as printed."""

BEYOND: Mapping[str, Arm] = {
    "C": ARMS["C"],
    "velocity": Arm("C + velocity and bend", lambda learnt: learnt.depending_on(VELOCITY_AND_BEND)),
    "lag": Arm("C + lag", lambda learnt: learnt.depending_on(LAG)),
    "both": Arm("C + velocity, bend and lag", lambda learnt: learnt.motion.conditional()),
    "annealed": Arm("C, annealed", lambda learnt: learnt.motion.proposal(), layers=2),
    "both annealed": Arm("C + velocity, bend and lag, annealed", lambda learnt: learnt.motion.conditional(), layers=2),
    "wider": Arm(f"C, noise {WIDER:g} times as wide", lambda learnt: learnt.motion.widened(WIDER).proposal()),
    "wider B": Arm(f"B, noise {WIDER:g} times as wide", lambda learnt: learnt.motion.widened(WIDER).independent()),
    "adaptive": Arm("C, adaptive number", lambda learnt: learnt.motion.proposal(), adaptive=True),
    "both adaptive": Arm(
        "C + velocity, bend and lag, adaptive number", lambda learnt: learnt.motion.conditional(), adaptive=True
    ),
}
"""What may be added to the third arm to do with fewer particles."""
