"""The articulated person: proportions, joint angles, and the joints they put into space.

A body's own axes are x forward, y to its left, z up. Lengths of the segments as fractions of the height follow
Drillis and Contini, *Body Segment Parameters*, 1966.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from tsuiseki.tracking.types import FloatArray

ANKLE_HEIGHT = 0.039
UPPER_ARM = 0.186
FOREARM = 0.146
HAND = 0.08
FOOT = 0.152
SHOULDER_ABOVE_HIP = 0.288
HEAD_ABOVE_SHOULDER = 0.052
SIDES = (1.0, -1.0)

Pair = tuple[float, float]


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


def blend(a: Pose, b: Pose, part: float) -> Pose:
    """The pose ``part`` of the way from ``a`` to ``b``, angle by angle."""
    values: dict[str, float | Pair] = {}
    for name in (f.name for f in fields(Pose)):
        x, y = getattr(a, name), getattr(b, name)
        if isinstance(x, tuple):
            values[name] = (x[0] + part * (y[0] - x[0]), x[1] + part * (y[1] - x[1]))
        else:
            values[name] = x + part * (y - x)
    return Pose(**values)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Skeleton:
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
    return np.array(
        [
            math.sin(forward) * math.cos(sideways),
            side * math.sin(sideways),
            -math.cos(forward) * math.cos(sideways),
        ]
    )


def place(build: Build, pose: Pose, position: FloatArray, heading: float) -> Skeleton:
    """The joints of a person in ``pose`` who stands at ``position`` ``(2,)`` and faces ``heading``.

    The lower foot rests on the ground z = 0, raised by ``pose.lift``.
    """
    height = build.height
    pelvis_axes = turn(heading)
    trunk_axes = turn(heading + pose.twist, pose.lean, -pose.sway)
    head_axes = turn(heading + pose.twist + pose.look, 0.4 * pose.lean + pose.nod)
    trunk = height * (SHOULDER_ABOVE_HIP + 0.491 * (1 - build.legs))
    chest = trunk_axes[:, 2] * trunk
    head = chest + trunk_axes[:, 2] * HEAD_ABOVE_SHOULDER * height + head_axes[:, 2] * 0.065 * height * build.head
    limbs = [_limbs(build, pose, k, chest, pelvis_axes, trunk_axes) for k in (0, 1)]
    shoulder, elbow, wrist, fingers, hip, knee, ankle, toe = (np.stack(pair) for pair in zip(*limbs, strict=True))
    rest = min(ankle[:, 2].min() - ANKLE_HEIGHT * height, toe[:, 2].min() - 0.016 * height)
    root = np.array([position[0], position[1], pose.lift - rest])
    return Skeleton(
        pelvis=root,
        chest=chest + root,
        head=head + root,
        shoulder=shoulder + root,
        elbow=elbow + root,
        wrist=wrist + root,
        fingers=fingers + root,
        hip=hip + root,
        knee=knee + root,
        ankle=ankle + root,
        toe=toe + root,
        pelvis_axes=pelvis_axes,
        trunk_axes=trunk_axes,
        head_axes=head_axes,
    )


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
