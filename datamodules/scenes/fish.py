"""One fish: how it swims, and how it is drawn.

It bends its tail towards a target (a beat, a steady bend to steer, a sharp bend to turn at once). The tail is a
plate that the water holds back along its normal, by the square of its speed: that turns the body, pushes it aside, and
turns a bent tail in the flow into a rudder. The beat pushes forward by the square of the tail's speed sideways
(Lighthill 1971), and the body slips easily along its axis and hardly across it. So heading, speed and bend are coupled
as in a real fish, and nothing couples them but the water. Seen from above it is bent at the root of its tail.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.body_clip import Drawn, around
from tsuiseki.datamodules.scenes.render.solids import Float32, along
from tsuiseki.tracking.types import FloatArray

# Of the simulation, so that a beat of the tail takes many steps.
STEPS_PER_SECOND = 120.0
# Distance from the border within which a fish minds the wall, pixels.
WALL_MARGIN = 110.0
# Least distance of its centre from the border, pixels.
NEAREST_WALL = 66.0
# Largest bend of the body, radians.
LARGEST_BEND = 1.4
# From the centre to the root of the tail, pixels.
ARM = 28.0
# Length of the tail, pixels.
TAIL = 32.0
# (least, greatest) beats a second of cruising.
BEAT_FREQUENCY = (1.2, 2.2)
# (least, greatest) amplitude of that beat, radians.
BEAT_BEND = (0.25, 0.5)
# Beats a second of a burst.
BURST_FREQUENCY = 3.2
# Amplitude of those beats, radians.
BURST_BEND = 0.75
# (least, greatest) length of a burst, seconds.
BURST_SECONDS = (0.4, 0.9)
# (least, greatest) length of a segment of cruising or gliding, seconds.
SEGMENT_SECONDS = (0.5, 1.6)
# Probability of a sudden turn at the end of a segment of a lively fish; 0.9 where it nears a wall.
TURNS = 0.3
# (least, greatest) angle of a sudden turn, radians.
TURN_ANGLE = (1.2, 2.4)
# The body's bend in a sudden turn, radians.
TURN_BEND = 1.3
# Natural frequency of the bend's answer to its target, radians a second.
STIFFNESS = 24.0
# Resistance of the tail along its normal, 1/pixel.
PLATE = 0.03
# Thrust of the tail's speed sideways, 1/pixel.
THRUST = 0.006
# Along the body, 1/pixel.
DRAG = 0.009
# Across the body, 1/pixel.
SIDE_DRAG = 0.06
# Drag of the body's turning, 1/second.
YAW_DAMPING = 1.5
# Radius of gyration of the body with the water that it moves along, pixels.
GYRATION = 20.0
# Shares of width and height that bound the places it swims to, so that ways cross.
MIDDLE = (0.25, 0.75)
# Share of the segments between turns that are bursts.
BURSTS = 0.3
# Share of the segments between turns that are glides without a beat.
GLIDES = 0.2
# Share of the fish that turn suddenly.
LIVELY = 0.5


class _Fish:
    """What the next step of one fish needs."""

    def __init__(self, size: FloatArray, rng: np.random.Generator) -> None:
        self.place = WALL_MARGIN + (size - 2 * WALL_MARGIN) * rng.random(2)
        self.heading = float(rng.uniform(-np.pi, np.pi))
        self.phase, self.lively = float(rng.uniform(0, 2 * np.pi)), bool(rng.random() < LIVELY)
        self.velocity, self.goal = 60.0 * along(self.heading)[:2], size * rng.uniform(*MIDDLE, 2)
        self.turning = self.bend = self.bending = self.side = self.wanted = 0.0
        self.frequency, self.amplitude, self.until = 1.5, 0.3, -10.0


def swim(frames: int, frame_rate: float, extent: tuple[int, int], rng: np.random.Generator) -> FloatArray:
    """States ``(frames, 4)`` a, b, theta, phi of one fish in a tank of ``extent`` width and height.

    The heading is continuous: it does not jump by full turns.
    """
    size = np.array(extent, dtype=np.float64)
    fish = _Fish(size, rng)
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


def _step(fish: _Fish, clock: float, dt: float, size: FloatArray, rng: np.random.Generator) -> None:
    """Decides, bends and moves, in this order."""
    target = _decide(fish, clock, dt, size, rng)
    pull = STIFFNESS**2 * (target - fish.bend) - 1.6 * STIFFNESS * fish.bending
    fish.bending += dt * pull
    fish.bend = float(np.clip(fish.bend + dt * fish.bending, -LARGEST_BEND, LARGEST_BEND))
    _push(fish, dt)
    # The glass stops what would leave the tank.
    low, high = NEAREST_WALL, size - NEAREST_WALL
    out = ((fish.place < low) & (fish.velocity < 0)) | ((fish.place > high) & (fish.velocity > 0))
    fish.velocity = np.where(out, 0.0, fish.velocity)
    fish.place = np.clip(fish.place, low, high)


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
        fish.goal = size * rng.uniform(*MIDDLE, 2)
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


def _turn_to(fish: _Fish, place: FloatArray) -> float:
    """The angle in [-pi, pi) between the heading and the way to ``place``."""
    away = place - fish.place
    return float((float(np.arctan2(away[1], away[0])) - fish.heading + np.pi) % (2 * np.pi) - np.pi)


# The tail bends over this length on both sides of its root.
FILLET = 9.0


class FishAppearance:
    """One fish, its sizes in pixels, in an orange of its own.

    Attributes:
        length: of the body, an ellipse with a drawn-out rear.
        width: of the body.
        tail: from the rear end of the body to the end of the fin.
        colour: ``(3,)`` RGB of the flanks in [0, 255].
        pattern: ``(h, w)`` lightness of the scales about 0, along and across the body.
    """

    def __init__(self, length: float, width: float, tail: float, rng: np.random.Generator) -> None:
        self.length, self.width, self.tail = length, width, tail
        self.colour = np.array([rng.uniform(225, 250), rng.uniform(95, 135), rng.uniform(20, 45)], np.float32)
        noise = rng.standard_normal((12, 40)).astype(np.float32)
        self.pattern = np.asarray(cv2.resize(noise, (160, 48), interpolation=cv2.INTER_CUBIC), np.float32)


def draw_fish(fish: FishAppearance, state: FloatArray) -> Drawn:
    """The fish in a state ``(4,)`` a, b, theta, phi; its part may reach beyond the image."""
    a, b, theta, phi = (float(value) for value in state)
    reach = math.ceil(fish.length / 2 + fish.tail + fish.width / 2 + 4)
    left, top, x, y = around(a, b, reach)
    along = math.cos(theta) * x + math.sin(theta) * y
    across = -math.sin(theta) * x + math.cos(theta) * y
    s, r = _straightened(along, across, fish.length / 2, phi)
    body = half_width(fish, s) - np.abs(r)
    # Signed distance into the forked fin, roughly: it widens from its stem and is notched at the end.
    back = (-s - fish.length / 2) / fish.tail
    spread = 0.08 * fish.width + 0.30 * fish.width * np.clip((back - 0.25) / 0.75, 0, 1) ** 1.3
    end = fish.tail * (0.93 - back) + 0.55 * np.abs(r)
    inside = np.minimum(spread - np.abs(r), np.minimum(end, fish.tail * (1.06 - back)))
    fin = np.asarray(np.where(back > 0.1, inside, -1.0), np.float32)
    # Two breast fins, nearly clear.
    u, v = s - 0.12 * fish.length, np.abs(r) - 0.52 * fish.width
    ahead, wide = 0.08 * fish.length, 0.26 * fish.width
    paddles = (1 - np.sqrt(((0.8 * u + 0.6 * v) / ahead) ** 2 + ((-0.6 * u + 0.8 * v) / wide) ** 2)) * ahead
    opaque = np.clip(body + 0.5, 0, 1)
    opacity = np.maximum.reduce([opaque, 0.85 * np.clip(fin + 0.5, 0, 1), 0.22 * np.clip(paddles + 0.5, 0, 1)])
    # Scales on a rounded back, a darker line along it, paler fins.
    columns = (s / (fish.length + 2 * fish.tail) + 0.5) * (fish.pattern.shape[1] - 1)
    rows = (r / fish.width + 0.5) * (fish.pattern.shape[0] - 1)
    scales = cv2.remap(fish.pattern, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    roundness = np.sqrt(np.clip(1 - (r / (fish.width / 2)) ** 2, 0, 1))
    light = 0.78 + 0.2 * roundness + 0.05 * scales - 0.10 * np.exp(-((r / 1.8) ** 2))
    colour = opaque[..., None] * (fish.colour * light[..., None]) + (1 - opaque[..., None]) * (
        fish.colour * 0.75 + 60.0
    )
    eyes = np.hypot(s - 0.35 * fish.length, np.abs(r) - 0.22 * fish.width) < 0.032 * fish.length
    colour[eyes] = (25, 20, 20)
    return Drawn(left, top, np.asarray(colour, np.float32), np.asarray(opacity, np.float32))


def half_width(fish: FishAppearance, s: Float32) -> Float32:
    """Half the width at places ``s`` along the straightened fish, 0 in the middle of the body; -1 beyond its ends."""
    half = fish.length / 2
    ellipse = fish.width / 2 * np.sqrt(np.clip(1 - (s / half) ** 2, 0, 1))
    stem = 0.14 * fish.width * np.clip((s + half + 0.55 * fish.tail) / (0.2 * fish.length), 0, 1)
    width = np.where(s < 0, np.maximum(ellipse, stem), ellipse)
    return np.asarray(np.where((s > half) | (s < -half - 0.55 * fish.tail), -1.0, width), np.float32)


def _straightened(x: Float32, y: Float32, arm: float, phi: float) -> tuple[Float32, Float32]:
    """Places ``(s, r)`` along and across the fish as if its tail were straight.

    The bend is an arc that touches the body's axis and the tail's line ``FILLET`` away from the root on both sides, so
    that the tail lies exactly where the state says.
    """
    if abs(phi) < 1e-3:
        return x, y
    side = math.copysign(1.0, phi)
    radius = FILLET / math.tan(abs(phi) / 2)
    start = -arm + FILLET
    # The arc's centre lies beside the axis at its start, on the side to which the tail goes.
    dx, dy = start - x, radius - side * y
    angle = np.arctan2(dx, dy)
    on_arc_s, on_arc_r = start - radius * angle, side * (radius - np.hypot(dx, dy))
    beyond_x, beyond_y = x + arm, side * y
    back = -math.cos(phi) * beyond_x + math.sin(abs(phi)) * beyond_y
    off = math.sin(abs(phi)) * beyond_x + math.cos(phi) * beyond_y
    on_tail_s = start - radius * abs(phi) - (back - FILLET)
    s = np.where(x >= start, x, np.where(back >= FILLET, on_tail_s, on_arc_s))
    r = np.where(x >= start, y, np.where(back >= FILLET, side * off, on_arc_r))
    outside = (x < start) & (back < FILLET) & ((angle < 0) | (angle > abs(phi)))
    return np.where(outside, 1e4, s).astype(np.float32), np.where(outside, 1e4, r).astype(np.float32)
