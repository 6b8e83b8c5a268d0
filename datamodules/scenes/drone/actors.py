"""Who acts in a gathering: each person's state, its steps from frame to frame, and what is remembered of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.datamodules.scenes.people.activities import STAND, Activity, pose_of, stride_frequency
from tsuiseki.datamodules.scenes.people.body import Pose, blend
from tsuiseki.datamodules.scenes.people.person import Person
from tsuiseki.datamodules.scenes.people.props import Prop
from tsuiseki.tracking.types import FloatArray

# Seconds from one pose to the next.
CHANGE = 0.45
# Metres that people keep between their middles, and radians a second that they turn by.
SPACE, TURN_RATE = 0.8, 3.5


@dataclass(frozen=True)
class PerformerState:
    """One person in one frame: where, how, and what it is doing, with what in which hand."""

    position: FloatArray
    heading: float
    pose: Pose
    activity: Activity
    prop: Prop | None
    hand: int


@dataclass(frozen=True)
class Performer:
    """A person with its `PerformerState` in every frame."""

    person: Person
    states: tuple[PerformerState, ...]


@dataclass
class Standing:
    """A thing on the ground: a bench, or what can be fetched; ``last`` is the frame it was taken in."""

    prop: Prop
    position: FloatArray
    yaw: float
    first: int = 0
    last: int = 1 << 30


@dataclass
class Errand:
    """What somebody is on the way to: an activity at a place, with a partner or a thing there."""

    activity: Activity
    spot: FloatArray
    heading: float
    deadline: int
    partner: int | None = None
    thing: Standing | None = None


@dataclass
class Actor:
    """A person in the simulation: where it is, what it is doing since and until when, and what it is up to."""

    person: Person
    position: FloatArray
    heading: float
    activity: Activity = STAND
    rest: Pose = field(default_factory=Pose)
    began: int = 0
    until: int = 0
    phase: float = 0.0
    pace: float = 1.0
    target: FloatArray = field(default_factory=lambda: np.zeros(2))
    errand: Errand | None = None
    prop: Prop | None = None
    hand: int = 1
    seat: Standing | None = None
    before: Pose = field(default_factory=Pose)
    states: list[PerformerState] = field(default_factory=list)

    def facing(self, angle: float | None = None) -> FloatArray:
        """Unit vector of the heading, or of another angle."""
        angle = self.heading if angle is None else angle
        return np.array([math.cos(angle), math.sin(angle)])


def walk_on(actor: Actor, away: FloatArray, others: FloatArray, rate: float) -> None:
    """One frame of walking or running.

    Args:
        actor: takes the step.
        away: ``(2,)`` metres to where it wants to go.
        others: ``(M, 3)`` x, y and radius of what it goes around.
        rate: frames per second.
    """
    distance = float(np.linalg.norm(away))
    desired = away / max(distance, 1e-6)
    if actor.errand is None or distance > 1.5:
        gap = actor.position - others[:, :2]
        far = np.maximum(np.linalg.norm(gap, axis=1) - others[:, 2], 1e-3)
        push = np.clip((SPACE + 0.5 - far) / 0.5, 0, 1)[:, None] * gap / far[:, None]
        desired = desired + 1.6 * push.sum(axis=0)
    wanted = math.atan2(desired[1], desired[0])
    turn = (wanted - actor.heading + math.pi) % (2 * math.pi) - math.pi
    # Near its aim somebody turns on the spot instead of circling it.
    nimble = 4.0 if actor.errand is not None and distance < 1.0 else 1.0
    limit = nimble * TURN_RATE / rate
    actor.heading += float(np.clip(turn, -limit, limit))
    speed = actor.pace * (0.35 + 0.65 * max(math.cos(turn), 0.0))
    if actor.errand is not None:
        speed = min(speed, 0.25 + 1.5 * distance)
    actor.position = actor.position + actor.facing() * min(speed / rate, distance if actor.errand else 1e6)
    actor.phase += stride_frequency(actor.activity, actor.person, speed) / rate


def remember(actor: Actor, frame: int, rate: float) -> None:
    """Add what ``actor`` is like in ``frame`` to its states."""
    seconds = (frame - actor.began) / rate
    pose = pose_of(actor.activity, actor.person, actor.rest, seconds, actor.phase, actor.pace, actor.hand, actor.prop)
    if actor.states and seconds < CHANGE:
        pose = blend(actor.before, pose, 0.5 - 0.5 * math.cos(math.pi * seconds / CHANGE))
    actor.states.append(
        PerformerState(actor.position.copy(), actor.heading, pose, actor.activity, actor.prop, actor.hand)
    )
