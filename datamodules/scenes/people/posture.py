"""The articulated person: proportions, joint angles, and the joints they put into space.

A body's own axes are x forward, y to its left, z up. Lengths of the segments as fractions of the height follow
Drillis and Contini, *Body Segment Parameters*, 1966.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.render.solids import Pair
from tsuiseki.tracking.types import FloatArray

# From the sole to the ankle, in body heights.
ANKLE_HEIGHT = 0.039
# From the shoulder to the elbow, in body heights.
UPPER_ARM = 0.186
# From the elbow to the wrist, in body heights.
FOREARM = 0.146
# From the wrist to the ends of the fingers, in body heights.
HAND = 0.08
# From the heel to the toes, in body heights.
FOOT = 0.152
# In body heights.
SHOULDER_ABOVE_HIP = 0.288
# From the shoulders to the bottom of the head, in body heights.
HEAD_ABOVE_SHOULDER = 0.052
# From a joint to the skin below it.
_THICK = 0.05
# Share of the body's mass of head with trunk (Winter, *Biomechanics and Motor Control of Human Movement*, 2009, table
# 4.1).
_TRUNK = 0.578
# Likewise of each upper arm, forearm with hand, thigh, shank and foot.
_MASSES = (0.028, 0.022, 0.1, 0.0465, 0.0145)
# Place of the left limb in pairs.
LEFT = 0
# Place of the right limb in pairs.
RIGHT = 1
# Sign of y of the left and the right limb: the body's own y axis points left.
SIDES = (1.0, -1.0)


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
        tilt: of the whole body: forward, a quarter turn for who lies on the belly; and its left side up.
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
    tilt: Pair = (0.0, 0.0)


def blend(a: Pose, b: Pose, part: float) -> Pose:
    """The pose ``part`` of the way from ``a`` to ``b``, angle by angle."""

    def between(x: Any, y: Any) -> Any:
        if isinstance(x, tuple):
            return tuple(between(*ends) for ends in zip(x, y, strict=True))
        return x + part * (y - x)

    return Pose(*(between(getattr(a, f.name), getattr(b, f.name)) for f in fields(Pose)))


def mirrored(pose: Pose) -> Pose:
    """The pose with left and right swapped."""
    paired = ("shoulder", "spread", "elbow", "inward", "hip", "straddle", "knee", "ankle")
    swapped = {name: getattr(pose, name)[::-1] for name in paired}
    return replace(
        pose, sway=-pose.sway, twist=-pose.twist, look=-pose.look, tilt=(pose.tilt[0], -pose.tilt[1]), **swapped
    )


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


class PersonSkeleton:
    """Joints of a person in ``pose`` who stands at ``position`` ``(2,)`` and faces ``heading``.

    They lie in the world, metres; each limb's row 0 is the left one, row 1 the right one. The lower foot rests on the
    ground z = 0, raised by ``pose.lift``; of a body that is tilted, the lowest joint does.

    Attributes:
        pelvis: ``(3,)`` between the hips.
        chest: ``(3,)`` between the shoulders.
        head: ``(3,)`` centre of the head.
        shoulder, elbow, wrist, fingers, hip, knee, ankle, toe: ``(2, 3)``.
        pelvis_axes: ``(3, 3)`` columns forward, left, up.
        trunk_axes: ``(3, 3)`` columns forward, left, up.
        head_axes: ``(3, 3)`` columns forward, left, up.
    """

    def __init__(self, build: Build, pose: Pose, position: FloatArray, heading: float) -> None:
        height = build.height
        pelvis_axes = turn(heading)
        trunk_axes = turn(heading + pose.twist, pose.lean, -pose.sway)
        head_axes = turn(heading + pose.twist + pose.look, 0.4 * pose.lean + pose.nod)
        trunk = height * (SHOULDER_ABOVE_HIP + 0.491 * (1 - build.legs))
        chest = trunk_axes[:, 2] * trunk
        head = chest + trunk_axes[:, 2] * HEAD_ABOVE_SHOULDER * height + head_axes[:, 2] * 0.065 * height * build.head
        limbs = []
        for k, side in enumerate(SIDES):
            shoulder = chest + trunk_axes @ np.array([0, side * 0.105 * height * build.shoulders, -0.01 * height])
            elbow = shoulder + trunk_axes @ hanging(pose.shoulder[k], pose.spread[k], side) * UPPER_ARM * height
            forearm = trunk_axes @ hanging(pose.shoulder[k] + pose.elbow[k], pose.spread[k] - pose.inward[k], side)
            wrist = elbow + forearm * FOREARM * height
            hip = pelvis_axes @ np.array([0, side * 0.052 * height * build.hips, 0])
            knee = hip + pelvis_axes @ hanging(pose.hip[k], pose.straddle[k], side) * build.thigh
            shin = pose.hip[k] - pose.knee[k]
            ankle = knee + pelvis_axes @ hanging(shin, pose.straddle[k], side) * build.shank
            cos, sin = math.cos(shin + pose.ankle[k]), math.sin(shin + pose.ankle[k])
            toe = ankle + pelvis_axes @ np.array([cos, side * 0.12, sin]) * 0.62 * FOOT * height
            toe = toe - pelvis_axes @ np.array([-sin, 0, cos]) * 0.02 * height
            limbs.append((shoulder, elbow, wrist, wrist + forearm * HAND * height, hip, knee, ankle, toe))
        paired = [np.stack(pair) for pair in zip(*limbs, strict=True)]
        ankle, toe = paired[-2:]
        floor = min(ankle[:, 2].min() - ANKLE_HEIGHT * height, toe[:, 2].min() - 0.016 * height)
        bodies, axes = [chest, head, *paired], [pelvis_axes, trunk_axes, head_axes]
        if any(pose.tilt):
            tilt = turn(heading, *pose.tilt) @ turn(heading).T
            bodies, axes = [joint @ tilt.T for joint in bodies], [tilt @ directions for directions in axes]
            floor = min(0.0, *(float(joint[..., 2].min()) for joint in bodies)) - _THICK * height
        self.pelvis = root = np.array([position[0], position[1], pose.lift - floor])
        self.chest, self.head, *limb = (joint + root for joint in bodies)
        self.shoulder, self.elbow, self.wrist, self.fingers, self.hip, self.knee, self.ankle, self.toe = limb
        self.pelvis_axes, self.trunk_axes, self.head_axes = axes


def reach_for(build: Build, forward: float, down: float) -> tuple[float, float]:
    """Hip and knee angles that put the ankle ``forward`` and ``down`` metres from the hip (law of cosines)."""
    thigh, shank = build.thigh, build.shank
    distance = min(math.hypot(forward, down), 0.9999 * (thigh + shank))
    knee = math.pi - math.acos((thigh**2 + shank**2 - distance**2) / (2 * thigh * shank))
    lead = math.acos((thigh**2 + distance**2 - shank**2) / (2 * thigh * distance))
    return math.atan2(forward, down) + lead, knee


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
    forward = unit(aim)
    # The elbow lies on a circle about the line to the target; it hangs down and out.
    down = np.array([-0.15, math.sin(swivel), -math.cos(swivel)])
    side = unit(down - (down @ forward) * forward)
    along = (upper**2 + distance**2 - lower**2) / (2 * distance)
    elbow = along * forward + math.sqrt(max(upper**2 - along**2, 0.0)) * side
    # The angles forward and sideways of limbs that hang along these directions; see `hanging`.
    (raised, spread), (bent, turned) = (
        (math.atan2(x, -z), math.asin(float(np.clip(y, -1, 1))))
        for x, y, z in (unit(elbow), unit(distance * forward - elbow))
    )
    # Forward of straight up and back of straight down are half a turn apart: keep the elbow bending forward.
    bend = (bent - raised + math.pi) % (2 * math.pi) - math.pi
    arm = {"shoulder": raised, "spread": spread, "elbow": bend, "inward": spread - turned}
    both: dict[str, Any] = {
        name: (angle, getattr(pose, name)[1 - hand])[:: 1 - 2 * hand] for name, angle in arm.items()
    }
    return replace(pose, **both)


def unit(vector: FloatArray) -> FloatArray:
    """The vector at length 1; nothing of one without a length."""
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))


def holding_before(build: Build, pose: Pose, forward: float, apart: float, height: float) -> Pose:
    """Both hands ``forward`` metres before the shoulders, ``apart`` from each other, at ``height`` over the ground.

    For what is pushed or carried before the body.
    """
    # The shoulders stand at about 0.82 of the height; walking lowers them a little.
    return replace(_both_reach(build, pose, forward, apart, height - 0.8 * build.height), twist=0.0)


def hands_at(build: Build, pose: Pose, forward: float, apart: float, above: float) -> Pose:
    """Both palms ``forward`` and ``above`` metres from the pelvis of who leans, ``apart`` from each other."""
    trunk = (SHOULDER_ABOVE_HIP - 0.01) * build.height
    x, z = forward - trunk * math.sin(pose.lean), above - trunk * math.cos(pose.lean)
    cos, sin = math.cos(pose.lean), math.sin(pose.lean)
    return _both_reach(build, pose, x * cos - z * sin, apart, x * sin + z * cos)


def _both_reach(build: Build, pose: Pose, forward: float, apart: float, up: float) -> Pose:
    """Both palms so far from the shoulders, in the trunk's axes, metres."""
    target = (forward, 0.5 * apart - 0.105 * build.height * build.shoulders, up)
    return reach(build, reach(build, pose, LEFT, target), RIGHT, target)


