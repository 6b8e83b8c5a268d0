"""The arms of the goldfish's fair test: what is drawn together, and what it depends on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from tsuiseki.tracking.filters.motion.bodies import BodyFixedVelocity
from tsuiseki.trainers.experiments.goldfish.arms import LAG, Learnt


def uncorrelated_lag(learnt: Learnt) -> BodyFixedVelocity:
    """The lag, and what it leaves drawn independently."""
    motion = learnt.depending_on(LAG)
    return replace(motion, noise=motion.noise.without_correlation())


def with_lag(learnt: Learnt) -> BodyFixedVelocity:
    """The lag, and what it leaves along its principal components."""
    return learnt.depending_on(LAG)


def independent(learnt: Learnt) -> BodyFixedVelocity:
    """(16)-(17)."""
    return learnt.motion.independent()


def correlated(learnt: Learnt) -> BodyFixedVelocity:
    """(16)-(18)."""
    return learnt.motion.proposal()


def conditional(learnt: Learnt) -> BodyFixedVelocity:
    """The preset ``conditional``."""
    return learnt.motion.conditional()


ARMS: Mapping[str, tuple[str, Callable[[Learnt], BodyFixedVelocity]]] = {
    "B": ("B: (16)-(17), independent", independent),
    "C": ("C: (16)-(18), learnt together", correlated),
    "B lag": ("B + bend and turn of the frame before", uncorrelated_lag),
    "C lag": ("C + bend and turn of the frame before", with_lag),
    "conditional": ("conditional: + velocity and bend", conditional),
}
