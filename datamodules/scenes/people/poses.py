"""Poses of people who neither stand nor walk: drawn within the ranges of joints, and balanced where feet carry them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tsuiseki.datamodules.scenes.people.activities import holding_before, reach, running, sitting
from tsuiseki.datamodules.scenes.people.posture import (
    SHOULDER_ABOVE_HIP,
    SIDES,
    Build,
    Pair,
    PersonSkeleton,
    Pose,
    pair,
    place,
    random_manner,
    walking,
)

# Share of the body's mass of head with trunk, and of each upper arm, forearm with hand, thigh, shank and foot
# (Winter, *Biomechanics and Motor Control of Human Movement*, 2009, table 4.1).
_TRUNK, _MASSES = 0.578, (0.028, 0.022, 0.1, 0.0465, 0.0145)
# Greatest angle that an ankle bends its toes up, radians; beyond it the heel leaves the ground.
_ANKLE = 0.6
_QUARTER = math.pi / 2


def random_name(rng: np.random.Generator) -> str:
    """One of the poses."""
    names, shares = list(_DRAWN), np.array([share for share, _ in _DRAWN.values()])
    return names[int(rng.choice(len(names), p=shares / shares.sum()))]


def draw_pose(seed: int, build: Build, name: str) -> Pose:
    """The pose of this name and seed."""
    rng = np.random.default_rng(seed)
    pose = _DRAWN[name][1](rng, build)
    look, nod = float(rng.normal(0, 0.4)), pose.nod + float(rng.normal(0, 0.2))
    return replace(pose, twist=pose.twist + float(rng.normal(0, 0.15)), look=look, nod=nod)


def mirrored(pose: Pose) -> Pose:
    """The pose with left and right swapped."""
    paired = ("shoulder", "spread", "elbow", "inward", "hip", "straddle", "knee", "ankle")
    swapped = {name: getattr(pose, name)[::-1] for name in paired}
    return replace(pose, sway=-pose.sway, twist=-pose.twist, look=-pose.look, roll=-pose.roll, **swapped)


def balanced(build: Build, pose: Pose) -> Pose:
    """``pose`` with its pelvis moved back or forward over flat feet, until the body's mass is above them."""

    def moved(by: float) -> Pose:
        hip = (pose.hip[0] + by, pose.hip[1] + by)
        return replace(pose, hip=hip, ankle=(pose.ankle[0] - by, pose.ankle[1] - by))

    low, high = -0.7, 0.7
    for _ in range(12):
        by = 0.5 * (low + high)
        ahead = _ahead(place(build, moved(by), np.zeros(2), 0.0))
        low, high = (by, high) if ahead > 0 else (low, by)
    return moved(by)


def _ahead(s: PersonSkeleton) -> float:
    """Metres by which the centre of mass of somebody who faces +x lies before the middle of the feet."""
    limbs = ((s.shoulder, s.elbow), (s.elbow, s.fingers), (s.hip, s.knee), (s.knee, s.ankle), (s.ankle, s.toe))
    mass = _TRUNK * 0.5 * (s.pelvis[0] + s.head[0])
    for share, (start, end) in zip(_MASSES, limbs, strict=True):
        mass += share * 0.5 * float(start[:, 0].sum() + end[:, 0].sum())
    return float(mass - 0.5 * (s.ankle[:, 0].mean() + s.toe[:, 0].mean()))


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


def _both(rng: np.random.Generator, low: float, high: float, unlike: float = 0.15) -> Pair:
    """A value for each side that differ by about ``unlike``."""
    return pair(np.clip(rng.uniform(low, high) + rng.normal(0, unlike, 2), low, high))


