"""What somebody under a drone can be doing: a posture, perhaps an action with it, and the pose that goes with both."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.datamodules.scenes.people.acting import (
    calling,
    drinking,
    holding_before,
    hugging,
    lying,
    pulling,
    reading,
    running,
    shaking_hands,
    sitting,
    strolling,
)
from tsuiseki.datamodules.scenes.people.body import Pose
from tsuiseki.datamodules.scenes.people.gait import standing, stride_length
from tsuiseki.datamodules.scenes.people.person import Person
from tsuiseki.datamodules.scenes.people.props import CART_AHEAD, CRATE_AHEAD, HANDLE_HEIGHT, SUITCASE_BEHIND, Kind, Prop
from tsuiseki.tracking.formats.acting_tracks import (
    CALLING,
    CARRYING,
    DRINKING,
    HANDSHAKING,
    HUGGING,
    LYING,
    PUSHING,
    READING,
    RUNNING,
    SITTING,
    STANDING,
    WALKING,
)


@dataclass(frozen=True)
class Activity:
    """A posture, with or without something that is done meanwhile.

    Attributes:
        posture: one of `POSTURES`.
        act: another action, or None.
        seconds: (shortest, longest).
        weight: how often it is chosen, relatively.
    """

    posture: str
    act: str | None = None
    seconds: tuple[float, float] = (3.0, 8.0)
    weight: float = 1.0

    @property
    def actions(self) -> tuple[str, ...]:
        """The one or two labels."""
        return (self.posture,) if self.act is None else (self.act, self.posture)

    @property
    def moving(self) -> bool:
        """Whether one gets somewhere by it."""
        return self.posture in (WALKING, RUNNING)


WALK, STAND = Activity(WALKING), Activity(STANDING)
SIT, LIE = Activity(SITTING, seconds=(4, 10)), Activity(LYING, seconds=(4, 10))
ACTIVITIES = (
    WALK,
    STAND,
    SIT,
    LIE,
    Activity(RUNNING, weight=1.5),
    Activity(STANDING, READING, weight=0.5),
    Activity(SITTING, READING, (4, 10), 0.6),
    Activity(STANDING, DRINKING, weight=0.5),
    Activity(SITTING, DRINKING, (4, 8), 0.3),
    Activity(WALKING, DRINKING, weight=0.3),
    Activity(STANDING, CALLING, weight=0.5),
    Activity(WALKING, CALLING, weight=0.5),
    Activity(WALKING, PUSHING, (5, 12), 1.2),
    Activity(WALKING, CARRYING, (5, 12), 0.9),
    Activity(STANDING, CARRYING, (2, 4), 0.2),
    Activity(STANDING, HANDSHAKING, (2.5, 5), 1.2),
    Activity(STANDING, HUGGING, (2.5, 5), 1.2),
)
# What each action is done with; what stands on the ground must be fetched first.
HELD: dict[str, tuple[Kind, ...]] = {READING: ("book",), DRINKING: ("bottle",), CALLING: ("phone",)}
FETCHED: dict[str, tuple[Kind, ...]] = {PUSHING: ("cart", "suitcase"), CARRYING: ("crate",)}
# Metres between two people.
APART = {HANDSHAKING: 0.95, HUGGING: 0.42}
# Metres from the person's middle to that of what was fetched, forward.
AHEAD: dict[Kind, float] = {"cart": CART_AHEAD, "suitcase": -SUITCASE_BEHIND, "crate": CRATE_AHEAD}


def resting_pose(rng: np.random.Generator, activity: Activity, person: Person, on_bench: bool) -> Pose:
    """The posture under an activity, as this person takes it this time."""
    if activity.posture == SITTING:
        return sitting(rng, not on_bench)
    if activity.posture == LYING:
        return lying(rng, person.build)
    return standing(rng, person.manner)


def stride_frequency(activity: Activity, person: Person, speed: float) -> float:
    """Strides a second at ``speed`` m/s."""
    if activity.posture == RUNNING:
        return 1.25 + 0.06 * speed
    return speed / stride_length(person.build, person.manner, speed)


def pose_of(
    activity: Activity,
    person: Person,
    rest: Pose,
    seconds: float,
    phase: float,
    speed: float,
    hand: int,
    prop: Prop | None,
) -> Pose:
    """The pose after ``seconds`` of an activity.

    Args:
        activity: what is done.
        person: who does it.
        rest: see `resting_pose`.
        seconds: since it began.
        phase: of the gait, in strides.
        speed: m/s.
        hand: that holds what one hand holds.
        prop: what it is done with.
    """
    build = person.build
    if activity.posture == RUNNING:
        return running(build, person.manner, phase, speed)
    if activity.posture == WALKING:
        pose = strolling(build, person.manner, phase, speed)
    else:
        # Nobody keeps quite still.
        pose = replace(rest, look=rest.look + 0.2 * math.sin(0.9 * seconds + 7 * phase), sway=rest.sway)
    if activity.act == READING:
        return reading(build, pose)
    if activity.act == DRINKING:
        return drinking(build, pose, hand, seconds)
    if activity.act == CALLING:
        return calling(build, pose, hand)
    if activity.act == HANDSHAKING:
        return shaking_hands(build, pose, seconds, APART[HANDSHAKING])
    if activity.act == HUGGING:
        return hugging(build, pose, seconds)
    if activity.act == CARRYING:
        return holding_before(build, replace(pose, lean=pose.lean - 0.08), 0.36, 0.5, 1.0)
    if activity.act == PUSHING and prop is not None:
        if prop.kind == "suitcase":
            return pulling(build, pose, hand)
        return holding_before(build, replace(pose, lean=pose.lean + 0.15), 0.42, 0.45, HANDLE_HEIGHT)
    return pose
