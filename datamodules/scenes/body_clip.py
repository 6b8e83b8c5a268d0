"""Clips of bodies: images, exact states, silhouettes; and of soft balls, which bounce in a room, the paper's outlook.

A ball that touches a wall is flattened by just what keeps it on its side of the wall, and the wall pushes back as a
spring; once free it is round again in no time. So force and shape are one, as they are for the fish.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field, PositiveFloat
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes.clip import IMAGES, Clip, ClipSettings, Moment
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.datamodules.scenes.render.tracing import Window, overlap
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.formats.body_states import FOLDER, write_states
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.tracks import exact_track

# Bodies of a clip, at most.
MOST_BODIES = 5
# The noise of the camera is drawn once, somewhat larger than an image: drawing it anew would cost more than the scene.
_SHIFT = 64
# Distance of the walls from the image's border, pixels.
WALL = 12
# Of a ball at rest, pixels.
DIAMETER = 60.0
# Pixels a second squared.
GRAVITY = 500.0
# Natural frequency of a ball against a wall, radians a second.
STIFFNESS = 38.0
# Damping while a ball touches, as a share of critical damping.
LOSS = 0.02
# How fast a free ball becomes round, 1/second.
RECOVERY = 60.0
# Standard deviation of the camera's noise, grey levels.
NOISE = 4.0
# Of the simulation, so that a bounce takes many steps.
STEPS_PER_SECOND = 240.0
# By how much a ball is flattened at most, as a share of its radius.
LARGEST_SQUASH = 0.55
# Headings towards the left, right, upper and lower wall.
INTO_WALL = np.array([np.pi, 0.0, -np.pi / 2, np.pi / 2])


@dataclass(frozen=True)
class Drawn:
    """A body on its part of the image.

    Attributes:
        left: column of the part.
        top: row of the part.
        colour: ``(h, w, 3)`` float32 in [0, 255].
        opacity: ``(h, w)`` in [0, 1].
    """

    left: int
    top: int
    colour: Float32
    opacity: Float32

    def within(self, shape: tuple[int, ...]) -> tuple[Window, Window]:
        return overlap(shape, (self.top, self.left), self.opacity.shape)


def around(a: float, b: float, reach: int) -> tuple[int, int, Float32, Float32]:
    """Left column and top row of what lies within ``reach`` pixels of a place, and the places x, y of it from there."""
    left, top = math.floor(a) - reach, math.floor(b) - reach
    x = np.arange(left, left + 2 * reach + 1, dtype=np.float32) + np.float32(0.5 - a)
    return left, top, x, np.arange(top, top + 2 * reach + 1, dtype=np.float32)[:, None] + np.float32(0.5 - b)


def paint(image: Float32, body: Drawn) -> None:
    """Lay a drawn body over ``image``."""
    part, pixels = body.within(image.shape)
    cover = body.opacity[pixels][..., None]
    image[part] = (1 - cover) * image[part] + cover * body.colour[pixels]


class BodyClip(Clip[FloatArray]):
    """A planned clip, of which every frame can be drawn on its own; its truth are the states ``(K, D)``.

    Its second view are the silhouettes, ``(H, W)`` uint8 whose bit ``k`` says that body ``k`` lies there, covered by
    another or not.

    Attributes:
        fields: names of the D numbers of a state.
        states: ``(T, K, D)`` exact states; body ``k`` has the id ``k + 1``.
    """

    fields: tuple[str, ...]
    states: FloatArray
    views = (IMAGES, f"{FOLDER}/{{number:06d}}.png")

    def draw_frame(self, frame: int) -> Moment[FloatArray]:
        image, bodies = self._picture(frame)
        height, width = image.shape[:2]
        silhouettes = np.zeros((height, width), np.uint8)
        for bit, body in enumerate(bodies):
            part, pixels = body.within((height, width))
            silhouettes[part] |= np.where(body.opacity[pixels] > 0.3, np.uint8(1 << bit), np.uint8(0))
        top, left = self._places[frame]
        noisy = cv2.add(image, self._noise[top : top + height, left : left + width], dtype=cv2.CV_8U)
        return (np.asarray(noisy, np.uint8), silhouettes), self.states[frame]

    def write_truth(self, folder: Path, name: str, truths: list[FloatArray]) -> None:
        """Write ``states.csv`` and ``seqinfo.ini``."""
        numbers = np.arange(len(truths))
        tracks = [exact_track(k + 1, numbers, way) for k, way in enumerate(np.stack(truths, axis=1))]
        write_states(folder / "states.csv", tracks, self.fields)
        self.settings.write_info(folder, name)

    @abstractmethod
    def _picture(self, frame: int) -> tuple[Float32, Sequence[Drawn]]:
        """The image ``(H, W, 3)`` in [0, 255] without noise, and its K bodies."""

    def _grain(self, level: float, rng: np.random.Generator) -> None:
        """Draw the camera's noise of ``level`` grey levels on more than an image, and which part each frame has."""
        size = (self.settings.height + _SHIFT, self.settings.width + _SHIFT, 3)
        self._noise = np.float32(level) * rng.standard_normal(size, dtype=np.float32)
        self._places = rng.integers(_SHIFT + 1, size=(self.settings.frames, 2))


