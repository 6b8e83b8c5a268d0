"""People who wander about a room for a whole clip: from place to place, with halts, around furniture and each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tsuiseki.datamodules.scenes.people.gait import random_manner
from tsuiseki.datamodules.scenes.people.look import look_alike, random_build, random_look
from tsuiseki.datamodules.scenes.people.person import Person
from tsuiseki.datamodules.scenes.street.walkers import Walker, keep_apart, walker_along
from tsuiseki.tracking.types import FloatArray

# Metres from the walls that people keep, and longest stretch to the next place.
MARGIN, FARTHEST = 0.45, 7.0


def dressed(rng: np.random.Generator, people: int, repeated: float) -> list[Person]:
    """People of whom a share wears the same clothes as another, or nearly."""
    found: list[Person] = []
    for _ in range(people):
        look = random_look(rng)
        if found and rng.random() < repeated:
            model = found[int(rng.integers(len(found)))].look
            # The same clothes on somebody else, or most of them.
            other = replace(model, skin=look.skin, hair=look.hair, hair_style=look.hair_style, phase=look.phase)
            look = other if rng.random() < 0.6 else look_alike(rng, model)
        found.append(Person(random_build(rng), look, random_manner(rng)))
    return found


def wander(
    rng: np.random.Generator,
    people: list[Person],
    frames: int,
    frame_rate: float,
    size: FloatArray,
    obstacles: FloatArray,
    pauses: float,
    speed: tuple[float, float],
) -> list[Walker]:
    """Everybody's way through a room of ``size`` ``(2,)`` metres from the first frame to the last.

    Args:
        rng: draws everything.
        people: who.
        frames: of the clip.
        frame_rate: frames per second.
        size: of the floor, from the origin.
        obstacles: ``(M, 3)`` x, y and radius of what people walk around, metres.
        pauses: probability of a halt at a place where the way turns.
        speed: (mean, standard deviation), m/s.
    """
    ways = [_way(rng, frames, frame_rate, size, obstacles, pauses, speed) for _ in people]
    ways = keep_apart([0] * len(ways), ways, frames, frame_rate, obstacles)
    inside = [np.clip(way, 0.3, size - 0.3) for way in ways]
    return [walker_along(rng, person, 0, way, frame_rate) for person, way in zip(people, inside, strict=True)]


def _place(rng: np.random.Generator, size: FloatArray, obstacles: FloatArray) -> FloatArray:
    for _ in range(50):
        spot = rng.uniform(MARGIN, size - MARGIN)
        if not len(obstacles) or (np.linalg.norm(obstacles[:, :2] - spot, axis=1) > obstacles[:, 2] + 0.3).all():
            break
    return np.asarray(spot)


def _way(
    rng: np.random.Generator,
    frames: int,
    rate: float,
    size: FloatArray,
    obstacles: FloatArray,
    pauses: float,
    speed: tuple[float, float],
) -> FloatArray:
    """``(frames, 2)`` positions."""
    here = _place(rng, size, obstacles)
    pieces, count = [], 0
    while count < frames + rate:
        there = _place(rng, size, obstacles)
        away = there - here
        distance = float(np.linalg.norm(away))
        there = here + away * min(1.0, FARTHEST / max(distance, 1e-6))
        pace = float(np.clip(rng.normal(*speed), 0.5 * speed[0], 1.6 * speed[0]))
        steps = max(round(float(np.linalg.norm(there - here)) / pace * rate), 1)
        pieces.append(here + np.arange(steps)[:, None] / steps * (there - here))
        if rng.random() < pauses:
            pieces.append(np.repeat(there[None], int(rng.uniform(0.8, 4) * rate), axis=0))
        count = sum(map(len, pieces))
        here = there
    # Nobody turns on the spot: half a second of smoothing rounds the corners and slows down before a halt.
    smooth = gaussian_filter1d(np.concatenate(pieces), 0.4 * rate, axis=0, mode="nearest")
    return np.asarray(smooth[:frames])
