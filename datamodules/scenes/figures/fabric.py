"""Textures of cloth: folds, and now and then a pattern."""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.tracking.types import ImageArray

_SIDE = 128


def fabric(rng: np.random.Generator) -> ImageArray:
    """``(128, 128, 4)`` uint8 RGBA of grey cloth; its colour is chosen where it is shown."""
    level = np.full((_SIDE, _SIDE), 0.6, dtype=np.float32)
    for cells, strength in ((4, 0.05), (9, 0.05), (24, 0.03), (64, 0.03)):
        noise = rng.normal(0, strength * rng.uniform(0.4, 1.3), (cells, max(cells // 2, 2))).astype(np.float32)
        level += cv2.resize(noise, (_SIDE, _SIDE), interpolation=cv2.INTER_CUBIC)
    kind = rng.random()
    rows, columns = np.mgrid[:_SIDE, :_SIDE]
    contrast = np.float32(rng.uniform(0.45, 1.7))
    if kind < 0.12:
        level[rows // int(rng.integers(3, 14)) % 2 == 0] *= contrast
    elif kind < 0.18:
        level[columns // int(rng.integers(3, 10)) % 2 == 0] *= contrast
    elif kind < 0.26:
        side = int(rng.integers(4, 12))
        level[rows // side % 2 == 0] *= np.sqrt(contrast)
        level[columns // side % 2 == 0] *= np.sqrt(contrast)
    elif kind < 0.34:
        spots = cv2.resize(rng.random((24, 24)).astype(np.float32), (_SIDE, _SIDE))
        level[spots > 0.6] *= contrast
    grey = np.clip(level * 255, 8, 250).astype(np.uint8)
    return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