def balanced(build: Build, pose: Pose) -> Pose:
    """``pose`` with its pelvis moved back or forward over flat feet, until the body's mass is above them."""

    def moved(by: float) -> Pose:
        hip = (pose.hip[0] + by, pose.hip[1] + by)
        return replace(pose, hip=hip, ankle=(pose.ankle[0] - by, pose.ankle[1] - by))

    low, high = -0.7, 0.7
    for _ in range(12):
        by = 0.5 * (low + high)
        low, high = (by, high) if mass_ahead(PersonSkeleton(build, moved(by), np.zeros(2), 0.0)) > 0 else (low, by)
    return moved(by)


def mass_ahead(s: PersonSkeleton) -> float:
    """Metres by which the centre of mass of somebody who faces +x lies before the middle of the feet."""
    limbs = ((s.shoulder, s.elbow), (s.elbow, s.fingers), (s.hip, s.knee), (s.knee, s.ankle), (s.ankle, s.toe))
    mass = _TRUNK * 0.5 * (s.pelvis[0] + s.head[0])
    for share, (start, end) in zip(_MASSES, limbs, strict=True):
        mass += share * 0.5 * float(start[:, 0].sum() + end[:, 0].sum())
    return float(mass - 0.5 * (s.ankle[:, 0].mean() + s.toe[:, 0].mean()))
