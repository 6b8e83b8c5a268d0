"""Poses of the actions that drones film: the twelve of Okutama-Action, each with what it does to arms, legs and trunk.

Hands are led to where the action wants them by two-link inverse kinematics; the rest of the pose comes from the gait or
from a fixed posture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.datamodules.scenes.people.person import Person
from tsuiseki.datamodules.scenes.people.posture import (
    FOREARM,
    HAND,
    SIDES,
    UPPER_ARM,
    Build,
    Manner,
    Pair,
    Pose,
    pair,
    standing,
    stride_length,
    walking,
)
from tsuiseki.datamodules.scenes.people.props import CART_AHEAD, CRATE_AHEAD, HANDLE_HEIGHT, SUITCASE_BEHIND, Kind, Prop
from tsuiseki.tracking.formats import acting_tracks as act
from tsuiseki.tracking.types import FloatArray

LEFT, RIGHT = 0, 1
# Seconds of one sip: the bottle goes up, stays at the mouth, goes down and stays there.
SIP = (0.6, 1.6, 0.6, 1.4)
# Of a handshake: beats a second and metres of its rise and fall.
SHAKE_RATE, SHAKE_RISE = 2.2, 0.09


def reach(
    build: Build, pose: Pose, hand: int, target: FloatArray | tuple[float, float, float], swivel: float = 0.4
) -> Pose:
    """``pose`` with the palm of ``hand`` at ``target``, or as near to it as the arm is long.

    Args:
        build: proportions.
        pose: whose arm is replaced.
        hand: `LEFT` or `RIGHT`.
        target: metres forward, outward (to the hand's own side) and up from its shoulder, in the trunk's axes.
        swivel: how far the elbow stands out sideways, radians from straight down.
    """
    upper, lower = UPPER_ARM * build.height, (FOREARM + 0.5 * HAND) * build.height
    aim = np.array(target, dtype=np.float64)
    distance = float(np.clip(np.linalg.norm(aim), abs(upper - lower) + 0.01, 0.999 * (upper + lower)))
    forward = aim / max(float(np.linalg.norm(aim)), 1e-9)
    # The elbow lies on a circle about the line to the target; it hangs down and out.
    down = np.array([-0.15, math.sin(swivel), -math.cos(swivel)])
    side = down - (down @ forward) * forward
    side = side / max(float(np.linalg.norm(side)), 1e-9)
    along = (upper**2 + distance**2 - lower**2) / (2 * distance)
    elbow = along * forward + math.sqrt(max(upper**2 - along**2, 0.0)) * side
    raised, spread = _angles(elbow)
    bent, turned = _angles(distance * forward - elbow)
    # Forward of straight up and back of straight down are half a turn apart: keep the elbow bending forward.
    bend = (bent - raised + math.pi) % (2 * math.pi) - math.pi
    return replace(
        pose,
        shoulder=_put(pose.shoulder, hand, raised),
        spread=_put(pose.spread, hand, spread),
        elbow=_put(pose.elbow, hand, bend),
        inward=_put(pose.inward, hand, spread - turned),
    )


def _angles(direction: FloatArray) -> tuple[float, float]:
    """The angles forward and sideways of a limb that hangs along ``direction``; see `body.hanging`."""
    x, y, z = direction / max(float(np.linalg.norm(direction)), 1e-9)
    return math.atan2(x, -z), math.asin(float(np.clip(y, -1, 1)))


def _put(both: Pair, hand: int, value: float) -> Pair:
    return (value, both[1]) if hand == LEFT else (both[0], value)


def running(build: Build, manner: Manner, phase: float, speed: float) -> Pose:
    """Running at ``phase`` strides: knees high, heels up behind, bent arms that swing, and a flight between steps."""
    effort = min(speed / 3.5, 1.3)
    hip, knee, ankle = zip(*(_running_leg(phase + 0.5 * k, effort) for k in (0, 1)), strict=True)
    beat = math.cos(2 * math.pi * phase)
    swing = 0.75 * effort
    return Pose(
        lean=manner.lean + 0.16 * effort,
        twist=-0.2 * beat,
        look=0.17 * beat,
        shoulder=(-swing * beat - 0.1, swing * beat - 0.1),
        spread=(0.15, 0.15),
        elbow=(1.5, 1.5),
        inward=(0.35, 0.35),
        hip=hip,
        knee=knee,
        ankle=ankle,
        lift=0.05 * build.height * effort * abs(math.sin(2 * math.pi * phase)),
    )


def _running_leg(phase: float, effort: float) -> tuple[float, float, float]:
    """Hip, knee and ankle of the leg whose foot strikes at ``phase`` zero."""
    angle = 2 * math.pi * phase
    hip = 0.25 + 0.7 * effort * math.cos(angle)
    knee = 0.35 + 1.35 * effort * max(math.sin(angle + math.pi + 0.4), 0.0) ** 1.5
    return hip, knee, 0.2 * math.cos(angle) - 0.25


def sitting(rng: np.random.Generator, on_ground: bool) -> Pose:
    """Somebody who sits on a bench of 0.45 m, or on the ground with the legs out."""
    knees = rng.normal(0, 0.12, 2)
    if on_ground:
        bent = rng.uniform(0.15, 1.5, 2)
        # A bent knee stands up: thigh and shank make a triangle over the ground.
        return Pose(
            lean=float(rng.uniform(-0.25, 0.25)),
            nod=float(rng.uniform(0.0, 0.3)),
            shoulder=pair(rng.uniform(0.1, 0.7, 2)),
            spread=(0.2, 0.2),
            elbow=(0.5, 0.5),
            hip=pair(1.5 + 0.5 * bent),
            knee=pair(bent),
            straddle=(0.15, 0.15),
        )
    return Pose(
        lean=float(rng.uniform(-0.15, 0.2)),
        nod=float(rng.uniform(0.0, 0.3)),
        shoulder=(0.45, 0.45),
        spread=(0.08, 0.08),
        elbow=(0.8, 0.8),
        inward=(0.3, 0.3),
        hip=pair(1.5 + knees),
        knee=(1.45, 1.45),
        straddle=(0.12, 0.12),
    )


def lying(rng: np.random.Generator, build: Build) -> Pose:
    """Somebody who lies on the back or on the belly, one leg perhaps drawn up."""
    spread, apart, quarter = pair(rng.uniform(0.1, 1.2, 2)), pair(rng.uniform(0.03, 0.25, 2)), math.pi / 2
    if rng.random() < 0.65:
        drawn = float(rng.uniform(0, 1.6)) if rng.random() < 0.4 else 0.0
        # The leg that stays stretched is the lower one, so the body rests on it.
        return Pose(
            lean=-quarter, nod=-0.6 * quarter, spread=spread, elbow=(0.2, 0.3), hip=(quarter, quarter + 0.5 * drawn),
            knee=(0.0, drawn), straddle=apart, lift=0.035 * build.height,
        )  # fmt: skip
    return Pose(
        lean=quarter, nod=0.6 * quarter, look=float(rng.choice([-0.9, 0.9])), spread=spread, elbow=(0.4, 0.4),
        hip=(-quarter, -quarter), straddle=apart, ankle=(-0.9, -0.9), lift=0.01 * build.height,
    )  # fmt: skip


def reading(build: Build, pose: Pose) -> Pose:
    """A book before the chest, held by both hands, and eyes on it."""
    for hand in (LEFT, RIGHT):
        pose = reach(build, pose, hand, (0.17 * build.height, -0.045 * build.height, -0.11 * build.height))
    return replace(pose, nod=0.6, look=0.0, twist=0.0)


def calling(build: Build, pose: Pose, hand: int) -> Pose:
    """A hand at the ear; the head leans towards it."""
    h = build.height
    at_ear = (0.035 * h, -0.055 * h, 0.11 * h)
    side = SIDES[hand]
    return replace(reach(build, pose, hand, at_ear, swivel=0.7), look=0.15 * side, sway=pose.sway + 0.03 * side)


def drinking(build: Build, pose: Pose, hand: int, seconds: float) -> Pose:
    """A bottle that goes up to the mouth and down again, once every few seconds."""
    raised = sip(seconds)
    h = build.height
    low, high = np.array([0.12, -0.02, -0.2]) * h, np.array([0.085, -0.09, 0.1]) * h
    held = reach(build, pose, hand, low + raised * (high - low), swivel=0.4 + 0.5 * raised)
    return replace(held, nod=pose.nod * (1 - raised) - 0.35 * raised)


def sip(seconds: float) -> float:
    """How far the bottle is raised, from 0 to 1."""
    up, held, down, rest = SIP
    t = seconds % (up + held + down + rest)
    rising = np.interp(t, [0, up, up + held, up + held + down], [0.0, 1.0, 1.0, 0.0])
    return float(0.5 - 0.5 * math.cos(math.pi * float(rising)))


def holding_before(build: Build, pose: Pose, forward: float, apart: float, height: float) -> Pose:
    """Both hands ``forward`` metres before the shoulders, ``apart`` from each other, at ``height`` over the ground.

    For what is pushed or carried before the body.
    """
    # The shoulders stand at about 0.82 of the height; walking lowers them a little.
    up = height - 0.8 * build.height
    aside = 0.5 * apart - 0.105 * build.height * build.shoulders
    for hand in (LEFT, RIGHT):
        pose = reach(build, pose, hand, (forward, aside, up))
    return replace(pose, twist=0.0)


def shaking_hands(build: Build, pose: Pose, seconds: float, distance: float) -> Pose:
    """The right hand held out to somebody ``distance`` metres away, going up and down."""
    rise = SHAKE_RISE * math.sin(2 * math.pi * SHAKE_RATE * seconds)
    shoulder = 0.105 * build.height * build.shoulders
    target = (0.5 * distance, -shoulder, 1.05 - 0.81 * build.height + rise)
    return replace(reach(build, pose, RIGHT, target), twist=0.1, look=0.0, nod=0.05)


def hugging(build: Build, pose: Pose, seconds: float) -> Pose:
    """Both arms about somebody who stands close before."""
    h = build.height
    rock = 0.05 * math.sin(2 * math.pi * 0.4 * seconds)
    pose = replace(pose, lean=0.12, sway=rock, nod=0.15, look=0.35, twist=0.0)
    pose = reach(build, pose, LEFT, (0.25 * h, -0.09 * h, -0.06 * h), swivel=1.2)
    return reach(build, pose, RIGHT, (0.25 * h, -0.08 * h, 0.0), swivel=1.3)


def pulling(build: Build, pose: Pose, hand: int) -> Pose:
    """An arm stretched back and down to what is pulled behind; the trunk leans into it."""
    h = build.height
    return replace(reach(build, pose, hand, (-0.2 * h, 0.03 * h, -0.3 * h), swivel=0.2), lean=pose.lean + 0.12)


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
        return self.posture in (act.WALKING, act.RUNNING)


WALK, STAND = Activity(act.WALKING), Activity(act.STANDING)
SIT, LIE = Activity(act.SITTING, seconds=(4, 10)), Activity(act.LYING, seconds=(4, 10))
ACTIVITIES = (
    WALK,
    STAND,
    SIT,
    LIE,
    Activity(act.RUNNING, weight=1.5),
    Activity(act.STANDING, act.READING, weight=0.5),
    Activity(act.SITTING, act.READING, (4, 10), 0.6),
    Activity(act.STANDING, act.DRINKING, weight=0.5),
    Activity(act.SITTING, act.DRINKING, (4, 8), 0.3),
    Activity(act.WALKING, act.DRINKING, weight=0.3),
    Activity(act.STANDING, act.CALLING, weight=0.5),
    Activity(act.WALKING, act.CALLING, weight=0.5),
    Activity(act.WALKING, act.PUSHING, (5, 12), 1.2),
    Activity(act.WALKING, act.CARRYING, (5, 12), 0.9),
    Activity(act.STANDING, act.CARRYING, (2, 4), 0.2),
    Activity(act.STANDING, act.HANDSHAKING, (2.5, 5), 1.2),
    Activity(act.STANDING, act.HUGGING, (2.5, 5), 1.2),
)
# What each action is done with; what stands on the ground must be fetched first.
HELD: dict[str, tuple[Kind, ...]] = {act.READING: ("book",), act.DRINKING: ("bottle",), act.CALLING: ("phone",)}
FETCHED: dict[str, tuple[Kind, ...]] = {act.PUSHING: ("cart", "suitcase"), act.CARRYING: ("crate",)}
# Metres between two people.
APART = {act.HANDSHAKING: 0.95, act.HUGGING: 0.42}
# Metres from the person's middle to that of what was fetched, forward.
AHEAD: dict[Kind, float] = {"cart": CART_AHEAD, "suitcase": -SUITCASE_BEHIND, "crate": CRATE_AHEAD}


def resting_pose(rng: np.random.Generator, activity: Activity, person: Person, on_bench: bool) -> Pose:
    """The posture under an activity, as this person takes it this time."""
    if activity.posture == act.SITTING:
        return sitting(rng, not on_bench)
    if activity.posture == act.LYING:
        return lying(rng, person.build)
    return standing(rng, person.manner)


def stride_frequency(activity: Activity, person: Person, speed: float) -> float:
    """Strides a second at ``speed`` m/s."""
    if activity.posture == act.RUNNING:
        return 1.25 + 0.06 * speed
    return speed / stride_length(person.build, person.manner, speed)


def pose_of(
    activity: Activity, person: Person, rest: Pose, seconds: float, phase: float, speed: float, hand: int,
    prop: Prop | None,
) -> Pose:  # fmt: skip
    """The pose of ``person`` after ``seconds`` of an activity.

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
    if activity.posture == act.RUNNING:
        return running(build, person.manner, phase, speed)
    if activity.posture == act.WALKING:
        pose = walking(build, replace(person.manner, carry=(0.0, 0.0)), phase, speed)
    else:
        # A standing person still moves a little.
        pose = replace(rest, look=rest.look + 0.2 * math.sin(0.9 * seconds + 7 * phase), sway=rest.sway)
    if activity.act == act.READING:
        return reading(build, pose)
    if activity.act == act.DRINKING:
        return drinking(build, pose, hand, seconds)
    if activity.act == act.CALLING:
        return calling(build, pose, hand)
    if activity.act == act.HANDSHAKING:
        return shaking_hands(build, pose, seconds, APART[act.HANDSHAKING])
    if activity.act == act.HUGGING:
        return hugging(build, pose, seconds)
    if activity.act == act.CARRYING:
        return holding_before(build, replace(pose, lean=pose.lean - 0.08), 0.36, 0.5, 1.0)
    if activity.act == act.PUSHING and prop is not None:
        if prop.kind == "suitcase":
            return pulling(build, pose, hand)
        return holding_before(build, replace(pose, lean=pose.lean + 0.15), 0.42, 0.45, HANDLE_HEIGHT)
    return pose
