"""How a fish swims: a driven bend, and the water's answer to it.

The fish bends its tail towards a target (a beat, a steady bend to steer, a sharp bend to turn at once). The tail is a
plate that the water holds back along its normal, by the square of its speed: that turns the body, pushes it aside, and
turns a bent tail in the flow into a rudder. The beat pushes forward by the square of the tail's speed sideways
(Lighthill 1971), and the body slips easily along its axis and hardly across it. So heading, speed and bend are coupled
as in a real fish, and nothing couples them but the water.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.scenes.render.solids import along
from tsuiseki.tracking.types import FloatArray

STEPS_PER_SECOND = 120.0
# A fish minds the wall from here on, and its centre never comes nearer than the second; pixels from the border.
WALL_MARGIN = 110.0
NEAREST_WALL = 66.0
LARGEST_BEND = 1.4
# Lengths in pixels, times in seconds. From the centre to the root of the tail, and the tail's length.
ARM, TAIL = 28.0, 32.0
# (least, greatest) beats a second of cruising, and amplitude of that beat, radians.
BEAT_FREQUENCY, BEAT_BEND = (1.2, 2.2), (0.25, 0.5)
# Beats a second of bursts, their amplitude in radians, and their (least, greatest) length.
BURST_FREQUENCY, BURST_BEND, BURST_SECONDS = 3.2, 0.75, (0.4, 0.9)
# (least, greatest) length of a segment of cruising or gliding.
SEGMENT_SECONDS = (0.5, 1.6)
# Probability of a sudden turn at the end of a segment of a lively fish; 0.9 where it nears a wall.
TURNS = 0.3
# (least, greatest) angle of a sudden turn, and the body's bend in it, radians.
TURN_ANGLE, TURN_BEND = (1.2, 2.4), 1.3
# Natural frequency of the bend's answer to its target, radians a second.
STIFFNESS = 24.0
# Resistance of the tail along its normal, and thrust of its speed sideways, 1/pixel.
PLATE, THRUST = 0.03, 0.006
# Drag along and across the body, 1/pixel, and of its turning, 1/second.
DRAG, SIDE_DRAG, YAW_DAMPING = 0.009, 0.06, 1.5
# Radius of gyration of the body with the water that it moves along.
GYRATION = 20.0
# Shares of the segments between turns that are bursts, and glides without a beat; of the fish that turn suddenly.
BURSTS, GLIDES, LIVELY = 0.3, 0.2, 0.5


@dataclass
class _Fish:
    """What the next step of one fish needs."""

    place: FloatArray
    velocity: FloatArray
    goal: FloatArray
    heading: float
    lively: bool
    turning: float = 0.0
    bend: float = 0.0
    bending: float = 0.0
    phase: float = 0.0
    frequency: float = 1.5
    amplitude: float = 0.3
    until: float = 0.0
    side: float = 0.0
    wanted: float = 0.0


def swim(frames: int, frame_rate: float, extent: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """States ``(frames, 4)`` a, b, theta, phi of one fish in a tank of ``extent`` width and height.

    The heading is continuous: it does not jump by full turns.
    """
    size = np.array(extent, dtype=np.float64)
    fish = _start(size, rng)
    substeps = max(1, round(STEPS_PER_SECOND / frame_rate))
    dt = 1.0 / (frame_rate * substeps)
    states = np.empty((frames, 4))
    clock = -2.0  # two seconds before the clip, so that it starts in full swing
    while clock < -1e-9:
        _step(fish, clock, dt, size, rng)
        clock += dt
    for frame in range(frames):
        states[frame] = [*fish.place, fish.heading, fish.bend]
        for _ in range(substeps):
            _step(fish, clock, dt, size, rng)
            clock += dt
    return states


def _start(size: FloatArray, rng: np.random.Generator) -> _Fish:
    place = WALL_MARGIN + (size - 2 * WALL_MARGIN) * rng.random(2)
    heading = float(rng.uniform(-np.pi, np.pi))
    phase, lively = float(rng.uniform(0, 2 * np.pi)), bool(rng.random() < LIVELY)
    return _Fish(place, 60.0 * along(heading)[:2], _new_goal(size, rng), heading, lively, phase=phase, until=-10.0)


def _step(fish: _Fish, clock: float, dt: float, size: FloatArray, rng: np.random.Generator) -> None:
    """Decides, bends and moves, in this order."""
    target = _decide(fish, clock, dt, size, rng)
    pull = STIFFNESS**2 * (target - fish.bend) - 1.6 * STIFFNESS * fish.bending
    fish.bending += dt * pull
    fish.bend = float(np.clip(fish.bend + dt * fish.bending, -LARGEST_BEND, LARGEST_BEND))
    _push(fish, dt)
    _keep_inside(fish, size)


def _decide(fish: _Fish, clock: float, dt: float, size: FloatArray, rng: np.random.Generator) -> float:
    """The bend that the fish strives for, radians."""
    if fish.side:
        turned = fish.side * (fish.heading - fish.wanted)
        if turned < 0 and clock < fish.until:
            return fish.side * TURN_BEND
        fish.side = 0.0
        fish.until = clock + float(rng.uniform(*BURST_SECONDS))
        fish.frequency, fish.amplitude = BURST_FREQUENCY, BURST_BEND
    if clock >= fish.until or np.linalg.norm(fish.goal - fish.place) < 50:
        fish.goal = _new_goal(size, rng)
    if clock >= fish.until:
        _next_segment(fish, clock, size, rng)
    fish.phase += 2 * np.pi * fish.frequency * dt
    off = _turn_to(fish, fish.goal)
    return fish.amplitude * float(np.sin(fish.phase)) + float(np.clip(0.7 * off, -0.55, 0.55))


def _next_segment(fish: _Fish, clock: float, size: FloatArray, rng: np.random.Generator) -> None:
    ahead = fish.place + 90 * along(fish.heading)[:2]
    outward = bool(np.any(ahead < WALL_MARGIN) or np.any(ahead > size - WALL_MARGIN))
    if fish.lively and rng.random() < (0.9 if outward else TURNS):
        inward = _turn_to(fish, size / 2)
        fish.side = float(np.sign(inward)) if outward else float(rng.choice([-1.0, 1.0]))
        angle = float(rng.uniform(*TURN_ANGLE))
        fish.wanted = fish.heading + fish.side * 0.7 * angle
        ahead = fish.place + 250 * along(fish.heading + fish.side * angle)[:2]
        fish.goal = np.clip(ahead, WALL_MARGIN, size - WALL_MARGIN)
        fish.until = clock + 0.35
        return
    kind = rng.random()
    fish.frequency = float(rng.uniform(*BEAT_FREQUENCY))
    fish.amplitude = float(rng.uniform(*BEAT_BEND))
    fish.until = clock + float(rng.uniform(*SEGMENT_SECONDS))
    if kind < BURSTS:
        fish.frequency, fish.amplitude = BURST_FREQUENCY, BURST_BEND
        fish.until = clock + float(rng.uniform(*BURST_SECONDS))
    elif kind < BURSTS + GLIDES:
        fish.amplitude = 0.05


def _push(fish: _Fish, dt: float) -> None:
    """Forces of the water on tail and body."""
    forward = along(fish.heading)[:2]
    aside = np.array([-forward[1], forward[0]])
    u, v = float(forward @ fish.velocity), float(aside @ fish.velocity)
    sin, cos = np.sin(fish.bend), np.cos(fish.bend)
    half = TAIL / 2
    x, y = -ARM - half * cos, half * sin
    normal_speed = (u - fish.turning * y) * sin + (v + fish.turning * x) * cos + half * fish.bending
    plate = -PLATE * abs(normal_speed) * normal_speed
    force_x, force_y = plate * sin, plate * cos
    torque = x * force_y - y * force_x
    force_x += THRUST * (TAIL * fish.bending) ** 2 - DRAG * abs(u) * u
    force_y -= SIDE_DRAG * abs(v) * v + 4.0 * v
    fish.velocity = fish.velocity + dt * (force_x * forward + force_y * aside)
    fish.turning += dt * (torque / GYRATION**2 - YAW_DAMPING * fish.turning)
    fish.place = fish.place + dt * fish.velocity
    fish.heading += dt * fish.turning


def _keep_inside(fish: _Fish, size: FloatArray) -> None:
    """The glass stops what would leave the tank."""
    low, high = NEAREST_WALL, size - NEAREST_WALL
    out = ((fish.place < low) & (fish.velocity < 0)) | ((fish.place > high) & (fish.velocity > 0))
    fish.velocity = np.where(out, 0.0, fish.velocity)
    fish.place = np.clip(fish.place, low, high)


def _new_goal(size: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Somewhere in the middle part, so that ways cross."""
    return size * rng.uniform(0.25, 0.75, 2)


def _turn_to(fish: _Fish, place: FloatArray) -> float:
    """The angle in [-pi, pi) between the heading and the way to ``place``."""
    away = place - fish.place
    return float((float(np.arctan2(away[1], away[0])) - fish.heading + np.pi) % (2 * np.pi) - np.pi)
