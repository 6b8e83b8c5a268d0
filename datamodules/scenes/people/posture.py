"""The articulated person: proportions, joint angles, and the joints they put into space.

A body's own axes are x forward, y to its left, z up. Lengths of the segments as fractions of the height follow
Drillis and Contini, *Body Segment Parameters*, 1966.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from tsuiseki.tracking.types import FloatArray

ANKLE_HEIGHT = 0.039
UPPER_ARM = 0.186
FOREARM = 0.146
HAND = 0.08
FOOT = 0.152
SHOULDER_ABOVE_HIP = 0.288
HEAD_ABOVE_SHOULDER = 0.052
# From a joint to the skin below it.
_THICK = 0.05
SIDES = (1.0, -1.0)

Pair = tuple[float, float]


def pair(values: FloatArray) -> Pair:
    """``(2,)`` of the left and right side."""
    left, right = values.tolist()
    return left, right


@dataclass(frozen=True)
class Build:
    """Proportions of one person.

    Attributes:
        height: metres, standing straight.
        girth: thickness of trunk and limbs relative to the average.
        shoulders: width relative to the average.
        hips: width relative to the average.
        legs: length relative to the average; the trunk makes up for it.
        head: size relative to the average.
    """

    height: float = 1.75
    girth: float = 1.0
    shoulders: float = 1.0
    hips: float = 1.0
    legs: float = 1.0
    head: float = 1.0

    @property
    def thigh(self) -> float:
        """Hip to knee, metres."""
        return 0.245 * self.height * self.legs

    @property
    def shank(self) -> float:
        """Knee to ankle, metres."""
        return 0.246 * self.height * self.legs


@dataclass(frozen=True)
class Pose:
    """Joint angles in radians, all zero for a person who stands straight with hanging arms; pairs are (left, right).

    Attributes:
        lean: of the trunk, forward.
        sway: of the trunk, to the left.
        twist: of the shoulders against the pelvis, to the left.
        nod: of the head, down.
        look: turn of the head, to the left.
        shoulder: arm raised forward.
        spread: arm raised sideways.
        elbow: bend, forward and up.
        inward: turn of the forearm across the body.
        hip: leg raised forward.
        straddle: leg raised sideways.
        knee: bend, backward.
        ankle: toes up.
        pitch: of the whole body, forward; a quarter turn for who lies on the belly.
        roll: of the whole body, its left side up.
        lift: of the whole body over the ground on which its lower foot rests, metres.
    """

    lean: float = 0.0
    sway: float = 0.0
    twist: float = 0.0
    nod: float = 0.0
    look: float = 0.0
    shoulder: Pair = (0.0, 0.0)
    spread: Pair = (0.0, 0.0)
    elbow: Pair = (0.0, 0.0)
    inward: Pair = (0.0, 0.0)
    hip: Pair = (0.0, 0.0)
    straddle: Pair = (0.0, 0.0)
    knee: Pair = (0.0, 0.0)
    ankle: Pair = (0.0, 0.0)
    lift: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0


def blend(a: Pose, b: Pose, part: float) -> Pose:
    """The pose ``part`` of the way from ``a`` to ``b``, angle by angle."""

    def between(x: Any, y: Any) -> Any:
        if isinstance(x, tuple):
            return tuple(between(*each) for each in zip(x, y, strict=True))
        return x + part * (y - x)

    return Pose(*(between(getattr(a, f.name), getattr(b, f.name)) for f in fields(Pose)))


@dataclass(frozen=True)
class PersonSkeleton:
    """Joints in the world, metres; each limb's row 0 is the left one, row 1 the right one.

    Attributes:
        pelvis: ``(3,)`` between the hips.
        chest: ``(3,)`` between the shoulders.
        head: ``(3,)`` centre of the head.
        shoulder, elbow, wrist, fingers, hip, knee, ankle, toe: ``(2, 3)``.
        pelvis_axes: ``(3, 3)`` columns forward, left, up.
        trunk_axes: ``(3, 3)`` likewise.
        head_axes: ``(3, 3)`` likewise.
    """

    pelvis: FloatArray
    chest: FloatArray
    head: FloatArray
    shoulder: FloatArray
    elbow: FloatArray
    wrist: FloatArray
    fingers: FloatArray
    hip: FloatArray
    knee: FloatArray
    ankle: FloatArray
    toe: FloatArray
    pelvis_axes: FloatArray
    trunk_axes: FloatArray
    head_axes: FloatArray


def turn(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> FloatArray:
    """``(3, 3)`` rotation: ``roll`` about x, then ``pitch`` about y (forward), then ``yaw`` about z."""
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (math.cos, math.sin))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return np.asarray(about_z @ about_y @ about_x)


def hanging(forward: float, sideways: float, side: float) -> FloatArray:
    """Unit vector of a limb that hangs down, raised by two angles; ``side`` is 1 for the left."""
    out = math.cos(sideways)
    return np.array([math.sin(forward) * out, side * math.sin(sideways), -math.cos(forward) * out])


def place(build: Build, pose: Pose, position: FloatArray, heading: float) -> PersonSkeleton:
    """The joints of a person in ``pose`` who stands at ``position`` ``(2,)`` and faces ``heading``.

    The lower foot rests on the ground z = 0, raised by ``pose.lift``; of a body that is pitched or rolled, the lowest
    joint does.
    """
    height = build.height
    pelvis_axes = turn(heading)
    trunk_axes = turn(heading + pose.twist, pose.lean, -pose.sway)
    head_axes = turn(heading + pose.twist + pose.look, 0.4 * pose.lean + pose.nod)
    trunk = height * (SHOULDER_ABOVE_HIP + 0.491 * (1 - build.legs))
    chest = trunk_axes[:, 2] * trunk
    head = chest + trunk_axes[:, 2] * HEAD_ABOVE_SHOULDER * height + head_axes[:, 2] * 0.065 * height * build.head
    limbs = [_limbs(build, pose, k, chest, pelvis_axes, trunk_axes) for k in (0, 1)]
    paired = [np.stack(pair) for pair in zip(*limbs, strict=True)]
    ankle, toe = paired[-2:]
    rest = min(ankle[:, 2].min() - ANKLE_HEIGHT * height, toe[:, 2].min() - 0.016 * height)
    bodies, axes = [chest, head, *paired], [pelvis_axes, trunk_axes, head_axes]
    if pose.pitch or pose.roll:
        whole = turn(heading, pose.pitch, pose.roll) @ turn(heading).T
        bodies, axes = [joint @ whole.T for joint in bodies], [whole @ each for each in axes]
        rest = min(0.0, *(float(joint[..., 2].min()) for joint in bodies)) - _THICK * height
    root = np.array([position[0], position[1], pose.lift - rest])
    return PersonSkeleton(*[root, *(joint + root for joint in bodies), *axes])


def _limbs(
    build: Build, pose: Pose, k: int, chest: FloatArray, pelvis_axes: FloatArray, trunk_axes: FloatArray
) -> tuple[FloatArray, ...]:
    side, height = SIDES[k], build.height
    shoulder = chest + trunk_axes @ np.array([0, side * 0.105 * height * build.shoulders, -0.01 * height])
    elbow = shoulder + trunk_axes @ hanging(pose.shoulder[k], pose.spread[k], side) * UPPER_ARM * height
    forearm = trunk_axes @ hanging(pose.shoulder[k] + pose.elbow[k], pose.spread[k] - pose.inward[k], side)
    wrist = elbow + forearm * FOREARM * height
    hip = pelvis_axes @ np.array([0, side * 0.052 * height * build.hips, 0])
    knee = hip + pelvis_axes @ hanging(pose.hip[k], pose.straddle[k], side) * build.thigh
    shin = pose.hip[k] - pose.knee[k]
    ankle = knee + pelvis_axes @ hanging(shin, pose.straddle[k], side) * build.shank
    pitch = shin + pose.ankle[k]
    toe = ankle + pelvis_axes @ np.array([math.cos(pitch), side * 0.12, math.sin(pitch)]) * 0.62 * FOOT * height
    toe = toe - pelvis_axes @ np.array([-math.sin(pitch), 0, math.cos(pitch)]) * 0.02 * height
    return shoulder, elbow, wrist, wrist + forearm * HAND * height, hip, knee, ankle, toe


# Share of the stride for which a foot is on the ground, and how much of its way then lies before the hip.
STANCE = 0.6
AHEAD = 0.42
# Metres per second under which strides get shorter instead of slower.
SHUFFLE = 0.5


@dataclass(frozen=True)
class Manner:
    """How one person walks and stands.

    Attributes:
        arm_swing: radians at 1.4 m/s.
        elbow: bend of the hanging arms, radians.
        lean: of the trunk, forward, radians.
        spread: of the arms, radians.
        carry: bend of (left, right) elbow that holds something; zero where the arm swings.
        stride: length relative to the average.
    """

    arm_swing: float = 0.4
    elbow: float = 0.25
    lean: float = 0.04
    spread: float = 0.1
    carry: tuple[float, float] = (0.0, 0.0)
    stride: float = 1.0


def random_manner(rng: np.random.Generator) -> Manner:
    """One person's manner."""
    holding = rng.random(2) < 0.15
    bend = rng.uniform(0.6, 1.9, 2)
    return Manner(
        arm_swing=float(rng.uniform(0.1, 0.65)),
        elbow=float(rng.uniform(0.05, 0.5)),
        lean=float(rng.normal(0.04, 0.05)),
        spread=float(rng.uniform(0.03, 0.2)),
        carry=pair(bend * holding),
        stride=float(rng.uniform(0.9, 1.1)),
    )


