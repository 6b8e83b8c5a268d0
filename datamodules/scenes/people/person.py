"""The solids of one dressed person: a skeleton fleshed out with tapered limbs, clothes, hair and bags."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.people.gait import Manner, random_manner, standing, walking
from tsuiseki.datamodules.scenes.people.outfit import Outfit, random_build, similar_outfit
from tsuiseki.datamodules.scenes.people.posture import Build, PersonSkeleton, Pose
from tsuiseki.datamodules.scenes.render.composing import Thing, drawn_alone
from tsuiseki.datamodules.scenes.render.shading import NOISE, NOISE_SIZE, Light, random_light
from tsuiseki.datamodules.scenes.render.solids import UP, Colour, Detail, Float32, Pair, Parts, Pattern, Surface
from tsuiseki.datamodules.scenes.render.tracing import overlap
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray


@dataclass(frozen=True)
class Person:
    """Somebody: proportions, clothes and a way to walk."""

    build: Build
    outfit: Outfit
    manner: Manner


def random_person(rng: np.random.Generator) -> Person:
    """Build, clothes and manner drawn at random."""
    return Person(random_build(rng), Outfit(rng), random_manner(rng))


def somebody(rng: np.random.Generator, others: Sequence[Person], look_alikes: float) -> Person:
    """Somebody who is dressed much like one of ``others`` with a chance of ``look_alikes``."""
    if not others or rng.random() >= look_alikes:
        return random_person(rng)
    model = others[int(rng.integers(len(others)))]
    return Person(random_build(rng), similar_outfit(rng, model.outfit), random_manner(rng))


class _Flesh(Parts):
    """Cone-spheres while a person is put together; radii are fractions of the height."""

    def __init__(self, person: Person) -> None:
        super().__init__()
        self.person, self.count = person, 0

    def add(
        self, start: FloatArray, end: FloatArray, radius: Pair, front: FloatArray, flat: float, *cloth: Any, **look: Any
    ) -> None:
        """One more with a `Surface` of its own phase."""
        self.count += 1
        height, phase = self.person.build.height, self.person.outfit.phase + 1.7 * self.count
        surface = Surface(*cloth, **{"relief": 0.14, "phase": phase, **look})
        self.cone(start, end, (radius[0] * height, radius[1] * height), surface, flat, front)


def person_thing(person: Person, pose: Pose, position: FloatArray, heading: float) -> Thing:
    """``person`` in ``pose`` at ``position`` ``(2,)`` on the ground, facing ``heading`` radians."""
    skeleton, flesh = PersonSkeleton(person.build, pose, position, heading), _Flesh(person)
    _trunk(flesh, person, skeleton)
    _head(flesh, person, skeleton)
    for k in (0, 1):
        _limbs(flesh, person, skeleton, k)
    _skirt(flesh, person, skeleton)
    _bag(flesh, person, skeleton)
    return Thing(flesh.solids(), person.outfit)


def _upper(outfit: Outfit) -> tuple[Colour, Colour, int, float]:
    return outfit.upper, outfit.upper_second, outfit.upper_pattern, outfit.period


def _lower(outfit: Outfit) -> tuple[Colour, Colour, int, float]:
    return outfit.lower, outfit.lower_second, outfit.lower_pattern, outfit.period


def _trunk(flesh: _Flesh, person: Person, s: PersonSkeleton) -> None:
    build, outfit, h = person.build, person.outfit, person.build.height
    g = build.girth * outfit.thickness
    up, front = s.trunk_axes[:, 2], s.trunk_axes[:, 0]
    waist = s.pelvis + up * 0.10 * h
    upper = _upper(outfit)
    wide = 0.5 * (build.shoulders + g)
    chest = s.chest - up * 0.075 * h
    flesh.add(waist, chest, (0.078 * g, 0.094 * wide), front, 0.68, *upper, relief=0.16, detail=Detail.TRUNK)
    covered = outfit.lower_style == "coat" or outfit.thickness > 1.15
    half = s.pelvis_axes[:, 1] * 0.026 * h * build.hips
    hips = s.pelvis + s.pelvis_axes[:, 2] * (0.022 if covered else 0.03) * h
    thick = (0.070 if covered else 0.064) * g
    cloth = upper if covered else _lower(outfit)
    flesh.add(hips + half, hips - half, (thick, thick), s.pelvis_axes[:, 0], 0.9, *cloth, detail=Detail.PELVIS)
    tone = (outfit.shoulders, *upper[1:])
    for k in (0, 1):
        flesh.add(s.chest - up * 0.012 * h, s.shoulder[k] - up * 0.006 * h, (0.05 * g, 0.034 * g), front, 0.9, *tone)
    neck = outfit.hat if outfit.hair_style == "hat" else outfit.skin
    flesh.add(s.chest, s.head - s.head_axes[:, 2] * 0.04 * h, (0.034, 0.03), front, 1.0, neck, relief=0.05)


def _head(flesh: _Flesh, person: Person, s: PersonSkeleton) -> None:
    outfit, h, size = person.outfit, person.build.height, person.build.head
    up, front = s.head_axes[:, 2], s.head_axes[:, 0]
    low, high = s.head - up * 0.023 * h * size, s.head + up * 0.021 * h * size
    style = outfit.hair_style
    # The hairline sits in the period of the head's surface: the height where hair begins at the temples.
    hairline = (0.016 if style == "hat" else 0.030) * h
    radius = (0.037 * size, 0.044 * size)
    flesh.add(low, high, radius, front, 1.2, outfit.skin, period=hairline, relief=0.06, detail=Detail.HEAD)
    back = s.head - front * 0.02 * h
    if style == "long":
        end = s.chest - front * 0.035 * h - s.trunk_axes[:, 2] * 0.02 * h
        flesh.add(back + up * 0.012 * h, end, (0.046 * size, 0.036), front, 0.8, outfit.hair, relief=0.3)
    elif style == "bun":
        bun = back - front * 0.03 * h + up * 0.025 * h
        flesh.add(bun, bun + up * 0.01 * h, (0.022, 0.018), front, 1.0, outfit.hair, relief=0.3)
    elif style == "thick":
        crown = s.head + up * 0.02 * h - front * 0.012 * h
        flesh.add(crown - up * 0.02 * h, crown, (0.045, 0.052), front, 1.05, outfit.hair, relief=0.4)
    elif style == "cap":
        flesh.add(high + front * 0.03 * h, high + front * 0.075 * h, (0.03, 0.028), up, 0.25, outfit.hat, relief=0.03)
    elif style == "hood":
        flesh.add(back - up * 0.03 * h, back + up * 0.022 * h, (0.05, 0.05), front, 1.1, outfit.upper, relief=0.2)


def _limbs(flesh: _Flesh, person: Person, s: PersonSkeleton, k: int) -> None:
    """An arm and a leg."""
    build, outfit, front, g = person.build, person.outfit, s.trunk_axes[:, 0], person.build.girth
    sleeve, thick = (outfit.shoulders, *_upper(outfit)[1:]), g * outfit.thickness
    flesh.add(s.shoulder[k], s.elbow[k], (0.034 * thick, 0.027 * thick), front, 1.0, *sleeve)
    if outfit.long_sleeves:
        flesh.add(s.elbow[k], s.wrist[k], (0.027 * thick, 0.021 * thick), front, 1.0, *sleeve)
    else:
        flesh.add(s.elbow[k], s.wrist[k], (0.024 * g, 0.017 * g), front, 1.0, outfit.skin, relief=0.05)
    flesh.add(s.wrist[k], s.fingers[k], (0.019, 0.016), front, 1.0, outfit.skin, relief=0.05)
    cloth, skin, front = _lower(outfit), (outfit.skin, outfit.skin, Pattern.PLAIN, 0.1), s.pelvis_axes[:, 0]
    thigh = skin if outfit.lower_style == "skirt" else cloth
    flesh.add(s.hip[k], s.knee[k], (0.056 * g, 0.036 * g), front, 1.0, *thigh)
    bare = outfit.lower_style in ("shorts", "skirt")
    shin = (0.034 * g, 0.022 * g) if bare else (0.036 * g, 0.029 * g)
    flesh.add(s.knee[k], s.ankle[k], shin, front, 1.0, *(skin if bare else cloth))
    ankle, toe = s.ankle[k], s.toe[k]
    step = (toe - ankle) / np.linalg.norm(toe - ankle)
    heel = ankle + (ankle - toe) * 0.2 + 0.018 * build.height * np.cross(step, s.pelvis_axes[:, 1])
    flesh.add(heel, toe, (0.026, 0.021), UP, 0.9, outfit.shoes, relief=0.08)


def _skirt(flesh: _Flesh, person: Person, s: PersonSkeleton) -> None:
    style, outfit, h, g = person.outfit.lower_style, person.outfit, person.build.height, person.build.girth
    if style not in ("skirt", "long skirt", "coat"):
        return
    reach = {"skirt": 0.72, "long skirt": 1.25, "coat": 0.8}[style]
    cloth, front = _upper(outfit) if style == "coat" else _lower(outfit), s.pelvis_axes[:, 0]
    hems = s.hip + (s.knee - s.hip) * min(reach, 1.0) + (s.ankle - s.knee) * max(reach - 1.0, 0.0)
    for hip, hem in zip(s.hip, hems, strict=True):
        flesh.add(hip, hem, (0.07 * g, 0.062), front, 1.0, *cloth)
    middle = (hems[0] + hems[1]) / 2
    flesh.add(s.pelvis - s.pelvis_axes[:, 2] * 0.02 * h, middle, (0.09 * g, 0.078), front, 0.8, *cloth)
    flesh.add(hems[0], hems[1], (0.055, 0.055), front, 1.0, *cloth)


def _bag(flesh: _Flesh, person: Person, s: PersonSkeleton) -> None:
    outfit, h = person.outfit, person.build.height
    up, front, left = s.trunk_axes[:, 2], s.trunk_axes[:, 0], s.trunk_axes[:, 1]
    colour, phase = outfit.bag_colour, outfit.phase
    big = 0.85 + 0.4 * (phase % 1.0)
    if outfit.bag == "backpack":
        centre = s.chest - front * (0.062 + 0.04 * big) * h - up * 0.10 * h
        flesh.add(centre - up * 0.06 * h, centre + up * 0.045 * h, (0.085 * big, 0.07 * big), front, 0.55, colour)
    elif outfit.bag in ("shoulder", "cross"):
        hip = s.pelvis + outfit.side * left * 0.1 * h - up * 0.02 * h
        flesh.add(hip, hip + up * 0.05 * h, (0.055 * big, 0.045 * big), left, 0.5, colour)
    elif outfit.bag == "hand":
        hand = s.fingers[0 if outfit.side > 0 else 1]
        low = hand - np.array([0, 0, (0.06 + 0.08 * big) * h])
        flesh.add(low, low + np.array([0, 0, 0.05 * h]), (0.06 * big, 0.045 * big), left, 0.45, colour)


def random_pose(rng: np.random.Generator, person: Person) -> Pose:
    """Mostly somewhere in a walk, now and then standing."""
    if rng.random() < 0.2:
        return standing(rng, person.manner)
    return walking(person.build, person.manner, float(rng.random()), float(rng.uniform(0.5, 1.8)))


def view_from(tilt: float, height_px: float, person_height: float, distance: float) -> PinholeCamera:
    """A camera that looks ``tilt`` radians down on a person at the origin, about ``height_px`` tall in its image."""
    size = math.ceil(2.2 * height_px)
    apparent = person_height * math.cos(tilt) + 0.45 * math.sin(tilt)
    middle = np.array([0.0, 0.0, 0.5 * person_height])
    position = middle + distance * np.array([-math.cos(tilt), 0.0, math.sin(tilt)])
    return PinholeCamera.look_at(position, middle, height_px * distance / apparent, size, size)


def render_person_sprite(
    rng: np.random.Generator,
    height_px: float,
    tilt: float | None = None,
    person: Person | None = None,
    pose: Pose | None = None,
    heading: float | None = None,
    light: Light | None = None,
) -> ImageArray:
    """One person cut out: ``(h, w, 4)`` uint8 RGBA, h about ``height_px``, straight alpha with soft edges.

    Args:
        rng: draws all that is not given.
        height_px: of the person in the sprite, roughly (a stride and the view change it).
        tilt: how far the camera looks down, radians in [0, 1.4]; by default drawn from [0, 1.05].
        person: who.
        pose: how.
        heading: which way, radians; 0 is away from the camera.
        light: under which light.

    Raises:
        ValueError: the height or the tilt is out of range.
    """
    if not 4 <= height_px <= 2000:
        raise ValueError(f"expected a height of 4 to 2000 pixels, got {height_px}")
    tilt = float(rng.uniform(0.0, 1.05)) if tilt is None else tilt
    if not 0 <= tilt <= 1.4:
        raise ValueError(f"expected a tilt of 0 to 1.4 radians, got {tilt}")
    person = random_person(rng) if person is None else person
    pose = random_pose(rng, person) if pose is None else pose
    heading = float(rng.uniform(0, 2 * math.pi)) if heading is None else heading
    light = random_light(rng) if light is None else light
    camera = view_from(tilt, height_px, person.build.height, float(rng.uniform(5, 30)))
    thing = person_thing(person, pose, np.zeros(2), heading)
    return drawn_alone(thing, camera, int(np.clip(round(170 / height_px), 2, 5)), light)


def random_identities(rng: np.random.Generator, count: int, look_alikes: float) -> list[Person]:
    """People of whom a share is dressed much like the one before."""
    people: list[Person] = []
    for _ in range(count):
        if people and rng.random() < look_alikes:
            outfit = similar_outfit(rng, people[-1].outfit)
            people.append(Person(random_build(rng), outfit, random_manner(rng)))
        else:
            people.append(random_person(rng))
    return people


def paste(canvas: Float32, sprite: ImageArray, left: int, top: int) -> None:
    """Lays a sprite ``(h, w, 4)`` over ``canvas`` ``(H, W, 3)``, in place; what leaves the canvas is cut off."""
    there, pixels = overlap(canvas.shape, (top, left), sprite.shape)
    part = sprite[pixels].astype(np.float32)
    canvas[there] += part[:, :, 3:] / np.float32(255) * (part[:, :, :3] - canvas[there])


def random_backdrop(rng: np.random.Generator, height: int, width: int) -> Float32:
    """``(height, width, 3)`` in [0, 255]: pieces of ground, walls and things out of focus, as behind people."""
    base = rng.uniform(40, 215) + rng.normal(0, 14, 3)
    slope = rng.normal(0, 25)
    canvas = (base + slope * np.linspace(-1, 1, height)[:, None, None] * np.ones((1, width, 1))).astype(np.float32)
    for _ in range(int(rng.integers(0, 4))):
        colour = rng.uniform(20, 230) + rng.normal(0, 22, 3)
        corner = rng.uniform(-0.5, 1.2, 2) * [width, height]
        reach = rng.uniform(0.1, 1.5, 2) * [width, height]
        box = cv2.boxPoints((corner.tolist(), reach.tolist(), float(rng.choice([0, 0, rng.uniform(-45, 45)]))))
        cv2.fillConvexPoly(canvas, np.round(box * 16).astype(np.int32), colour.tolist(), cv2.LINE_AA, 4)
    for _ in range(2):
        zoom, strength = rng.uniform(0.3, 6), rng.uniform(0, 0.18)
        rows = (np.arange(height) * zoom + rng.uniform(0, NOISE_SIZE)).astype(np.int64) % NOISE_SIZE
        columns = (np.arange(width) * zoom + rng.uniform(0, NOISE_SIZE)).astype(np.int64) % NOISE_SIZE
        canvas *= (1 + np.float32(strength) * (NOISE[rows[:, None], columns[None]] * 2 - 1))[:, :, None]
    return np.clip(canvas, 0, 255)
