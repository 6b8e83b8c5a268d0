"""Poses of people who neither stand nor walk: drawn within the ranges of joints, and balanced where feet carry them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tsuiseki.datamodules.scenes.people.gait import random_manner, running, walking
from tsuiseki.datamodules.scenes.people.posture import Build, Pose, balanced, hands_at, holding_before, reach, reach_for
from tsuiseki.datamodules.scenes.render.solids import Pair, pair

# Greatest angle that an ankle bends its toes up, radians; beyond it the heel leaves the ground.
_ANKLE = 0.6
# A right angle, radians.
_QUARTER = math.pi / 2
# An arm hangs, rests before the body, holds something or reaches up: up to which number it is drawn, how much it leans
# with the trunk, and the (least, greatest) angles that it is raised forward besides, and of the elbow.
_ARMS = (
    (0.3, 1.0, (-0.2, 0.3), (0.05, 0.5)),
    (0.7, 1.0, (0.2, 1.2), (0.1, 1.5)),
    (0.92, 0.0, (-0.1, 0.6), (1.0, 2.2)),
    (1.0, 0.0, (1.6, 2.8), (0.0, 1.0)),
)


# Poses of people in ordinary places that need no equipment, the commonest several times.
FREE = (
    *("sitting",) * 5, *("seated on the ground",) * 2, *("lying",) * 4, *("falling",) * 3, "crouching", "crouching",
    "kneeling", "kneeling", "bending", "bending",
)  # fmt: skip


def random_name(rng: np.random.Generator) -> str:
    """Drawn by how often people in view take each pose."""
    names, shares = list(_DRAWN), np.array([share for share, _ in _DRAWN.values()])
    return names[int(rng.choice(len(names), p=shares / shares.sum()))]


def draw_pose(seed: int, build: Build, name: str) -> Pose:
    """A pose of the kind ``name``, with a twist and a turn of the head of its own."""
    rng = np.random.default_rng(seed)
    pose = _DRAWN[name][1](rng, build)
    look, nod = float(rng.normal(0, 0.4)), pose.nod + float(rng.normal(0, 0.2))
    return replace(pose, twist=pose.twist + float(rng.normal(0, 0.15)), look=look, nod=nod)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


def _both(rng: np.random.Generator, low: float, high: float, unlike: float = 0.15) -> Pair:
    """A value for each side that differ by about ``unlike``."""
    return pair(np.clip(rng.uniform(low, high) + rng.normal(0, unlike, 2), low, high))


def _arms(rng: np.random.Generator, pose: Pose, forward: float) -> Pose:
    """``pose`` with arms that hang, rest before the body, hold something or reach up; the trunk leans ``forward``."""
    shoulder, elbow, inward = [], [], []
    for _ in range(2):
        kind = rng.random()
        _, leaning, raised, bent = next(row for row in _ARMS if kind < row[0])
        shoulder.append(leaning * forward + _between(rng, *raised))
        elbow.append(_between(rng, *bent))
        inward.append(_between(rng, 0.0, 0.6) * (elbow[-1] > 0.6))
    spread = _both(rng, 0.05, 0.5)
    return replace(pose, shoulder=pair(np.array(shoulder)), elbow=pair(np.array(elbow)), inward=pair(np.array(inward)),
                   spread=spread)  # fmt: skip


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
    spread, apart = pair(rng.uniform(0.1, 1.2, 2)), pair(rng.uniform(0.03, 0.25, 2))
    if rng.random() < 0.65:
        drawn = float(rng.uniform(0, 1.6)) if rng.random() < 0.4 else 0.0
        # The leg that stays stretched is the lower one, so the body rests on it.
        return Pose(
            lean=-_QUARTER, nod=-0.6 * _QUARTER, spread=spread, elbow=(0.2, 0.3), straddle=apart,
            hip=(_QUARTER, _QUARTER + 0.5 * drawn), knee=(0.0, drawn), lift=0.035 * build.height,
        )  # fmt: skip
    return Pose(
        lean=_QUARTER, nod=0.6 * _QUARTER, look=float(rng.choice([-0.9, 0.9])), spread=spread, elbow=(0.4, 0.4),
        hip=(-_QUARTER, -_QUARTER), straddle=apart, ankle=(-0.9, -0.9), lift=0.01 * build.height,
    )  # fmt: skip


def _sitting(rng: np.random.Generator, _: Build) -> Pose:
    pose = replace(sitting(rng, on_ground=False), straddle=_both(rng, 0.02, 0.4), knee=_both(rng, 0.9, 1.8))
    lean = _between(rng, -0.3, 0.6)
    return _arms(rng, replace(pose, lean=lean), lean)


def _on_the_ground(rng: np.random.Generator, _: Build) -> Pose:
    pose = sitting(rng, on_ground=True)
    return replace(_arms(rng, pose, pose.lean), straddle=_both(rng, 0.05, 0.5))


def _crouching(rng: np.random.Generator, build: Build) -> Pose:
    knee, pitch = _both(rng, 1.5, 2.5), _between(rng, 0.0, 0.5)
    hip = pair(np.array(knee) - _between(rng, 0.2, 0.7) + pitch)
    # Feet are flat on the ground, as far as ankles go.
    lean, ankle = _between(rng, 0.1, 0.8), pair(np.minimum(np.subtract(knee, hip), _ANKLE))
    pose = Pose(lean=lean, nod=-0.3 * lean, hip=hip, knee=knee, ankle=ankle, straddle=_both(rng, 0.05, 0.5))
    return balanced(build, _arms(rng, pose, lean))


def _kneeling(rng: np.random.Generator, _: Build) -> Pose:
    lean, straddle = _between(rng, -0.05, 0.9), _both(rng, 0.05, 0.3)
    if rng.random() < 0.45:
        # One foot is set before the other knee.
        hip, knee = (_between(rng, 1.2, 1.7), _between(rng, -0.1, 0.25)), (_between(rng, 1.3, 1.9), 1.6)
        ankle = (knee[0] - hip[0], -0.5)
        if rng.random() < 0.5:
            hip, knee, ankle = hip[::-1], knee[::-1], ankle[::-1]
    else:
        # Upright, or down on the heels.
        hip = _both(rng, -0.05, 1.1, 0.05)
        knee = (hip[0] + 1.5, hip[1] + 1.5)
        ankle = (-0.9, -0.9)
    pose = Pose(lean=lean, nod=0.2 - 0.3 * lean, hip=hip, knee=knee, ankle=ankle, straddle=straddle)
    return _arms(rng, pose, lean)


def _bending(rng: np.random.Generator, build: Build) -> Pose:
    pelvis, lean, knee = _between(rng, 0.1, 0.7), _between(rng, 0.4, 1.0), _both(rng, 0.02, 0.9)
    hip = pair(pelvis + 0.5 * np.array(knee))
    ankle = (knee[0] - 0.5 * knee[0], knee[1] - 0.5 * knee[1])
    straddle, tilt = _both(rng, 0.02, 0.35), (pelvis, 0.0)
    pose = Pose(lean=lean, nod=-0.3, hip=hip, knee=knee, ankle=ankle, straddle=straddle, tilt=tilt)
    return balanced(build, _arms(rng, pose, lean + pelvis))


def _lying(rng: np.random.Generator, _: Build) -> Pose:
    apart, elbow, side = _both(rng, 0.02, 0.4), _both(rng, 0.0, 1.6, 0.5), rng.random()
    drawn = rng.uniform(0.3, 1.2, 2) * (rng.random(2) < 0.35)
    tilt = _between(rng, -0.12, 0.12)
    if side < 0.45:
        # On the back: arms beside the body or over the head, knees drawn up now and then.
        return Pose(tilt=(-_QUARTER + tilt, tilt), nod=0.2, shoulder=_both(rng, 0.0, 0.5),
                    spread=_both(rng, 0.05, 2.6, 0.5), elbow=elbow, hip=pair(drawn), knee=pair(1.9 * drawn),
                    straddle=apart, ankle=(-0.4, -0.4))  # fmt: skip
    if side < 0.7:
        knee = rng.uniform(0, 1.5, 2) * (rng.random(2) < 0.2)
        return Pose(tilt=(_QUARTER + tilt, 0.0), nod=-0.2, look=float(rng.choice([-0.9, 0.9])), shoulder=(-0.05, -0.05),
                    spread=_both(rng, 0.1, 2.6, 0.5), elbow=(0.2, 0.2), knee=pair(knee), straddle=apart,
                    ankle=(-0.9, -0.9))  # fmt: skip
    hip = _both(rng, 0.0, 1.7, 0.35)
    roll = (_QUARTER + tilt) * float(rng.choice([-1, 1]))
    return Pose(tilt=(_between(rng, -0.4, 0.4), roll), nod=0.2, lean=_between(rng, -0.1, 0.6), spread=(0.1, 0.1),
                shoulder=_both(rng, 0.0, 2.0, 0.4), elbow=elbow, hip=hip, knee=_both(rng, 0.1, 2.1, 0.3),
                straddle=(0.05, 0.05))  # fmt: skip


def _falling(rng: np.random.Generator, _: Build) -> Pose:
    towards, tilt = _between(rng, 0, 2 * math.pi), _between(rng, 0.35, 1.4)
    return Pose(
        lean=_between(rng, -0.2, 0.7), nod=_between(rng, -0.3, 0.4), shoulder=pair(rng.uniform(-0.6, 2.5, 2)),
        spread=pair(rng.uniform(0, 1.3, 2)), elbow=pair(rng.uniform(0, 1.7, 2)), hip=pair(rng.uniform(-0.4, 1.4, 2)),
        knee=pair(rng.uniform(0, 1.7, 2)), straddle=_both(rng, 0, 0.5),
        tilt=(tilt * math.cos(towards), tilt * math.sin(towards)),
    )  # fmt: skip


def _jumping(rng: np.random.Generator, build: Build) -> Pose:
    hip = _both(rng, -0.2, 1.3, 0.4)
    return Pose(
        lean=_between(rng, -0.1, 0.5), hip=hip, knee=_both(rng, 0.2, 1.8, 0.3), ankle=(-0.6, -0.6),
        straddle=_both(rng, 0.02, 0.5), shoulder=_both(rng, -0.5, 2.9, 0.3), spread=_both(rng, 0.1, 1.2),
        elbow=_both(rng, 0.1, 1.5, 0.3), lift=0.15 * build.height,
    )  # fmt: skip


def _running(rng: np.random.Generator, build: Build) -> Pose:
    return running(build, random_manner(rng), float(rng.random()), _between(rng, 2.2, 4.5))


def _carrying(rng: np.random.Generator, build: Build) -> Pose:
    """Hands before the body, as on a trolley or a box."""
    pose = walking(build, random_manner(rng), float(rng.random()), _between(rng, 0.3, 1.3))
    ahead, high = _between(rng, 0.3, 0.5), _between(rng, 0.5, 0.68) * build.height
    return holding_before(build, replace(pose, lean=pose.lean + _between(rng, -0.1, 0.25)), ahead, 0.45, high)


def _cycling(rng: np.random.Generator, build: Build) -> Pose:
    """Hands on a handlebar, a foot on each pedal."""
    lean, turned, crank = _between(rng, 0.15, 0.85), _between(rng, 0, 2 * math.pi), 0.097 * build.height
    legs = []
    for half in (0.0, math.pi):
        ahead = 0.09 * build.height + crank * math.sin(turned + half)
        down = 0.37 * build.height + crank * math.cos(turned + half)
        legs.append(reach_for(build, ahead, down))
    hip, knee = (pair(np.array(of_legs)) for of_legs in zip(*legs, strict=True))
    straddle = _both(rng, 0.0, 0.12, 0.03)
    ankle = pair(np.clip(np.array(knee) - hip + rng.normal(0, 0.15, 2), -_ANKLE, _ANKLE))
    pose = Pose(lean=lean, nod=-0.4 * lean, hip=hip, knee=knee, straddle=straddle, ankle=ankle)
    return hands_at(build, pose, 0.36 * build.height + 0.12 * lean, _between(rng, 0.4, 0.56), 0.13 * build.height)


def _in_wheelchair(rng: np.random.Generator, build: Build) -> Pose:
    lean = _between(rng, -0.15, 0.2)
    pose = Pose(lean=lean, nod=_between(rng, 0, 0.3), hip=_both(rng, 1.4, 1.6, 0.03), knee=_both(rng, 1.2, 1.5, 0.05),
                straddle=_both(rng, 0.05, 0.2, 0.03))  # fmt: skip
    if rng.random() < 0.4:
        return _arms(rng, pose, lean + 0.3)
    return hands_at(build, pose, _between(rng, -0.05, 0.2), 0.64, _between(rng, 0.0, 0.1))


def _pushing(rng: np.random.Generator, build: Build) -> Pose:
    pose = walking(build, random_manner(rng), float(rng.random()), _between(rng, 0.3, 1.3))
    high = _between(rng, 0.95, 1.08)
    return holding_before(build, replace(pose, lean=pose.lean + _between(rng, 0, 0.15)), 0.42, 0.4, high)


def _under_umbrella(rng: np.random.Generator, build: Build) -> Pose:
    pose = walking(build, random_manner(rng), float(rng.random()), _between(rng, 0.3, 1.4))
    target = (_between(rng, 0.12, 0.25), _between(rng, -0.14, 0.0), _between(rng, -0.18, 0.02))
    return reach(build, pose, int(rng.integers(2)), target)


# How often each is drawn, relatively, and how; `equipment` makes what the last four need.
_DRAWN: dict[str, tuple[float, Callable[[np.random.Generator, Build], Pose]]] = {
    "sitting": (0.14, _sitting), "seated on the ground": (0.06, _on_the_ground), "crouching": (0.14, _crouching),
    "kneeling": (0.1, _kneeling), "bending": (0.14, _bending), "lying": (0.18, _lying), "falling": (0.1, _falling),
    "jumping": (0.05, _jumping), "running": (0.05, _running), "carrying": (0.04, _carrying),
    "cycling": (0.08, _cycling), "in a wheelchair": (0.04, _in_wheelchair), "pushing a pram": (0.04, _pushing),
    "under an umbrella": (0.05, _under_umbrella),
}  # fmt: skip