def stride_length(build: Build, manner: Manner, speed: float) -> float:
    """Metres between two steps of the same foot at ``speed`` m/s: faster people take longer strides."""
    hurry = min(speed / SHUFFLE, 1.0)
    return max(manner.stride * build.height * build.legs * (0.36 + 0.27 * min(speed, 2.0)) * hurry, 0.01)


def walking(build: Build, manner: Manner, phase: float, speed: float) -> Pose:
    """The pose at ``phase`` of the walk, in strides: it repeats at every integer, and the feet swap after a half."""
    feet = [_foot(build, stride_length(build, manner, speed), phase + 0.5 * k) for k in (0, 1)]
    # The hip rides as high as both legs allow.
    leg = 0.988 * (build.thigh + build.shank)
    hip_height = min(up + math.sqrt(max(leg**2 - forward**2, (0.5 * leg) ** 2)) for forward, up, _ in feet)
    bends = [reach_for(build, forward, hip_height - up) for forward, up, _ in feet]
    hip, knee = ((left, right) for left, right in zip(*bends, strict=True))
    ankle = (feet[0][2] - hip[0] + knee[0], feet[1][2] - hip[1] + knee[1])
    swing = manner.arm_swing * min(speed / 1.4, 1.5)
    beat = math.cos(2 * math.pi * (phase - 0.05))
    shoulders = (-swing * beat, swing * beat)
    elbows = tuple(manner.elbow + 0.5 * max(s, 0.0) for s in shoulders)
    carried = [c > 0 for c in manner.carry]
    return Pose(
        lean=manner.lean + 0.02 * speed,
        sway=0.025 * math.sin(2 * math.pi * phase),
        twist=-0.12 * min(speed, 1.5) * beat,
        look=0.1 * min(speed, 1.5) * beat,
        shoulder=(0.1 if carried[0] else shoulders[0], 0.1 if carried[1] else shoulders[1]),
        spread=(manner.spread, manner.spread),
        elbow=(manner.carry[0] or elbows[0], manner.carry[1] or elbows[1]),
        inward=(0.5 * manner.carry[0], 0.5 * manner.carry[1]),
        hip=hip,
        knee=knee,
        ankle=ankle,
    )


