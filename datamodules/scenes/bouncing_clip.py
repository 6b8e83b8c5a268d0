"""Soft balls that bounce in a room and squash where they hit a wall, with exact states; the paper's outlook.

A ball that touches a wall is flattened by just what keeps it on its side of the wall, and the wall pushes back as a
spring; once free it is round again in no time. So force and shape are one, as they are for the fish.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.body_clip import (
    SceneFrame,
    check_clip,
    larger_noise,
    paint,
    seen_by_camera,
    write_body_clip,
)
from tsuiseki.datamodules.scenes.fish_drawing import Drawn, Float32
from tsuiseki.tracking.types import FloatArray

MOST_BALLS = 5
FIELDS = ("a", "b", "theta", "squash")
# Distance of the walls from the image's border, pixels.
WALL = 12
STEPS_PER_SECOND = 240.0
LARGEST_SQUASH = 0.55
# Headings towards the left, right, upper and lower wall.
INTO_WALL = np.array([np.pi, 0.0, -np.pi / 2, np.pi / 2])


@dataclass(frozen=True)
class BouncingBallSettings:
    """A clip.

    Attributes:
        frames: length.
        width: of the images, pixels.
        height: of the images, pixels.
        frame_rate: a second.
        balls: how many, 1 to 5; later ones are nearer.
        diameter: at rest, pixels.
        gravity: pixels a second squared.
        stiffness: natural frequency of a ball against a wall, radians a second.
        loss: share of critical damping while it touches.
        recovery: how fast a free ball becomes round, 1/second.
        noise: of the camera, grey levels.
    """

    frames: int = 150
    width: int = 640
    height: int = 480
    frame_rate: float = 30.0
    balls: int = 1
    diameter: float = 60.0
    gravity: float = 500.0
    stiffness: float = 38.0
    loss: float = 0.02
    recovery: float = 60.0
    noise: float = 4.0

    def __post_init__(self) -> None:
        check_clip(("ball", "balls"), self.balls, MOST_BALLS, self.diameter, self)


def plan_balls(settings: BouncingBallSettings, rng: np.random.Generator) -> FloatArray:
    """Exact states ``(frames, balls, 4)``: a, b, theta, squash."""
    return np.stack([_bounce(settings, rng) for _ in range(settings.balls)], axis=1)


def ball_frames(settings: BouncingBallSettings, seed: int) -> Iterator[SceneFrame]:
    """The frames of a clip, the same for one seed."""
    plan, stage = np.random.default_rng(seed).spawn(2)
    states = plan_balls(settings, plan)
    colours = [np.array([235, 40 + 12 * n, 45], np.float32) * stage.uniform(0.9, 1.0) for n in range(settings.balls)]
    room = _room(settings, stage)
    grain = larger_noise(settings.height, settings.width, settings.noise, stage)
    for frame in range(settings.frames):
        image = room.copy()
        balls = [draw_ball(settings.diameter, s, c) for s, c in zip(states[frame], colours, strict=True)]
        for ball in balls:
            paint(image, ball)
        yield seen_by_camera(image, states[frame], balls, grain, stage)


def write_balls(
    folder: Path,
    settings: BouncingBallSettings,
    seed: int,
    overwrite: bool = False,
    watch: Callable[[Iterator[SceneFrame]], Iterable[SceneFrame]] = iter,
) -> Path:
    """Writes a clip, as :func:`~tsuiseki.datamodules.scenes.body_clip.write_body_clip` says.

    Raises:
        RequestError: ``folder`` is a file, or holds files while ``overwrite`` is False.
    """
    return write_body_clip(folder, watch(ball_frames(settings, seed)), FIELDS, settings.frame_rate, overwrite)


def _bounce(settings: BouncingBallSettings, rng: np.random.Generator) -> FloatArray:
    """States ``(frames, 4)`` of one ball. ``theta`` points into the wall that it touched last."""
    size = np.array([settings.width, settings.height], dtype=np.float64)
    radius = settings.diameter / 2
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
            acceleration = np.array([0.0, settings.gravity])
            if depth[wall] > 0:
                theta, squash = float(INTO_WALL[wall]), min(float(depth[wall]) / radius, LARGEST_SQUASH)
                axis, inward = wall // 2, 1.0 if wall % 2 == 0 else -1.0
                speed = inward * velocity[axis]
                push = settings.stiffness**2 * depth[wall] - 2 * settings.loss * settings.stiffness * speed
                acceleration[axis] += inward * push
            else:
                squash -= dt * settings.recovery * squash
            velocity = velocity + dt * acceleration
            place = place + dt * velocity
    return states


def draw_ball(diameter: float, state: FloatArray, colour: Float32) -> Drawn:
    """A rubber ball, lit from the upper left, in a state ``(4,)`` a, b, theta, squash."""
    a, b, theta, squash = (float(value) for value in state)
    reach = int(np.ceil(diameter / 2 / (1 - LARGEST_SQUASH))) + 3
    left, top = int(np.floor(a)) - reach, int(np.floor(b)) - reach
    x = np.arange(left, left + 2 * reach + 1, dtype=np.float32) + np.float32(0.5 - a)
    y = np.arange(top, top + 2 * reach + 1, dtype=np.float32)[:, None] + np.float32(0.5 - b)
    cos, sin = float(np.cos(theta)), float(np.sin(theta))
    along = (cos * x + sin * y) / (1 - squash)
    across = (cos * y - sin * x) * (1 - squash)
    out = np.hypot(along, across) / (diameter / 2)
    # The distance to the outline in pixels, nearly: the gradient of `out` across it.
    slope = np.hypot(*np.gradient(out))
    opacity = np.clip((1 - out) / np.maximum(slope, 1e-6) + 0.5, 0, 1)
    height = np.sqrt(np.clip(1 - out**2, 0, 1))
    light = 0.62 + 0.38 * height - 0.10 * (x + y) / diameter
    shine = np.clip(1 - np.hypot(x + 0.2 * diameter, y + 0.2 * diameter) / (0.10 * diameter), 0, 1)
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
