"""The solids of one dressed person: a skeleton fleshed out with tapered limbs, clothes, hair and bags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.scenes.people.body import Build, Pose, Skeleton, place
from tsuiseki.datamodules.scenes.people.gait import Manner, random_manner
from tsuiseki.datamodules.scenes.people.look import Colour, Look, random_build, random_look
from tsuiseki.datamodules.scenes.render.solids import (
    HEAD,
    NO_DETAIL,
    PELVIS,
    PLAIN,
    TRUNK,
    Solids,
    Surfaces,
    cone_spheres,
)
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class Person:
    """Somebody: proportions, clothes and a way to walk."""

    build: Build
    look: Look
    manner: Manner


def random_person(rng: np.random.Generator) -> Person:
    """Somebody drawn at random."""
    return Person(random_build(rng), random_look(rng), random_manner(rng))


class _Flesh:
    """Rows of cone-spheres while a person is put together; radii are fractions of the height."""

    def __init__(self, height: float, phase: float) -> None:
        self.height, self.phase = height, phase
        self.start: list[FloatArray] = []
        self.end: list[FloatArray] = []
        self.radius: list[tuple[float, float]] = []
        self.front: list[FloatArray] = []
        self.flat: list[float] = []
        self.surfaces = Surfaces()

    def add(
        self,
        start: FloatArray,
        end: FloatArray,
        radius: tuple[float, float],
        front: FloatArray,
        flat: float,
        colour: Colour,
        second: Colour | None = None,
        pattern: int = PLAIN,
        period: float = 0.1,
        relief: float = 0.14,
        detail: int = NO_DETAIL,
    ) -> None:
        self.start.append(start)
        self.end.append(end)
        self.radius.append((radius[0] * self.height, radius[1] * self.height))
        self.front.append(front)
        self.flat.append(flat)
        self.surfaces.add(colour, second, pattern, period, relief, detail, self.phase + 1.7 * len(self.start))

    def solids(self) -> Solids:
        return cone_spheres(
            np.array(self.start),
            np.array(self.end),
            np.array(self.radius),
            np.array(self.front),
            np.array(self.flat),
            self.surfaces,
        )


def person_solids(person: Person, pose: Pose, position: FloatArray, heading: float) -> Solids:
    """The solids of ``person`` in ``pose`` at ``position`` ``(2,)`` on the ground, facing ``heading`` radians."""
    skeleton = place(person.build, pose, position, heading)
    flesh = _Flesh(person.build.height, person.look.phase)
    _trunk(flesh, person, skeleton)
    _head(flesh, person, skeleton)
    for k in (0, 1):
        _arm(flesh, person, skeleton, k)
        _leg(flesh, person, skeleton, k)
    _skirt(flesh, person, skeleton)
    _bag(flesh, person, skeleton)
    return flesh.solids()


def _trunk(flesh: _Flesh, person: Person, s: Skeleton) -> None:
    build, look, h = person.build, person.look, person.build.height
    g = build.girth * look.thickness
    up, front = s.trunk_axes[:, 2], s.trunk_axes[:, 0]
    waist = s.pelvis + up * 0.10 * h
    upper = (look.upper, look.upper_second, look.upper_pattern, look.period)
    wide = 0.5 * (build.shoulders + g)
    chest = s.chest - up * 0.075 * h
    flesh.add(waist, chest, (0.078 * g, 0.094 * wide), front, 0.68, *upper, relief=0.16, detail=TRUNK)
    covered = look.lower_style == "coat" or look.thickness > 1.15
    half = s.pelvis_axes[:, 1] * 0.026 * h * build.hips
    hips = s.pelvis + s.pelvis_axes[:, 2] * (0.022 if covered else 0.03) * h
    thick = (0.070 if covered else 0.064) * g
    cloth = upper if covered else _lower(look)
    flesh.add(hips + half, hips - half, (thick, thick), s.pelvis_axes[:, 0], 0.9, *cloth, detail=PELVIS)
    tone = (look.shoulders, look.upper_second, look.upper_pattern, look.period)
    for k in (0, 1):
        flesh.add(s.chest - up * 0.012 * h, s.shoulder[k] - up * 0.006 * h, (0.05 * g, 0.034 * g), front, 0.9, *tone)
    neck = look.hat if look.hair_style == "hat" else look.skin
    flesh.add(s.chest, s.head - s.head_axes[:, 2] * 0.04 * h, (0.034, 0.03), front, 1.0, neck, relief=0.05)


def _lower(look: Look) -> tuple[Colour, Colour, int, float]:
    return look.lower, look.lower_second, look.lower_pattern, look.period


def _head(flesh: _Flesh, person: Person, s: Skeleton) -> None:
    look, h, size = person.look, person.build.height, person.build.head
    up, front = s.head_axes[:, 2], s.head_axes[:, 0]
    low, high = s.head - up * 0.023 * h * size, s.head + up * 0.021 * h * size
    style = look.hair_style
    # The hairline sits in the period of the head's surface: the height where hair begins at the temples.
    hairline = (0.016 if style == "hat" else 0.030) * h
    radius = (0.037 * size, 0.044 * size)
    flesh.add(low, high, radius, front, 1.2, look.skin, period=hairline, relief=0.06, detail=HEAD)
    back = s.head - front * 0.02 * h
    if style == "long":
        end = s.chest - front * 0.035 * h - s.trunk_axes[:, 2] * 0.02 * h
        flesh.add(back + up * 0.012 * h, end, (0.046 * size, 0.036), front, 0.8, look.hair, relief=0.3)
    elif style == "bun":
        bun = back - front * 0.03 * h + up * 0.025 * h
        flesh.add(bun, bun + up * 0.01 * h, (0.022, 0.018), front, 1.0, look.hair, relief=0.3)
    elif style == "thick":
        crown = s.head + up * 0.02 * h - front * 0.012 * h
        flesh.add(crown - up * 0.02 * h, crown, (0.045, 0.052), front, 1.05, look.hair, relief=0.4)
    elif style == "cap":
        flesh.add(high + front * 0.03 * h, high + front * 0.075 * h, (0.03, 0.028), up, 0.25, look.hat, relief=0.03)
    elif style == "hood":
        flesh.add(back - up * 0.03 * h, back + up * 0.022 * h, (0.05, 0.05), front, 1.1, look.upper, relief=0.2)


def _arm(flesh: _Flesh, person: Person, s: Skeleton, k: int) -> None:
    look, g, front = person.look, person.build.girth, s.trunk_axes[:, 0]
    sleeve = (look.shoulders, look.upper_second, look.upper_pattern, look.period)
    thick = g * look.thickness
    flesh.add(s.shoulder[k], s.elbow[k], (0.034 * thick, 0.027 * thick), front, 1.0, *sleeve)
    if look.long_sleeves:
        flesh.add(s.elbow[k], s.wrist[k], (0.027 * thick, 0.021 * thick), front, 1.0, *sleeve)
    else:
        flesh.add(s.elbow[k], s.wrist[k], (0.024 * g, 0.017 * g), front, 1.0, look.skin, relief=0.05)
    flesh.add(s.wrist[k], s.fingers[k], (0.019, 0.016), front, 1.0, look.skin, relief=0.05)


def _leg(flesh: _Flesh, person: Person, s: Skeleton, k: int) -> None:
    build, look, front = person.build, person.look, s.pelvis_axes[:, 0]
    g = build.girth
    bare = look.lower_style in ("shorts", "skirt")
    cloth = _lower(look)
    skin = (look.skin, look.skin, PLAIN, 0.1)
    thigh = skin if look.lower_style == "skirt" else cloth
    flesh.add(s.hip[k], s.knee[k], (0.056 * g, 0.036 * g), front, 1.0, *thigh)
    shin = (0.034 * g, 0.022 * g) if bare else (0.036 * g, 0.029 * g)
    flesh.add(s.knee[k], s.ankle[k], shin, front, 1.0, *(skin if bare else cloth))
    toe = s.toe[k]
    heel = s.ankle[k] + (s.ankle[k] - toe) * 0.2
    heel = heel - 0.018 * build.height * np.cross(_unit(toe - s.ankle[k]), s.pelvis_axes[:, 1]) * -1.0
    up = np.array([0.0, 0.0, 1.0])
    flesh.add(heel, toe, (0.026, 0.021), up, 0.9, look.shoes, relief=0.08)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


def _skirt(flesh: _Flesh, person: Person, s: Skeleton) -> None:
    style, look, h, g = person.look.lower_style, person.look, person.build.height, person.build.girth
    if style not in ("skirt", "long skirt", "coat"):
        return
    reach = {"skirt": 0.72, "long skirt": 1.25, "coat": 0.8}[style]
    cloth = (look.upper, look.upper_second, look.upper_pattern, look.period) if style == "coat" else _lower(look)
    front = s.pelvis_axes[:, 0]
    hems = []
    for k in (0, 1):
        beyond = s.ankle[k] - s.knee[k]
        thigh = s.knee[k] - s.hip[k]
        hem = s.hip[k] + thigh * min(reach, 1.0) + beyond * max(reach - 1.0, 0.0)
        hems.append(hem)
        flesh.add(s.hip[k], hem, (0.07 * g, 0.062), front, 1.0, *cloth)
    middle = (hems[0] + hems[1]) / 2
    flesh.add(s.pelvis - s.pelvis_axes[:, 2] * 0.02 * h, middle, (0.09 * g, 0.078), front, 0.8, *cloth)
    flesh.add(hems[0], hems[1], (0.055, 0.055), front, 1.0, *cloth)


def _bag(flesh: _Flesh, person: Person, s: Skeleton) -> None:
    look, h = person.look, person.build.height
    up, front, left = s.trunk_axes[:, 2], s.trunk_axes[:, 0], s.trunk_axes[:, 1]
    colour, phase = look.bag_colour, look.phase
    big = 0.85 + 0.4 * (phase % 1.0)
    if look.bag == "backpack":
        centre = s.chest - front * (0.062 + 0.04 * big) * h - up * 0.10 * h
        flesh.add(centre - up * 0.06 * h, centre + up * 0.045 * h, (0.085 * big, 0.07 * big), front, 0.55, colour)
    elif look.bag in ("shoulder", "cross"):
        hip = s.pelvis + look.side * left * 0.1 * h - up * 0.02 * h
        flesh.add(hip, hip + up * 0.05 * h, (0.055 * big, 0.045 * big), left, 0.5, colour)
    elif look.bag == "hand":
        hand = s.fingers[0 if look.side > 0 else 1]
        low = hand - np.array([0, 0, (0.06 + 0.08 * big) * h])
        flesh.add(low, low + np.array([0, 0, 0.05 * h]), (0.06 * big, 0.045 * big), left, 0.45, colour)