@settings_dataclass(frozen=True, config=SETTINGS)
class BouncingBallSettings(ClipSettings):
    """A clip.

    Attributes:
        balls: how many, 1 to 5; later ones are nearer.
    """

    # A ball must have room to bounce.
    width: Annotated[int, Field(ge=4 * int(DIAMETER))] = 640
    height: Annotated[int, Field(ge=4 * int(DIAMETER))] = 480
    frame_rate: PositiveFloat = 30.0
    balls: Annotated[int, Field(ge=1, le=MOST_BODIES)] = 1


class BouncingClip(BodyClip):
    """The balls of ``seed``; states are a, b, theta, squash."""

    fields = ("a", "b", "theta", "squash")

    def __init__(self, settings: BouncingBallSettings, seed: int) -> None:
        self.settings, (plan, stage) = settings, np.random.default_rng(seed).spawn(2)
        self.states = np.stack([_bounce(settings, plan) for _ in range(settings.balls)], axis=1)
        reds = (np.array([235, 40 + 12 * n, 45], np.float32) for n in range(settings.balls))
        self._colours = [red * stage.uniform(0.9, 1.0) for red in reds]
        self._room = _room(settings, stage)
        self._grain(NOISE, stage)

    def _picture(self, frame: int) -> tuple[Float32, list[Drawn]]:
        image = self._room.copy()
        balls = [draw_ball(s, c) for s, c in zip(self.states[frame], self._colours, strict=True)]
        for ball in balls:
            paint(image, ball)
        return image, balls


def _bounce(settings: BouncingBallSettings, rng: np.random.Generator) -> FloatArray:
    """States ``(frames, 4)`` of one ball. ``theta`` points into the wall that it touched last."""
    size = np.array([settings.width, settings.height], dtype=np.float64)
    radius = DIAMETER / 2
    place = np.array([rng.uniform(0.2, 0.8) * size[0], rng.uniform(0.25, 0.5) * size[1]])
    velocity = np.array([rng.choice([-1.0, 1.0]) * rng.uniform(250, 400), rng.uniform(-80, 80)])
    theta, squash = float(INTO_WALL[3]), 0.0
    substeps = max(1, round(STEPS_PER_SECOND / settings.frame_rate))
    dt = 1.0 / (settings.frame_rate * substeps)
    states = np.empty((settings.frames, 4))
    for frame in range(settings.frames):
        states[frame] = [*place, theta, squash]
        for _ in range(substeps):
            depth = radius - np.array([place[0], size[0] - place[0], place[1], size[1] - place[1]]) + WALL
            wall = int(np.argmax(depth))
            acceleration = np.array([0.0, GRAVITY])
            if depth[wall] > 0:
                theta, squash = float(INTO_WALL[wall]), min(float(depth[wall]) / radius, LARGEST_SQUASH)
                axis, inward = wall // 2, 1.0 if wall % 2 == 0 else -1.0
                speed = inward * velocity[axis]
                push = STIFFNESS**2 * depth[wall] - 2 * LOSS * STIFFNESS * speed
                acceleration[axis] += inward * push
            else:
                squash -= dt * RECOVERY * squash
            velocity = velocity + dt * acceleration
            place = place + dt * velocity
    return states


def draw_ball(state: FloatArray, colour: Float32) -> Drawn:
    """A rubber ball, lit from the upper left, in a state ``(4,)`` a, b, theta, squash."""
    a, b, theta, squash = (float(value) for value in state)
    left, top, x, y = around(a, b, int(np.ceil(DIAMETER / 2 / (1 - LARGEST_SQUASH))) + 3)
    cos, sin = float(np.cos(theta)), float(np.sin(theta))
    along = (cos * x + sin * y) / (1 - squash)
    across = (cos * y - sin * x) * (1 - squash)
    out = np.hypot(along, across) / (DIAMETER / 2)
    # The distance to the outline in pixels, nearly: the gradient of `out` across it.
    slope = np.hypot(*np.gradient(out))
    opacity = np.clip((1 - out) / np.maximum(slope, 1e-6) + 0.5, 0, 1)
    height = np.sqrt(np.clip(1 - out**2, 0, 1))
    light = 0.62 + 0.38 * height - 0.10 * (x + y) / DIAMETER
    shine = np.clip(1 - np.hypot(x + 0.2 * DIAMETER, y + 0.2 * DIAMETER) / (0.10 * DIAMETER), 0, 1)
    painted = colour * light[..., None] + 110.0 * shine[..., None]
    return Drawn(left, top, np.asarray(painted, np.float32), np.asarray(opacity, np.float32))


def _room(settings: BouncingBallSettings, rng: np.random.Generator) -> Float32:
    """A plastered wall, boards below, and the frame of the room."""
    height, width = settings.height, settings.width
    room = np.empty((height, width, 3), np.float32)
    room[:] = (176, 182, 172)
    for cells, strength in ((6, 12.0), (40, 7.0)):
        patches = rng.standard_normal((cells * height // width + 2, cells)).astype(np.float32)
        room += strength * cv2.resize(patches, (width, height), interpolation=cv2.INTER_CUBIC)[..., None]
    boards = int(0.72 * height)
    grain = cv2.resize(rng.standard_normal((height - boards, 6)).astype(np.float32), (width, height - boards))
    room[boards:] = np.array([128, 112, 92], np.float32) + 9.0 * grain[..., None]
    room[boards : boards + 3] = (86, 74, 60)
    frame = np.ones((height, width), dtype=np.bool_)
    frame[WALL : height - WALL, WALL : width - WALL] = False
    room[frame] = (72, 76, 84)
    return room