def _arms(rng: np.random.Generator, pose: Pose, forward: float) -> Pose:
    """``pose`` with arms that hang, rest before the body, hold something or reach up; the trunk leans ``forward``."""
    shoulder, elbow, inward = [], [], []
    for _ in SIDES:
        kind = rng.random()
        if kind < 0.3:
            shoulder.append(forward + _between(rng, -0.2, 0.3))
            elbow.append(_between(rng, 0.05, 0.5))
        elif kind < 0.7:
            shoulder.append(forward + _between(rng, 0.2, 1.2))
            elbow.append(_between(rng, 0.1, 1.5))
        elif kind < 0.92:
            shoulder.append(_between(rng, -0.1, 0.6))
            elbow.append(_between(rng, 1.0, 2.2))
        else:
            shoulder.append(_between(rng, 1.6, 2.8))
            elbow.append(_between(rng, 0.0, 1.0))
        inward.append(_between(rng, 0.0, 0.6) * (elbow[-1] > 0.6))
    spread = _both(rng, 0.05, 0.5)
    return replace(pose, shoulder=pair(np.array(shoulder)), elbow=pair(np.array(elbow)), inward=pair(np.array(inward)),
                   spread=spread)  # fmt: skip


def _flat(hip: Pair, knee: Pair) -> Pair:
    """Bends of ankles that put the feet flat on the ground, as far as ankles go."""
    left, right = (min(k - h, _ANKLE) for h, k in zip(hip, knee, strict=True))
    return left, right


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
    lean = _between(rng, 0.1, 0.8)
    pose = Pose(lean=lean, nod=-0.3 * lean, hip=hip, knee=knee, ankle=_flat(hip, knee), straddle=_both(rng, 0.05, 0.5))
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
    pose = Pose(lean=lean, nod=-0.3, hip=hip, knee=knee, ankle=ankle, straddle=_both(rng, 0.02, 0.35), pitch=pelvis)
    return balanced(build, _arms(rng, pose, lean + pelvis))


def _lying(rng: np.random.Generator, _: Build) -> Pose:
    apart, elbow, side = _both(rng, 0.02, 0.4), _both(rng, 0.0, 1.6, 0.5), rng.random()
    drawn = rng.uniform(0.3, 1.2, 2) * (rng.random(2) < 0.35)
    tilt = _between(rng, -0.12, 0.12)
    if side < 0.45:
        # On the back: arms beside the body or over the head, knees drawn up now and then.
        return Pose(pitch=-_QUARTER + tilt, nod=0.2, shoulder=_both(rng, 0.0, 0.5), spread=_both(rng, 0.05, 2.6, 0.5),
                    elbow=elbow, hip=pair(drawn), knee=pair(1.9 * drawn), straddle=apart, roll=tilt,
                    ankle=(-0.4, -0.4))  # fmt: skip
    if side < 0.7:
        knee = rng.uniform(0, 1.5, 2) * (rng.random(2) < 0.2)
        return Pose(pitch=_QUARTER + tilt, nod=-0.2, look=float(rng.choice([-0.9, 0.9])), shoulder=(-0.05, -0.05),
                    spread=_both(rng, 0.1, 2.6, 0.5), elbow=(0.2, 0.2), knee=pair(knee), straddle=apart,
                    ankle=(-0.9, -0.9))  # fmt: skip
    hip = _both(rng, 0.0, 1.7, 0.35)
    return Pose(roll=(_QUARTER + tilt) * float(rng.choice([-1, 1])), pitch=_between(rng, -0.4, 0.4), nod=0.2,
                lean=_between(rng, -0.1, 0.6), shoulder=_both(rng, 0.0, 2.0, 0.4), spread=(0.1, 0.1), elbow=elbow,
                hip=hip, knee=_both(rng, 0.1, 2.1, 0.3), straddle=(0.05, 0.05))  # fmt: skip


