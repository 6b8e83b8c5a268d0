"""A picture by night: little light from above, coloured pools of lamps and shop windows, bright signs."""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.types import FloatArray


def by_night(linear: Float32, rng: np.random.Generator) -> Float32:
    """``(H, W, 3)`` linear light of a day turned into that of a night street.

    What the sun lit keeps a share of 3 to 25 %; the rest comes from 2 to 7 soft pools of coloured light. Up to six
    small signs shine by themselves, with a halo.
    """
    height, width = linear.shape[:2]
    # Light is smooth: it is mixed on a coarse grid.
    rows, columns = np.mgrid[0 : height / 8, 0 : width / 8] * 8
    light = np.tile(_tint(rng) * rng.uniform(0.03, 0.25), (*rows.shape, 1))
    for _ in range(int(rng.integers(2, 8))):
        spread = rng.uniform(0.08, 0.45, 2) * width
        x, y = rng.uniform(0, width), rng.uniform(0.1, 1.0) * height
        pool = np.exp(-(((columns - x) / spread[0]) ** 2) - ((rows - y) / spread[1]) ** 2)
        light += pool[..., None] * _tint(rng) * rng.uniform(0.2, 1.1)
    smooth = cv2.resize(light.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(linear * smooth + _signs(rng, height, width), dtype=np.float32)


def _tint(rng: np.random.Generator) -> FloatArray:
    """A light's colour: mostly warm or white, now and then neon."""
    neon = rng.random() < 0.25
    return np.asarray(rng.dirichlet(np.ones(3)) * 2.5 if neon else rng.uniform([0.9, 0.7, 0.35], [1.2, 1.0, 1.1]))


def _signs(rng: np.random.Generator, height: int, width: int) -> Float32:
    """``(height, width, 3)`` light of signs, lamps and windows in the upper two thirds."""
    signs = np.zeros((height, width, 3), dtype=np.float32)
    for _ in range(int(rng.integers(0, 7))):
        w, h = np.exp(rng.uniform(np.log(3), np.log(70), 2)).astype(int)
        x, y = int(rng.uniform(0, width)), int(rng.uniform(0, 0.65) * height)
        signs[y : y + h, x : x + w] = _tint(rng) * rng.uniform(0.4, 2.0)
    return signs + np.float32(0.6) * cv2.GaussianBlur(signs, (0, 0), float(rng.uniform(2, 12)))
