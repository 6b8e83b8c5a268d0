"""Where people walk: alone and in groups, crossing, turning, standing still, coming in and going out of view."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tsuiseki.datamodules.scenes.clip import ClipSettings
from tsuiseki.datamodules.scenes.people.gait import random_manner, standing, stride_length, walking
from tsuiseki.datamodules.scenes.people.outfit import Outfit, random_build, similar_outfit
from tsuiseki.datamodules.scenes.people.person import Person, person_thing, somebody
from tsuiseki.datamodules.scenes.people.posture import blend
from tsuiseki.datamodules.scenes.render.composing import Thing
from tsuiseki.tracking.types import FloatArray

# Metres that people keep between their middles.
PERSONAL_SPACE = 0.6
# How fast people step aside, 1/s.
EVASION = 2.5
# Metres between the middles of people who walk side by side.
ABREAST = 0.65
# Below it somebody stands, m/s.
STANDING_SPEED = 0.25
# (mean, standard deviation) of the speed of people on a street, m/s.
SPEED = (1.3, 0.2)
# Probability of walking in company, on a street.
GROUPS = 0.35
# Probability of a halt at a place where the way turns, on a street.
PAUSES = 0.25
# Probability of being dressed much like somebody else around.
LOOK_ALIKES = 0.15
# From one dancer to the next, metres.
FORMATION = 1.1
# (least, greatest) time from one figure of a dance to the next, seconds.
FIGURE = (0.8, 2.0)
# (least, greatest) speed of a player, m/s.
SPRINT = (2.0, 8.0)
# Standard deviation of the places about the play that players run to, metres.
AROUND = 3.0
# Time that the play stays in one place, seconds.
PLAY = 3.0

Motion = Literal["walk", "dance", "sport"]


class Walker:
    """One person's way through a clip.

    Attributes:
        person: who.
        first: 0-based frame of the first position.
        positions: ``(T, 2)`` metres.
        headings: ``(T,)`` radians.
        speeds: ``(T,)`` m/s.
        phases: ``(T,)`` of the walk, in strides.
        stillness: ``(T,)`` from 0, walking, to 1, standing.
        rest: the pose while standing.
    """

    def __init__(self, rng: np.random.Generator, person: Person, first: int, way: FloatArray, rate: float) -> None:
        velocities = _steps(way) * rate
        self.person, self.first, self.positions = person, first, way
        self.speeds, directions = np.linalg.norm(velocities, axis=1), _directions(velocities, 0.2 * rate)
        strides = np.array([stride_length(person.build, person.manner, float(s)) for s in self.speeds])
        steps = np.where(self.speeds > 0.05, self.speeds / rate / strides, 0)
        still = (self.speeds < STANDING_SPEED).astype(np.float64)
        self.stillness = gaussian_filter1d(still, 0.2 * rate, mode="nearest")
        self.headings, self.phases = np.arctan2(directions[:, 1], directions[:, 0]), rng.random() + np.cumsum(steps)
        self.rest = standing(rng, person.manner)

    def is_there(self, frame: int) -> bool:
        """Whether the person is around in ``frame``."""
        return self.first <= frame < self.first + len(self.positions)

    def thing(self, frame: int) -> Thing:
        """What is drawn of the person in ``frame``."""
        t = frame - self.first
        pose = walking(self.person.build, self.person.manner, float(self.phases[t]), float(self.speeds[t]))
        pose = blend(pose, self.rest, float(self.stillness[t]))
        return person_thing(self.person, pose, self.positions[t], float(self.headings[t]))


Places = Callable[[np.random.Generator], FloatArray]


def crowd(
    rng: np.random.Generator, clip: ClipSettings, people: int, inside: Places, outside: Places,
    obstacles: FloatArray, motion: Motion = "walk",
) -> list[Walker]:  # fmt: skip
    """Everybody who comes by within a clip.

    Args:
        rng: draws everything.
        clip: its length and frame rate.
        people: about how many are around at a time.
        inside: draws a place ``(2,)`` in view.
        outside: draws a place ``(2,)`` out of view, where people come from and go to.
        obstacles: ``(M, 3)`` x, y and radius of what people walk around, metres.
        motion: they walk by, dance in step, or play: run fast, and turn at once.
    """
    if motion == "walk":
        starts, ways = _passing(rng, clip, people, inside, outside)
    else:
        starts = [0] * people
        ways = _dance(rng, clip, people, inside) if motion == "dance" else _sport(rng, clip, people, inside)
    ways = keep_apart(starts, ways, clip, obstacles)
    persons: list[Person] = []
    for _ in ways:
        persons.append(somebody(rng, persons, LOOK_ALIKES))
    return [Walker(rng, *row, clip.frame_rate) for row in zip(persons, starts, ways, strict=True)]


def _passing(
    rng: np.random.Generator, clip: ClipSettings, people: int, inside: Places, outside: Places
) -> tuple[list[int], list[FloatArray]]:
    """First frames and ways of people who walk by, some of them in company."""
    starts: list[int] = []
    ways: list[FloatArray] = []
    places = 0
    while places < people:
        company = rng.random() < GROUPS
        size = min(int(rng.choice([2, 2, 2, 3, 4])) if company else 1, people - places)
        places += size
        start, here = 0, True
        while start < clip.frames:
            way = _way(rng, clip.frame_rate, inside, outside, here)
            starts += [start] * size
            ways += _abreast(rng, way, size, clip.frame_rate)
            start, here = start + len(way) + int(rng.uniform(0, 2) * clip.frame_rate), False
    return starts, ways


def _dance(rng: np.random.Generator, clip: ClipSettings, people: int, inside: Places) -> list[FloatArray]:
    """Ways ``(frames, 2)`` of a formation, which all at once turns, steps aside, and has some change places."""
    figure = max(round(rng.uniform(*FIGURE) * clip.frame_rate), 1)
    middle, side = inside(rng), int(np.ceil(np.sqrt(people)))
    spots = FORMATION * (np.stack(np.divmod(np.arange(people), side), axis=1) - (side - 1) / 2)
    keys = []
    for _ in range(clip.frames // figure + 1):
        changing = rng.permutation(people)[: max(people // 3, 2)]
        spots[changing] = spots[np.roll(changing, 1)]
        cosine, sine = np.cos(turn := rng.normal(0, 0.6)), np.sin(turn)
        keys.append(middle + rng.normal(0, 0.5, 2) + spots @ np.array([[cosine, sine], [-sine, cosine]]))
    ways = _rounded([np.repeat(keys, figure, axis=0)], 0.2 * figure)[: clip.frames]
    return list(ways.swapaxes(0, 1))


def _sport(rng: np.random.Generator, clip: ClipSettings, people: int, inside: Places) -> list[FloatArray]:
    """Ways ``(frames, 2)`` of people who run about a play, which moves on every few seconds."""
    plays = [inside(rng) for _ in range(int(clip.frames / clip.frame_rate / PLAY) + 1)]
    ways = []
    for _ in range(people):
        here, pieces, done = plays[0] + rng.normal(0, AROUND, 2), list[FloatArray](), 0
        while done < clip.frames:
            there = plays[int(done / clip.frame_rate / PLAY)] + rng.normal(0, AROUND, 2)
            pieces.append(_leg(here, there, rng.uniform(*SPRINT), clip.frame_rate))
            here, done = there, done + len(pieces[-1])
        ways.append(_rounded(pieces, 0.1 * clip.frame_rate)[: clip.frames])
    return ways


def _way(rng: np.random.Generator, rate: float, inside: Places, outside: Places, here: bool) -> FloatArray:
    """``(T, 2)`` positions, frame by frame, of one way through the scene; ``here`` starts it in view."""
    corners = [inside(rng) if here else outside(rng)]
    corners += [inside(rng) for _ in range(int(rng.choice([0, 1, 1, 2, 3])))]
    corners.append(outside(rng))
    speed = _pace(rng, SPEED, 1.7)
    pieces = []
    for a, b in itertools.pairwise(corners):
        pieces.append(_leg(a, b, speed, rate))
        if b is not corners[-1] and rng.random() < PAUSES:
            pieces.append(np.repeat(b[None], int(rng.uniform(1, 5) * rate), axis=0))
    way = _rounded(pieces, 0.5 * rate)
    return way[int(rng.uniform(0, 0.3) * len(way)) :] if here else way


def _pace(rng: np.random.Generator, speed: tuple[float, float], fastest: float) -> float:
    """A speed about the mean of ``speed``, at most ``fastest`` times as high."""
    return float(np.clip(rng.normal(*speed), 0.5 * speed[0], fastest * speed[0]))


def _leg(a: FloatArray, b: FloatArray, speed: float, rate: float) -> FloatArray:
    """``(T, 2)`` positions from ``a`` to just before ``b``, frame by frame."""
    steps = max(round(float(np.linalg.norm(b - a)) / speed * rate), 1)
    return np.asarray(a + np.arange(steps)[:, None] / steps * (b - a))


def _rounded(pieces: list[FloatArray], smoothing: float) -> FloatArray:
    """The way of the pieces: no turns on the spot, and people slow down before a halt."""
    return np.asarray(gaussian_filter1d(np.concatenate(pieces), smoothing, axis=0, mode="nearest"))


def _abreast(rng: np.random.Generator, way: FloatArray, size: int, frame_rate: float) -> list[FloatArray]:
    """The ways of ``size`` people who walk side by side along ``way``."""
    if size == 1:
        return [way]
    forward = _directions(_steps(way), 0.6 * frame_rate)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    asides = (ABREAST * (k - (size - 1) / 2) + rng.normal(0, 0.08) for k in range(size))
    return [way + aside * left + rng.normal(0, 0.25) * forward for aside in asides]


def _steps(way: FloatArray) -> FloatArray:
    """``(T, 2)`` metres a frame along a way ``(T, 2)``."""
    return np.gradient(way, axis=0) if len(way) > 1 else np.ones((1, 2))


def _directions(velocities: FloatArray, smoothing: float) -> FloatArray:
    """``(T, 2)`` unit vectors of motion, held while standing and smoothed over ``smoothing`` frames."""
    speed = np.linalg.norm(velocities, axis=1)
    moving = speed > 0.1 * max(float(speed.max()), 1e-9)
    # Each standing frame takes the direction of the last moving one, the first of all the next one's.
    last = np.maximum.accumulate(np.where(moving, np.arange(len(speed)), -1))
    last[last < 0] = int(np.argmax(moving))
    unit = velocities[last] / np.maximum(speed[last], 1e-9)[:, None]
    unit = gaussian_filter1d(unit, smoothing, axis=0, mode="nearest")
    return np.asarray(unit / np.maximum(np.linalg.norm(unit, axis=1), 1e-9)[:, None])


def keep_apart(
    starts: list[int], ways: list[FloatArray], clip: ClipSettings, obstacles: FloatArray
) -> list[FloatArray]:
    """The ways with evasions: people who come too close step aside, and return to their way afterwards."""
    offsets = [np.zeros_like(way) for way in ways]
    shifts = np.zeros((len(ways), 2))
    for frame in range(clip.frames):
        there = [i for i, (s, w) in enumerate(zip(starts, ways, strict=True)) if s <= frame < s + len(w)]
        if not there:
            continue
        now = np.array([ways[i][frame - starts[i]] for i in there]) + shifts[there]
        push = _repulsion(now, now, PERSONAL_SPACE, others=True)
        if len(obstacles):
            push += _repulsion(now, obstacles[:, :2], obstacles[:, 2] + 0.35, others=False)
        shifts[there] += (EVASION * push - 0.6 * shifts[there]) / clip.frame_rate
        for i in there:
            offsets[i][frame - starts[i]] = shifts[i]
    cut = [min(len(w), clip.frames - s) for s, w in zip(starts, ways, strict=True)]
    smooth = [_rounded([o[:n]], 0.25 * clip.frame_rate) for o, n in zip(offsets, cut, strict=True)]
    return [w[:n] + o for w, o, n in zip(ways, smooth, cut, strict=True)]


def _repulsion(a: FloatArray, b: FloatArray, distance: float | FloatArray, others: bool) -> FloatArray:
    """``(N, 2)`` metres by which points ``a`` are nearer to points ``b`` than ``distance``, away from them."""
    away = a[:, None] - b[None]
    gap = np.linalg.norm(away, axis=2)
    lack = np.clip(distance - gap, 0, None)
    if others:
        np.fill_diagonal(lack, 0)
    # Aside rather than back: turned by a quarter of a right angle, two who meet pass each other.
    unit = away / np.maximum(gap, 1e-6)[:, :, None]
    turned = 0.92 * unit + 0.38 * np.stack([-unit[:, :, 1], unit[:, :, 0]], axis=2)
    return np.asarray((lack[:, :, None] * turned).sum(axis=1) * 2)


# Metres from the walls that people in a room keep.
MARGIN = 0.45
# Longest way to the next place in a room, metres.
FARTHEST = 7.0
# Probability of a halt where the way turns, in a room.
HALTS = 0.35
# (mean, standard deviation) of the speed of people in a room, m/s.
INDOORS = (1.1, 0.25)


def dressed(rng: np.random.Generator, people: int, repeated: float) -> list[Person]:
    """People of whom a share wears the same clothes as another, or nearly."""
    persons: list[Person] = []
    for _ in range(people):
        outfit = Outfit(rng)
        if persons and rng.random() < repeated:
            model = persons[int(rng.integers(len(persons)))].outfit
            # The same clothes on somebody else, or most of them.
            repeat = model.but(skin=outfit.skin, hair=outfit.hair, hair_style=outfit.hair_style, phase=outfit.phase)
            outfit = repeat if rng.random() < 0.6 else similar_outfit(rng, model)
        persons.append(Person(random_build(rng), outfit, random_manner(rng)))
    return persons


def wander(
    rng: np.random.Generator, people: list[Person], clip: ClipSettings, size: FloatArray, obstacles: FloatArray
) -> list[Walker]:
    """Everybody's way through a room from the first frame of a clip to the last.

    Args:
        rng: draws everything.
        people: who.
        clip: its length and frame rate.
        size: ``(2,)`` metres of the floor, from the origin.
        obstacles: ``(M, 3)`` x, y and radius of what people walk around, metres.
    """

    def place() -> FloatArray:
        for _ in range(50):
            spot = rng.uniform(MARGIN, size - MARGIN)
            if (np.linalg.norm(obstacles[:, :2] - spot, axis=1) > obstacles[:, 2] + 0.3).all():
                break
        return np.asarray(spot)

    ways, rate = [], clip.frame_rate
    for _ in people:
        here, pieces = place(), list[FloatArray]()
        while sum(map(len, pieces)) < clip.frames + rate:
            away = place() - here
            there = here + away * min(1.0, FARTHEST / max(float(np.linalg.norm(away)), 1e-6))
            pieces.append(_leg(here, there, _pace(rng, INDOORS, 1.6), rate))
            if rng.random() < HALTS:
                pieces.append(np.repeat(there[None], int(rng.uniform(0.8, 4) * rate), axis=0))
            here = there
        ways.append(_rounded(pieces, 0.4 * rate)[: clip.frames])
    ways = [np.clip(way, 0.3, size - 0.3) for way in keep_apart([0] * len(ways), ways, clip, obstacles)]
    return [Walker(rng, person, 0, way, rate) for person, way in zip(people, ways, strict=True)]
