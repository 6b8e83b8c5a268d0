"""Textures for things of no class: noise of all scales, dead leaves, patterns, and collages of things.

Dead leaves are shapes that lie over each other, small ones more often than large ones; pictures of them have edges and
spectra as photographs have, and networks learn to see from them (Baradad et al., *Learning to See by Looking at Noise*,
NeurIPS 2021).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.datamodules.scenes.render.tracing import overlap
from tsuiseki.tracking.types import ImageArray

# Side of a texture, pixels: a little more than a search picture.
SIDE = 320
# Side of the coarsest noise, cells; each next octave has twice as many.
_COARSEST = 3
# Of the noise: the finest has cells of about a pixel.
_OCTAVES = 7
# Corners of a dead leaf without a smooth outline.
_CORNERS = (3, 7)


def random_texture(rng: np.random.Generator, things: Sequence[ImageArray] = ()) -> ImageArray:
    """``(SIDE, SIDE, 3)`` uint8 RGB of no class.

    Args:
        rng: draws everything.
        things: cut-outs ``(h, w, 4)`` uint8 with colours times opacity, which a collage is made of.
    """
    kind = rng.random()
    if kind < 0.25:
        texture = noise(rng)
    elif kind < 0.7 or not things:
        texture = dead_leaves(rng)
    elif kind < 0.8:
        texture = pattern(rng)
    else:
        texture = noise(rng) if rng.random() < 0.5 else dead_leaves(rng)
        for _ in range(int(rng.integers(5, 40))):
            thing = things[int(rng.integers(len(things)))]
            side = float(np.exp(rng.uniform(np.log(25), np.log(160))))
            paste_at(texture, thing, rng.uniform(0, SIDE, 2), side / max(thing.shape[:2]))
    return np.clip(texture, 0, 255).astype(np.uint8)


def paste_at(canvas: Float32, thing: ImageArray, middle: np.ndarray, scale: float) -> None:
    """Lay a cut-out of premultiplied colours over ``canvas``, in place, upright, about ``middle`` x, y."""
    size = max(2, round(thing.shape[1] * scale)), max(2, round(thing.shape[0] * scale))
    pixels = cv2.resize(thing, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    left, top = round(float(middle[0]) - size[0] / 2), round(float(middle[1]) - size[1] / 2)
    window, seen = overlap(canvas.shape, (top, left), pixels.shape)
    part, there = pixels[seen].astype(np.float32), canvas[window]
    there *= 1 - part[..., 3:] / 255
    there += part[..., :3]


def noise(rng: np.random.Generator) -> Float32:
    """Noise of all scales; the steeper its spectrum, the softer it looks."""
    fall, colourful = rng.uniform(0.35, 0.9), rng.uniform(0, 1)
    total = np.zeros((SIDE, SIDE, 3), dtype=np.float32)
    for octave in range(_OCTAVES):
        side = _COARSEST * 2**octave
        grey = rng.standard_normal((side, side, 1), dtype=np.float32)
        cells = grey + np.float32(colourful) * rng.standard_normal((side, side, 3), dtype=np.float32)
        if rng.random() < 0.2:
            # Lines of one direction, as in wood, grass or cloth.
            cells = cells[:1] + 0 * cells if rng.random() < 0.5 else cells[:, :1] + 0 * cells
        total += np.float32(fall**octave) * cv2.resize(cells, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)
    total *= np.float32(rng.uniform(8, 60)) / max(float(total.std()), 1e-3)
    return np.asarray(total + rng.uniform(50, 205) + rng.normal(0, 25, 3), dtype=np.float32)


def dead_leaves(rng: np.random.Generator) -> Float32:
    """Shapes over each other, of sizes that follow a power law, a little rough."""
    canvas = np.empty((SIDE, SIDE, 3), dtype=np.float32)
    ground, palette = rng.uniform(40, 200) + rng.normal(0, 25, 3), rng.uniform(0, 255, (int(rng.integers(3, 30)), 3))
    palette += rng.uniform(0, 1) * (palette.mean(axis=1, keepdims=True) - palette)
    palette = ground + (palette - ground) * rng.uniform(0.2, 1.0)
    canvas[:] = ground
    straight = rng.random()
    for radius in np.sort(np.exp(rng.uniform(np.log(4), np.log(80), int(rng.integers(60, 400)))))[::-1]:
        colour = (palette[int(rng.integers(len(palette)))] + rng.normal(0, 12, 3)).tolist()
        middle = rng.uniform(0, SIDE, 2)
        if rng.random() < straight:
            corners = int(rng.integers(*_CORNERS))
            turn = np.sort(rng.uniform(0, 2 * np.pi, corners))
            reach = radius * rng.uniform(0.5, 1.0, corners)
            points = middle + reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            cv2.fillPoly(canvas, [np.round(points * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)
        else:
            axes = (round(16 * radius), round(16 * radius * float(rng.uniform(0.2, 1))))
            at = tuple(np.round(middle * 16).astype(int).tolist())
            cv2.ellipse(canvas, at, axes, float(rng.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA, 4)
    rough = noise(rng)
    canvas += np.float32(rng.uniform(0, 0.7)) * (rough - rough.mean())
    return canvas


def pattern(rng: np.random.Generator) -> Float32:
    """Stripes, checks, bricks or dots of two colours, a little rough."""
    turn, step = float(rng.uniform(0, np.pi)), float(np.exp(rng.uniform(np.log(6), np.log(60))))
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float32)
    u, v = (x * np.cos(turn) + y * np.sin(turn)) / step, (y * np.cos(turn) - x * np.sin(turn)) / step
    kind = int(rng.integers(4))
    if kind == 0:
        level = np.sin(2 * np.pi * u)
    elif kind == 1:
        level = np.sin(2 * np.pi * u) * np.sin(2 * np.pi * v)
    elif kind == 2:
        level = np.minimum(np.abs((u + np.floor(v) / 2) % 1 - 0.5), np.abs(v % 1 - 0.5)) * 4 - 0.3
    else:
        level = 0.3 - np.hypot(u % 1 - 0.5, v % 1 - 0.5)
    sharp = np.clip(level * rng.uniform(1, 12), -1, 1)[..., None].astype(np.float32)
    first, second = rng.uniform(0, 255, (2, 3)).astype(np.float32)
    rough = noise(rng)
    return np.asarray((first + second) / 2 + sharp * (first - second) / 2 + 0.4 * (rough - rough.mean()), np.float32)
