"""Clips of one walking person whom a moving camera follows past other people and behind obstacles, with exact boxes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from pydantic import PositiveInt
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes.clip import Clip, ClipSettings, FrameTruth, Moment, Side, ground_truth
from tsuiseki.datamodules.scenes.people.gait import walking
from tsuiseki.datamodules.scenes.people.person import (
    paste,
    random_backdrop,
    random_identities,
    render_person_sprite,
)
from tsuiseki.datamodules.scenes.render.shading import random_light
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.datamodules.scenes.render.tracing import overlap
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.types import FloatArray, ImageArray

# Poses of one stride.
PHASES = 12
# Probability that a person is dressed like the one before.
LOOK_ALIKES = 0.4
# Probability that the camera jumps ten times as far in a frame.
JERK = 0.03
# Standard deviation of the camera's jump between frames, pixels.
SHAKE = 1.0
# Factor on the size over the whole clip, drawn between 1/GROWTH and GROWTH.
GROWTH = 1.5
# Standard deviation of the change of heading between the poses of a walk, radians.
TURNING = 0.15


@settings_dataclass(frozen=True, config=SETTINGS)
class SingleClipSettings(ClipSettings):
    """What a clip shows.

    Attributes:
        person_height: range of the followed person's height, pixels.
        passers: how many other people walk about.
        obstacles: how many upright things stand in front of the people.
    """

    frames: PositiveInt = 100
    width: Side = 320
    height: Side = 240
    person_height: tuple[float, float] = (40.0, 90.0)
    passers: int = 4
    obstacles: int = 3


# The pictures of a walk, and places ``(T, 2)``.
_Walker = tuple[list[ImageArray], FloatArray]


def _path(rng: np.random.Generator, frames: int, speed: float) -> FloatArray:
    """Positions ``(T, 2)`` of a walk whose direction wanders."""
    directions = rng.uniform(0, 2 * math.pi) + np.cumsum(rng.normal(0, 0.12, frames))
    steps = speed * np.stack([np.cos(directions), 0.4 * np.sin(directions)], axis=1)
    steps[0] = 0
    return np.asarray(np.cumsum(steps, axis=0))


def _walkers(rng: np.random.Generator, settings: SingleClipSettings) -> tuple[list[_Walker], FloatArray]:
    """The followed person first, whose path the others cross at some time; and the sizes ``(T,)`` of all."""
    people = random_identities(rng, 1 + settings.passers, LOOK_ALIKES)
    height, light = float(rng.uniform(*settings.person_height)), random_light(rng)
    growth = np.exp(rng.uniform(-1, 1) * np.log(GROWTH))
    speed, tall = 0.035 * height, height
    path = target_path = _path(rng, settings.frames, speed)
    walkers: list[_Walker] = []
    for person in people:
        if walkers:
            path = _path(rng, settings.frames, speed * float(rng.uniform(0.3, 1.5)))
            meeting = int(rng.integers(settings.frames))
            path = path - path[meeting] + target_path[meeting] + rng.normal(0, 0.15 * height, 2)
            tall = height * float(rng.uniform(0.85, 1.15))
        heading, tilt = float(rng.uniform(0, 2 * math.pi)), float(rng.uniform(0, 0.3))
        cycle = []
        for phase in range(min(2 * PHASES, settings.frames)):
            heading += float(rng.normal(0, TURNING))
            pose = walking(person.build, person.manner, phase / PHASES, 1.3)
            cycle.append(render_person_sprite(rng, tall, tilt, person, pose, heading, light))
        walkers.append((cycle, path))
    return walkers, growth ** np.linspace(0, 1, settings.frames)


class SingleClip(Clip[FrameTruth]):
    """A walk as ``settings`` and ``seed`` have it; its truth is of the whole person, hidden or not.

    Args:
        settings: what it shows.
        seed: of all random numbers, or what draws them; that is then where the plan left it when drawing begins.
    """

    def __init__(self, settings: SingleClipSettings, seed: int | Sequence[int] | np.random.Generator) -> None:
        self.settings, self._rng = settings, (rng := np.random.default_rng(seed))
        self._walkers, self._sizes = _walkers(rng, settings)
        (sprites, path), reach = self._walkers[0], np.array([settings.width, settings.height])
        # The view's top left corner is that of one behind the person, with shakes and jerks.
        follow = np.stack(list(itertools.accumulate(path, lambda behind, place: behind + 0.08 * (place - behind))))
        jump = np.where(rng.random(len(path)) < JERK, 10.0, 1.0)[:, None]
        shakes = np.cumsum(jump * rng.normal(0, SHAKE, path.shape), axis=0)
        self._corners = np.round(follow + np.clip(shakes, -0.25 * reach, 0.25 * reach) - reach / 2).astype(int)
        # Left, top and picture ``(h, w, 4)`` of things that stand on the path.
        self._obstacles, height = list[tuple[int, int, ImageArray]](), sprites[0].shape[0]
        for _ in range(settings.obstacles):
            where = path[int(rng.integers(len(path) // 5, len(path)))]
            width, tall = round(height * float(rng.uniform(0.15, 0.7))), round(height * float(rng.uniform(0.8, 2.2)))
            picture = np.full((tall, max(width, 2), 4), 255, dtype=np.uint8)
            picture[..., :3] = np.clip(random_backdrop(rng, tall, max(width, 2)), 0, 255)
            side = where[0] - width / 2 + float(rng.normal(0, 0.3 * height))
            self._obstacles.append((round(side), round(where[1] + 0.55 * height - tall), picture))
        self._low, high = self._corners.min(axis=0), self._corners.max(axis=0) + reach
        world = random_backdrop(rng, int(high[1] - self._low[1]), int(high[0] - self._low[0]))
        self._world, self._planned = np.clip(world, 0, 255), rng.bit_generator.state

    def frames(self) -> Iterator[Moment[FrameTruth]]:
        self._rng.bit_generator.state = self._planned
        for frame, (left, top) in enumerate(self._corners - self._low):
            view = self._world[top : top + self.settings.height, left : left + self.settings.width].copy()
            truth = self._draw(view, frame)
            yield (np.clip(view + self._rng.normal(0, 3, view.shape), 0, 255).astype(np.uint8),), truth

    def write_truth(self, folder: Path, name: str, truths: list[FrameTruth]) -> None:
        """Write ``gt/gt.txt`` and ``seqinfo.ini``."""
        self.settings.write_info(folder, name, ground_truth(truths))

    def _draw(self, view: Float32, t: int) -> FrameTruth:
        """Draws frame ``t``, the lower in front, and returns what it shows of the followed person."""
        walkers, corner, size = self._walkers, self._corners[t], float(self._sizes[t])
        order = sorted(range(len(walkers)), key=lambda k: float(walkers[k][1][t, 1]))
        box, free, full = np.zeros(4), np.zeros(view.shape[:2], dtype=np.bool_), 1.0

        def lay(sprite: ImageArray, left: int, top: int, owner: bool = False) -> None:
            """Over the view; ``free`` has the owner's pixels that nothing later hides."""
            paste(view, sprite, left, top)
            there, pixels = overlap(free.shape, (top, left), sprite.shape)
            free[there][sprite[..., 3][pixels] > 127] = owner

        for k in order:
            sprites, path = walkers[k]
            filtering = cv2.INTER_AREA if size < 1 else cv2.INTER_LINEAR
            sprite = np.asarray(
                cv2.resize(sprites[t % len(sprites)], None, fx=size, fy=size, interpolation=filtering), dtype=np.uint8
            )
            place = path[t] - corner
            left, top = round(place[0] - sprite.shape[1] / 2), round(place[1] - sprite.shape[0] / 2)
            lay(sprite, left, top, owner=k == 0)
            if k == 0:
                box = np.array([left, top, left + sprite.shape[1], top + sprite.shape[0]], dtype=np.float64)
                full = float((sprite[..., 3] > 127).sum())
        for x, y, picture in self._obstacles:
            lay(picture, x - int(corner[0]), y - int(corner[1]))
        return FrameTruth(np.ones(1, np.int64), box[None], np.array([float(free.sum()) / max(full, 1.0)]))