def _falling(rng: np.random.Generator, _: Build) -> Pose:
    towards, tilt = _between(rng, 0, 2 * math.pi), _between(rng, 0.35, 1.4)
    return Pose(
        lean=_between(rng, -0.2, 0.7), nod=_between(rng, -0.3, 0.4), pitch=tilt * math.cos(towards),
        roll=tilt * math.sin(towards), shoulder=pair(rng.uniform(-0.6, 2.5, 2)), spread=pair(rng.uniform(0, 1.3, 2)),
        elbow=pair(rng.uniform(0, 1.7, 2)), hip=pair(rng.uniform(-0.4, 1.4, 2)), knee=pair(rng.uniform(0, 1.7, 2)),
        straddle=_both(rng, 0, 0.5),
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
        legs.append(_stepping(build, ahead, down))
    hip, knee = (pair(np.array(each)) for each in zip(*legs, strict=True))
    straddle = _both(rng, 0.0, 0.12, 0.03)
    ankle = pair(np.clip(np.array(knee) - hip + rng.normal(0, 0.15, 2), -_ANKLE, _ANKLE))
    pose = Pose(lean=lean, nod=-0.4 * lean, hip=hip, knee=knee, straddle=straddle, ankle=ankle)
    return _hands_at(build, pose, 0.36 * build.height + 0.12 * lean, _between(rng, 0.4, 0.56), 0.13 * build.height)


def _in_wheelchair(rng: np.random.Generator, build: Build) -> Pose:
    lean = _between(rng, -0.15, 0.2)
    pose = Pose(lean=lean, nod=_between(rng, 0, 0.3), hip=_both(rng, 1.4, 1.6, 0.03), knee=_both(rng, 1.2, 1.5, 0.05),
                straddle=_both(rng, 0.05, 0.2, 0.03))  # fmt: skip
    if rng.random() < 0.4:
        return _arms(rng, pose, lean + 0.3)
    return _hands_at(build, pose, _between(rng, -0.05, 0.2), 0.64, _between(rng, 0.0, 0.1))


def _pushing(rng: np.random.Generator, build: Build) -> Pose:
    pose = walking(build, random_manner(rng), float(rng.random()), _between(rng, 0.3, 1.3))
    high = _between(rng, 0.95, 1.08)
    return holding_before(build, replace(pose, lean=pose.lean + _between(rng, 0, 0.15)), 0.42, 0.4, high)


def _under_umbrella(rng: np.random.Generator, build: Build) -> Pose:
    pose = walking(build, random_manner(rng), float(rng.random()), _between(rng, 0.3, 1.4))
    target = (_between(rng, 0.12, 0.25), _between(rng, -0.14, 0.0), _between(rng, -0.18, 0.02))
    return reach(build, pose, int(rng.integers(2)), target)


def _stepping(build: Build, ahead: float, down: float) -> tuple[float, float]:
    """Angles (hip, knee) that put an ankle ``ahead`` and ``down`` metres from its hip."""
    thigh, shank = build.thigh, build.shank
    far = float(np.clip(math.hypot(ahead, down), abs(thigh - shank) + 0.01, 0.999 * (thigh + shank)))
    bend = math.pi - math.acos((thigh**2 + shank**2 - far**2) / (2 * thigh * shank))
    return math.atan2(ahead, down) + math.acos((thigh**2 + far**2 - shank**2) / (2 * thigh * far)), bend


def _hands_at(build: Build, pose: Pose, forward: float, apart: float, above: float) -> Pose:
    """Both palms ``forward`` and ``above`` metres from the pelvis of who leans, ``apart`` from each other."""
    trunk = (SHOULDER_ABOVE_HIP - 0.01) * build.height
    x, z = forward - trunk * math.sin(pose.lean), above - trunk * math.cos(pose.lean)
    aside = 0.5 * apart - 0.105 * build.height * build.shoulders
    along = (
        x * math.cos(pose.lean) - z * math.sin(pose.lean),
        aside,
        x * math.sin(pose.lean) + z * math.cos(pose.lean),
    )
    for hand in (0, 1):
        pose = reach(build, pose, hand, along)
    return pose


# How often each is drawn, relatively, and how; `equipment` makes what the last four need.
_DRAWN: dict[str, tuple[float, Callable[[np.random.Generator, Build], Pose]]] = {
    "sitting": (0.14, _sitting), "seated on the ground": (0.06, _on_the_ground), "crouching": (0.14, _crouching),
    "kneeling": (0.1, _kneeling), "bending": (0.14, _bending), "lying": (0.18, _lying), "falling": (0.1, _falling),
    "jumping": (0.05, _jumping), "running": (0.05, _running), "carrying": (0.04, _carrying),
    "cycling": (0.08, _cycling), "in a wheelchair": (0.04, _in_wheelchair), "pushing a pram": (0.04, _pushing),
    "under an umbrella": (0.05, _under_umbrella),
}  # fmt: skip
