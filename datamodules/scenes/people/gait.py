"""How people walk, run and stand: the pose at any moment of a stride."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.scenes.people.posture import Build, Pose, reach_for
from tsuiseki.datamodules.scenes.render.solids import Pair, pair

# Share of the stride for which a foot is on the ground.
STANCE = 0.6
# Share of the foot's way on the ground that lies before the hip.
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
    carry: Pair = (0.0, 0.0)
    stride: float = 1.0


def random_manner(rng: np.random.Generator) -> Manner:
    """Drawn at random; an arm in seven holds something and does not swing."""
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
    hip, knee = zip(*bends, strict=True)
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


def standing(rng: np.random.Generator, manner: Manner) -> Pose:
    """Somebody who stands, with some weight on one leg, and holds the arms in some way."""
    relaxed = float(rng.uniform(0.0, 0.35))
    knee = (relaxed, 0.02) if rng.random() < 0.5 else (0.02, relaxed)
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


def running(build: Build, manner: Manner, phase: float, speed: float) -> Pose:
    """Running at ``phase`` strides: knees high, heels up behind, bent arms that swing, and a flight between steps."""
    effort = min(speed / 3.5, 1.3)

    def leg(phase: float) -> tuple[float, float, float]:
        """Hip, knee and ankle of the leg whose foot strikes at ``phase`` zero."""
        angle = 2 * math.pi * phase
        knee = 0.35 + 1.35 * effort * max(math.sin(angle + math.pi + 0.4), 0.0) ** 1.5
        return 0.25 + 0.7 * effort * math.cos(angle), knee, 0.2 * math.cos(angle) - 0.25

    hip, knee, ankle = zip(leg(phase), leg(phase + 0.5), strict=True)
    beat, swing = math.cos(2 * math.pi * phase), 0.75 * effort
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