def _foot(build: Build, stride: float, phase: float) -> tuple[float, float, float]:
    """Metres of an ankle before the hip and over its place on a flat foot, and the foot's pitch, toes up.

    The heel of this foot strikes at ``phase`` zero.
    """
    phase = phase % 1.0
    reach = STANCE * stride
    if phase < STANCE:
        part = phase / STANCE
        rise = max((part - 0.6) / 0.4, 0.0) ** 2
        pitch = 0.25 * max(1 - part / 0.2, 0.0) - 0.75 * rise
        return reach * (AHEAD - part), 0.065 * build.height * rise, pitch
    part = (phase - STANCE) / (1 - STANCE)
    eased = part - math.sin(2 * math.pi * part) / (2 * math.pi)
    up = 0.065 * build.height * ((1 - part) ** 2 + 0.4 * math.sin(math.pi * part) ** 2)
    return reach * (eased + AHEAD - 1), up, -0.75 * (1 - part) ** 2 + 0.25 * part


def reach_for(build: Build, forward: float, down: float) -> tuple[float, float]:
    """Hip and knee angles that put the ankle ``forward`` and ``down`` metres from the hip (law of cosines)."""
    thigh, shank = build.thigh, build.shank
    distance = min(math.hypot(forward, down), 0.9999 * (thigh + shank))
    knee = math.pi - math.acos((thigh**2 + shank**2 - distance**2) / (2 * thigh * shank))
    lead = math.acos((thigh**2 + distance**2 - shank**2) / (2 * thigh * distance))
    return math.atan2(forward, down) + lead, knee


def standing(rng: np.random.Generator, manner: Manner) -> Pose:
    """Somebody who stands, with some weight on one leg, and holds the arms in some way."""
    relaxed = float(rng.uniform(0.0, 0.35))
    bent, free = (relaxed, 0.02), (0.02, relaxed)
    knee = bent if rng.random() < 0.5 else free
    hip = (0.5 * knee[0], 0.5 * knee[1])
    arms = rng.uniform(0.05, 0.4, 2)
    raised = rng.random(2) < 0.25
    elbow = np.where(raised, rng.uniform(0.8, 2.2, 2), arms)
    return Pose(
        lean=manner.lean,
        sway=float(rng.normal(0, 0.04)),
        twist=float(rng.normal(0, 0.15)),
        nod=float(rng.uniform(-0.1, 0.45)),
        look=float(rng.normal(0, 0.35)),
        shoulder=pair(rng.normal(0.05, 0.12, 2)),
        spread=(manner.spread, manner.spread),
        elbow=pair(elbow),
        inward=pair(0.7 * raised.astype(np.float64)),
        hip=hip,
        straddle=pair(rng.uniform(0.02, 0.12, 2)),
        knee=knee,
        ankle=(knee[0] - hip[0], knee[1] - hip[1]),
    )
