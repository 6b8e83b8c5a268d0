"""The actions that drones film: the twelve of Okutama-Action, and what people act with: books, carts, benches.

Hands are led to where the action wants them by two-link inverse kinematics; the rest of the pose comes from the gait or
from a fixed posture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tsuiseki.datamodules.scenes.people.gait import running, standing, walking
from tsuiseki.datamodules.scenes.people.outfit import BRIGHT, DARK, LIGHT, MIDDLE
from tsuiseki.datamodules.scenes.people.person import Person
from tsuiseki.datamodules.scenes.people.poses import lying, sitting
from tsuiseki.datamodules.scenes.people.posture import (
    LEFT,
    RIGHT,
    SIDES,
    Build,
    PersonSkeleton,
    Pose,
    holding_before,
    reach,
    unit,
)
from tsuiseki.datamodules.scenes.render.composing import Thing
from tsuiseki.datamodules.scenes.render.solids import UP, Colour, Parts, Pattern, Surface, across
from tsuiseki.tracking.formats import acting_tracks as act
from tsuiseki.tracking.types import FloatArray

Kind = Literal["book", "phone", "bottle", "cart", "suitcase", "crate", "bench"]
# Of a bench over the ground, metres.
SEAT_HEIGHT = 0.45
# From a person's middle ahead to the middle of the cart, metres.
CART_AHEAD = 0.95
# From a person's middle back to the middle of the suitcase, metres.
SUITCASE_BEHIND = 0.75
# From a person's middle ahead to the middle of the crate, metres.
CRATE_AHEAD = 0.42
# Of the cart's handle over the ground, metres.
HANDLE_HEIGHT = 1.0
# Of the hands that carry a crate over the ground, metres.
CRATE_HEIGHT = 1.0


# Colours that each thing comes in.
PALETTES: dict[Kind, tuple[Colour, ...]] = {
    "book": LIGHT,
    "phone": DARK,
    "bottle": LIGHT + BRIGHT,
    "cart": LIGHT[:2] + BRIGHT[:4],
    "suitcase": DARK + BRIGHT,
    "crate": (*MIDDLE, (0.62, 0.47, 0.30), (0.70, 0.56, 0.38)),
    "bench": MIDDLE + DARK,
}


class Prop:
    """One thing of a ``kind``.

    Attributes:
        colour: sRGB.
        second: another colour of it.
        size: relative to the usual.
        ahead: metres from a person's middle to that of what was fetched, forward; 0 for what is held or stands.
    """

    def __init__(self, rng: np.random.Generator, kind: Kind) -> None:
        self.kind, self.ahead, palette = kind, AHEAD.get(kind, 0.0), PALETTES[kind]
        self.colour, self.second = (palette[int(rng.integers(len(palette)))] for _ in range(2))
        self.size = float(rng.uniform(0.85, 1.2))


def in_hand(prop: Prop, skeleton: PersonSkeleton, hand: int) -> Thing:
    """A book, phone or bottle where the hands of ``skeleton`` hold it."""
    palms, ahead, up = 0.5 * (skeleton.wrist + skeleton.fingers), skeleton.trunk_axes[:, 0], skeleton.head_axes[:, 2]
    palm, parts = palms[hand], Parts(yaw=float(np.arctan2(ahead[1], ahead[0])))
    if prop.kind == "book":
        middle, size = palms.mean(axis=0) + 0.05 * ahead, np.array([0.16, 0.12, 0.02]) * prop.size
        left = skeleton.trunk_axes[:, 1] * 0.13 * prop.size
        parts.box(middle + left, size, Surface(prop.colour, relief=0.05))
        parts.box(middle - left, size, Surface(prop.second, relief=0.02))
    elif prop.kind == "phone":
        parts.cone(palm - 0.05 * up, palm + 0.06 * up, (0.035, 0.035), Surface(prop.colour, relief=0.02))
    else:
        towards = unit(skeleton.head - palm)
        # A bottle stands in a low hand and tips towards the mouth in a raised one.
        raised = float(np.clip((palm[2] - skeleton.chest[2]) / 0.15 + 0.5, 0, 1))
        axis = (1 - raised) * UP + raised * (towards + np.array([0, 0, -0.15]))
        axis = axis / np.linalg.norm(axis)
        foot, neck = palm - 0.12 * prop.size * axis, palm + 0.1 * prop.size * axis
        parts.cone(foot, neck, (0.05, 0.045), Surface(prop.colour, relief=0.05))
        parts.cone(neck, neck + 0.06 * axis, (0.025, 0.02), Surface(prop.second, relief=0.05))
    return Thing(parts.solids())


def standing_prop(prop: Prop, position: FloatArray, yaw: float, lift: float = 0.0) -> Thing:
    """A cart, suitcase, crate or bench with its middle at ``position`` ``(2,)``, turned by ``yaw``, ``lift`` m up."""
    parts = Parts(position, yaw, lift)
    {"cart": _cart, "suitcase": _suitcase, "crate": _crate, "bench": _bench}[prop.kind](parts, prop)
    return Thing(parts.solids())


def _cart(parts: Parts, prop: Prop) -> None:
    """A trolley: a tray with walls on wheels and a handle bar at its rear."""
    length, width = 0.42 * prop.size, 0.3 * prop.size
    wall, steel = Surface(prop.second, relief=0.05), Surface((0.15, 0.15, 0.16), relief=0.04)
    parts.box(parts.at(up=0.5), [length, width, 0.03], Surface(prop.colour, relief=0.05))
    for s in (1, -1):
        parts.box(parts.at(0.0, s * width, 0.62), [length, 0.02, 0.14], wall)
    parts.box(parts.at(length, 0.0, 0.62), [0.02, width, 0.14], wall)
    handle, rear = parts.at(0.5 - CART_AHEAD, 0.0, HANDLE_HEIGHT), parts.at(-length, 0.0, 0.55)
    aside = across(parts.yaw)
    parts.cone(handle - 0.28 * aside, handle + 0.28 * aside, (0.022, 0.022), steel)
    for s in (-1, 1):
        parts.cone(rear + s * 0.26 * aside, handle + s * 0.26 * aside, (0.018, 0.018), steel)
    for s in (-1, 1):
        for t in (-1, 1):
            hub = parts.at(s * 0.8 * length, t * 0.85 * width, 0.1)
            parts.cone(hub, hub + 0.35 * UP, (0.08, 0.02), steel)


def _suitcase(parts: Parts, prop: Prop) -> None:
    """A suitcase on wheels with its handle drawn out forward."""
    size, handle = prop.size, Surface((0.2, 0.2, 0.2), relief=0.03)
    shell = Surface(prop.colour, prop.second, Pattern.ACROSS, 0.12, 0.05)
    parts.box(parts.at(up=0.36 * size), np.array([0.14, 0.23, 0.32]) * size, shell)
    parts.cone(parts.at(up=0.65 * size), parts.at(SUITCASE_BEHIND - 0.35, 0.0, 0.78), (0.02, 0.02), handle)


def _crate(parts: Parts, prop: Prop) -> None:
    """A cardboard box with tape over its top."""
    half = np.array([0.2, 0.27, 0.17]) * prop.size
    parts.box(parts.at(up=half[2]), half, Surface(prop.colour, relief=0.06))
    parts.box(parts.at(up=half[2]) + half[2] * UP, [half[0], 0.04, 0.006], Surface(prop.second, relief=0.03))


def _bench(parts: Parts, prop: Prop) -> None:
    """A seat that faces ahead, its back and two feet."""
    wood, feet = Surface(prop.colour, relief=0.08), Surface(prop.second, relief=0.08)
    parts.box(parts.at(up=SEAT_HEIGHT - 0.06), [0.25, 0.85, 0.03], wood)
    parts.box(parts.at(-0.27, 0.0, 0.65), [0.03, 0.85, 0.2], wood)
    for s in (-1, 1):
        parts.box(parts.at(0.0, s * 0.7, 0.18), [0.22, 0.05, 0.18], feet)


# Seconds of one sip: the bottle goes up, stays at the mouth, goes down and stays there.
SIP = (0.6, 1.6, 0.6, 1.4)
# Beats of a handshake, a second.
SHAKE_RATE = 2.2
# Rise and fall of a handshake, metres.
SHAKE_RISE = 0.09


# What each action is done with; what stands on the ground must be fetched first.
HELD: dict[str, tuple[Kind, ...]] = {act.READING: ("book",), act.DRINKING: ("bottle",), act.CALLING: ("phone",)}
FETCHED: dict[str, tuple[Kind, ...]] = {act.PUSHING: ("cart", "suitcase"), act.CARRYING: ("crate",)}
# Metres between two people.
APART = {act.HANDSHAKING: 0.95, act.HUGGING: 0.42}
AHEAD: dict[Kind, float] = {"cart": CART_AHEAD, "suitcase": -SUITCASE_BEHIND, "crate": CRATE_AHEAD}


def drinking(build: Build, pose: Pose, hand: int, seconds: float) -> Pose:
    """A bottle that goes up to the mouth and down again, once every few seconds."""
    raised = sip(seconds)
    h = build.height
    low, high = np.array([0.12, -0.02, -0.2]) * h, np.array([0.085, -0.09, 0.1]) * h
    held = reach(build, pose, hand, low + raised * (high - low), swivel=0.4 + 0.5 * raised)
    return replace(held, nod=pose.nod * (1 - raised) - 0.35 * raised)


def sip(seconds: float) -> float:
    """How far the bottle is raised, from 0 to 1."""
    up, held, down, pause = SIP
    t = seconds % (up + held + down + pause)
    rising = np.interp(t, [0, up, up + held, up + held + down], [0.0, 1.0, 1.0, 0.0])
    return float(0.5 - 0.5 * math.cos(math.pi * float(rising)))


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

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """What it is done with, any of these."""
        return HELD.get(self.act or "", ()) or FETCHED.get(self.act or "", ())

    @property
    def fetching(self) -> bool:
        """Whether that stands on the ground and must be fetched first."""
        return self.act in FETCHED

    @property
    def apart(self) -> float:
        """Metres between the two people who do it; 0 where one does it alone."""
        return APART.get(self.act or "", 0.0)

    def resting_pose(self, rng: np.random.Generator, person: Person, on_bench: bool) -> Pose:
        """The posture under it, as this person takes it this time."""
        if self.posture == act.SITTING:
            return sitting(rng, not on_bench)
        return lying(rng, person.build) if self.posture == act.LYING else standing(rng, person.manner)

    def pose(
        self, person: Person, resting: Pose, seconds: float, phase: float, speed: float, hand: int, prop: Prop | None
    ) -> Pose:
        """The pose of ``person`` after ``seconds`` of it.

        Args:
            person: who does it.
            resting: see `resting_pose`.
            seconds: since it began.
            phase: of the gait, in strides.
            speed: m/s.
            hand: that holds what one hand holds.
            prop: what it is done with.
        """
        build, h = person.build, person.build.height
        if self.posture == act.RUNNING:
            return running(build, person.manner, phase, speed)
        if self.posture == act.WALKING:
            pose = walking(build, replace(person.manner, carry=(0.0, 0.0)), phase, speed)
        else:
            # A standing person still moves a little.
            pose = replace(resting, look=resting.look + 0.2 * math.sin(0.9 * seconds + 7 * phase))
        match self.act:
            case act.READING:
                # A book before the chest, held by both hands, and eyes on it.
                for arm in (LEFT, RIGHT):
                    pose = reach(build, pose, arm, (0.17 * h, -0.045 * h, -0.11 * h))
                return replace(pose, nod=0.6, look=0.0, twist=0.0)
            case act.DRINKING:
                return drinking(build, pose, hand, seconds)
            case act.CALLING:
                # A hand at the ear; the head leans towards it.
                side, calling = SIDES[hand], reach(build, pose, hand, (0.035 * h, -0.055 * h, 0.11 * h), swivel=0.7)
                return replace(calling, look=0.15 * side, sway=pose.sway + 0.03 * side)
            case act.HANDSHAKING:
                # The right hand held out to the other, going up and down.
                rise = SHAKE_RISE * math.sin(2 * math.pi * SHAKE_RATE * seconds)
                target = (0.5 * self.apart, -0.105 * h * build.shoulders, 1.05 - 0.81 * h + rise)
                return replace(reach(build, pose, RIGHT, target), twist=0.1, look=0.0, nod=0.05)
            case act.HUGGING:
                # Both arms about somebody who stands close before.
                rock = 0.05 * math.sin(2 * math.pi * 0.4 * seconds)
                pose = replace(pose, lean=0.12, sway=rock, nod=0.15, look=0.35, twist=0.0)
                pose = reach(build, pose, LEFT, (0.25 * h, -0.09 * h, -0.06 * h), swivel=1.2)
                return reach(build, pose, RIGHT, (0.25 * h, -0.08 * h, 0.0), swivel=1.3)
            case act.CARRYING:
                return holding_before(build, replace(pose, lean=pose.lean - 0.08), 0.36, 0.5, 1.0)
            case act.PUSHING if prop is not None and prop.kind == "suitcase":
                # An arm stretched back and down to what is pulled behind; the trunk leans into it.
                pulling = reach(build, pose, hand, (-0.2 * h, 0.03 * h, -0.3 * h), swivel=0.2)
                return replace(pulling, lean=pose.lean + 0.12)
            case act.PUSHING if prop is not None:
                return holding_before(build, replace(pose, lean=pose.lean + 0.15), 0.42, 0.45, HANDLE_HEIGHT)
        return pose


# What somebody does on the way to something else.
WALK = Activity(act.WALKING)
# What somebody does who waits.
STAND = Activity(act.STANDING)
# All that people do; lengths in seconds, and weights by which they are drawn.
ACTIVITIES = (
    WALK,
    STAND,
    Activity(act.SITTING, seconds=(4, 10)),
    Activity(act.LYING, seconds=(4, 10)),
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
