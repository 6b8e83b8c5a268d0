"""People of whom some are dressed alike, what is behind them, and how they are pasted onto it."""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.people.gait import random_manner
from tsuiseki.datamodules.scenes.people.look import look_alike, random_build
from tsuiseki.datamodules.scenes.people.person import Person, random_person
from tsuiseki.datamodules.scenes.render.shading import NOISE, NOISE_SIZE
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.types import ImageArray


def random_identities(rng: np.random.Generator, count: int, look_alikes: float) -> list[Person]:
    """People of whom a share is dressed much like the one before."""
    people: list[Person] = []
    for _ in range(count):
        if people and rng.random() < look_alikes:
            look = look_alike(rng, people[-1].look)
            people.append(Person(random_build(rng), look, random_manner(rng)))
        else:
            people.append(random_person(rng))
    return people


def paste(canvas: Float32, sprite: ImageArray, left: int, top: int) -> None:
    """Lays a sprite ``(h, w, 4)`` over ``canvas`` ``(H, W, 3)``, in place; what leaves the canvas is cut off."""
    height, width = canvas.shape[:2]
    x1, y1 = max(left, 0), max(top, 0)
    x2, y2 = min(left + sprite.shape[1], width), min(top + sprite.shape[0], height)
    if x1 >= x2 or y1 >= y2:
        return
    part = sprite[y1 - top : y2 - top, x1 - left : x2 - left].astype(np.float32)
    alpha = part[:, :, 3:] / np.float32(255)
    canvas[y1:y2, x1:x2] += alpha * (part[:, :, :3] - canvas[y1:y2, x1:x2])


def random_backdrop(rng: np.random.Generator, height: int, width: int) -> Float32:
    """``(height, width, 3)`` in [0, 255]: pieces of ground, walls and things out of focus, as behind people."""
    base = rng.uniform(40, 215) + rng.normal(0, 14, 3)
    slope = rng.normal(0, 25)
    canvas = (base + slope * np.linspace(-1, 1, height)[:, None, None] * np.ones((1, width, 1))).astype(np.float32)
    for _ in range(int(rng.integers(0, 4))):
        colour = rng.uniform(20, 230) + rng.normal(0, 22, 3)
        corner = rng.uniform(-0.5, 1.2, 2) * [width, height]
        reach = rng.uniform(0.1, 1.5, 2) * [width, height]
        box = cv2.boxPoints((corner.tolist(), reach.tolist(), float(rng.choice([0, 0, rng.uniform(-45, 45)]))))
        cv2.fillConvexPoly(canvas, np.round(box * 16).astype(np.int32), colour.tolist(), cv2.LINE_AA, 4)
    for _ in range(2):
        zoom, strength = rng.uniform(0.3, 6), rng.uniform(0, 0.18)
        rows = (np.arange(height) * zoom + rng.uniform(0, NOISE_SIZE)).astype(np.int64) % NOISE_SIZE
        columns = (np.arange(width) * zoom + rng.uniform(0, NOISE_SIZE)).astype(np.int64) % NOISE_SIZE
        canvas *= (1 + np.float32(strength) * (NOISE[rows[:, None], columns[None]] * 2 - 1))[:, :, None]
    return np.clip(canvas, 0, 255)
