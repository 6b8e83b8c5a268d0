"""Soft balls that bounce in a room and squash where they hit a wall, with exact states; the paper's outlook.

A ball that touches a wall is flattened by just what keeps it on its side of the wall, and the wall pushes back as a
spring; once free it is round again in no time. So force and shape are one, as they are for the fish.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.body_clip import MOST_BODIES, BodyClip, Drawn, around, camera_grain, paint
from tsuiseki.datamodules.scenes.clip import ClipSettings
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.types import FloatArray

FIELDS = ("a", "b", "theta", "squash")
# Distance of the walls from the image's border, and a ball's diameter at rest, pixels.
WALL, DIAMETER = 12, 60.0
# Pixels a second squared; natural frequency of a ball against a wall, radians a second.
GRAVITY, STIFFNESS = 500.0, 38.0
# Share of critical damping while a ball touches, and how fast a free one becomes round, 1/second.
LOSS, RECOVERY = 0.02, 60.0
# Of the camera, grey levels.
NOISE = 4.0
STEPS_PER_SECOND = 240.0
LARGEST_SQUASH = 0.55
# Headings towards the left, right, upper and lower wall.
INTO_WALL = np.array([np.pi, 0.0, -np.pi / 2, np.pi / 2])


@dataclass(frozen=True)
class BouncingBallSettings(ClipSettings):
    """A clip.

    Attributes:
        balls: how many, 1 to 5; later ones are nearer.
    """

    frame_rate: float = 30.0
    balls: int = 1

    def __post_init__(self) -> None:
        few = 1 <= self.balls <= MOST_BODIES
        self.expect("ball", 4 * int(DIAMETER), (few, f"1 to {MOST_BODIES} balls", self.balls))


def plan_balls(settings: BouncingBallSettings, seed: int) -> BodyClip:
    """The clip of ``seed``; states are a, b, theta, squash."""
    plan, stage = np.random.default_rng(seed).spawn(2)
    states = np.stack([_bounce(settings, plan) for _ in range(settings.balls)], axis=1)
    colours = [np.array([235, 40 + 12 * n, 45], np.float32) * stage.uniform(0.9, 1.0) for n in range(settings.balls)]
    room = _room(settings, stage)

    def picture(frame: int) -> tuple[Float32, list[Drawn]]:
        image = room.copy()
        balls = [draw_ball(DIAMETER, s, c) for s, c in zip(states[frame], colours, strict=True)]
        for ball in balls:
            paint(image, ball)
        return image, balls

    return BodyClip(settings, FIELDS, states, picture, camera_grain(settings, NOISE, stage))


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


def draw_ball(diameter: float, state: FloatArray, colour: Float32) -> Drawn:
    """A rubber ball, lit from the upper left, in a state ``(4,)`` a, b, theta, squash."""
    a, b, theta, squash = (float(value) for value in state)
    left, top, x, y = around(a, b, int(np.ceil(diameter / 2 / (1 - LARGEST_SQUASH))) + 3)
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
