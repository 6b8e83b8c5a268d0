"""A fish seen from above, bent at the root of its tail: colour, opacity, silhouette."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.body_clip import Drawn, around
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.types import FloatArray

# The tail bends over this length on both sides of its root.
FILLET = 9.0


@dataclass(frozen=True)
class FishAppearance:
    """One fish, its sizes in pixels.

    Attributes:
        length: of the body, an ellipse with a drawn-out rear.
        width: of the body.
        tail: from the rear end of the body to the end of the fin.
        colour: ``(3,)`` RGB of the flanks in [0, 255].
        pattern: ``(h, w)`` lightness of the scales about 0, along and across the body.
    """

    length: float
    width: float
    tail: float
    colour: Float32
    pattern: Float32


def random_appearance(length: float, width: float, tail: float, rng: np.random.Generator) -> FishAppearance:
    """A fish of some size and an orange of its own."""
    colour = np.array([rng.uniform(225, 250), rng.uniform(95, 135), rng.uniform(20, 45)], np.float32)
    noise = rng.standard_normal((12, 40)).astype(np.float32)
    pattern = cv2.resize(noise, (160, 48), interpolation=cv2.INTER_CUBIC)
    return FishAppearance(length, width, tail, colour, np.asarray(pattern, np.float32))


def draw_fish(fish: FishAppearance, state: FloatArray) -> Drawn:
    """The fish in a state ``(4,)`` a, b, theta, phi; its part may reach beyond the image."""
    a, b, theta, phi = (float(value) for value in state)
    reach = math.ceil(fish.length / 2 + fish.tail + fish.width / 2 + 4)
    left, top, x, y = around(a, b, reach)
    along = math.cos(theta) * x + math.sin(theta) * y
    across = -math.sin(theta) * x + math.cos(theta) * y
    s, r = _straightened(along, across, fish.length / 2, phi)
    body = half_width(fish, s) - np.abs(r)
    fin = _tail_fin(fish, s, np.abs(r))
    paddles = _paddles(fish, s, np.abs(r))
    opaque = np.clip(body + 0.5, 0, 1)
    opacity = np.maximum.reduce([opaque, 0.85 * np.clip(fin + 0.5, 0, 1), 0.22 * np.clip(paddles + 0.5, 0, 1)])
    return Drawn(left, top, _colour(fish, s, r, opaque), np.asarray(opacity, np.float32))


def half_width(fish: FishAppearance, s: Float32) -> Float32:
    """Half the width at places ``s`` along the straightened fish, 0 in the middle of the body; -1 beyond its ends."""
    half = fish.length / 2
    ellipse = fish.width / 2 * np.sqrt(np.clip(1 - (s / half) ** 2, 0, 1))
    stem = 0.14 * fish.width * np.clip((s + half + 0.55 * fish.tail) / (0.2 * fish.length), 0, 1)
    width = np.where(s < 0, np.maximum(ellipse, stem), ellipse)
    return np.asarray(np.where((s > half) | (s < -half - 0.55 * fish.tail), -1.0, width), np.float32)


def _tail_fin(fish: FishAppearance, s: Float32, r: Float32) -> Float32:
    """Signed distance into the forked fin, roughly: it widens from its stem and is notched at the end."""
    back = (-s - fish.length / 2) / fish.tail
    spread = 0.08 * fish.width + 0.30 * fish.width * np.clip((back - 0.25) / 0.75, 0, 1) ** 1.3
    end = fish.tail * (0.93 - back) + 0.55 * r
    inside = np.minimum(spread - r, np.minimum(end, fish.tail * (1.06 - back)))
    return np.asarray(np.where(back > 0.1, inside, -1.0), np.float32)


def _paddles(fish: FishAppearance, s: Float32, r: Float32) -> Float32:
    """Signed distance into the two breast fins, nearly clear."""
    u, v = s - 0.12 * fish.length, r - 0.52 * fish.width
    p, q = 0.8 * u + 0.6 * v, -0.6 * u + 0.8 * v
    ahead, wide = 0.08 * fish.length, 0.26 * fish.width
    return np.asarray((1 - np.sqrt((p / ahead) ** 2 + (q / wide) ** 2)) * ahead, np.float32)


def _colour(fish: FishAppearance, s: Float32, r: Float32, opaque: Float32) -> Float32:
    """Scales on a rounded back, a darker line along it, paler fins."""
    columns = (s / (fish.length + 2 * fish.tail) + 0.5) * (fish.pattern.shape[1] - 1)
    rows = (r / fish.width + 0.5) * (fish.pattern.shape[0] - 1)
    scales = cv2.remap(fish.pattern, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    roundness = np.sqrt(np.clip(1 - (r / (fish.width / 2)) ** 2, 0, 1))
    light = 0.78 + 0.2 * roundness + 0.05 * scales - 0.10 * np.exp(-((r / 1.8) ** 2))
    eyes = np.hypot(s - 0.35 * fish.length, np.abs(r) - 0.22 * fish.width) < 0.032 * fish.length
    colour = fish.colour * light[..., None]
    fins = fish.colour * 0.75 + 60.0
    colour = opaque[..., None] * colour + (1 - opaque[..., None]) * fins
    colour[eyes] = (25, 20, 20)
    return np.asarray(colour, np.float32)


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
