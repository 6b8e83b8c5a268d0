"""What rain and cheap recorders do to a finished picture: streaks; few pixels, blocks, rows apart, infrared."""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.datamodules.augmentation import compressed
from tsuiseki.tracking.types import ImageArray

# Width that a cheap recorder keeps of a picture, pixels.
_WIDTHS = (352, 640)
# (lowest, highest) JPEG quality of a cheap recorder: a stand-in for the blocks of video at a low rate.
_QUALITY = (8, 45)
# Chance that rows are of two moments.
_INTERLACED = 0.25
# Chance of an infrared lamp: no colours, bright middle.
_INFRARED = 0.2
# Chance of a clock or name written into the picture.
_WRITTEN = 0.5


def rained_on(image: ImageArray, rng: np.random.Generator) -> ImageArray:
    """``image`` ``(H, W, 3)`` uint8 behind falling drops: a grey veil and slanted bright streaks."""
    height, width = image.shape[:2]
    length = int(rng.integers(5, 28))
    slant = float(rng.normal(0, 0.25))
    seeds = (rng.random((height, width), dtype=np.float32) < rng.uniform(0.001, 0.012)).astype(np.float32)
    streak = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
    reach = round(length * np.sin(slant)), round(length * np.cos(slant))
    cv2.line(streak, (length - reach[0], length - reach[1]), (length + reach[0], length + reach[1]), 1.0)
    veil = cv2.filter2D(seeds, -1, streak) * np.float32(rng.uniform(25, 70))
    veil = np.asarray(cv2.GaussianBlur(veil, (0, 0), float(rng.uniform(0.4, 0.9))), dtype=np.float32)
    haze = float(rng.uniform(0.05, 0.3))
    grey = float(rng.uniform(90, 190))
    return np.clip(image * np.float32(1 - haze) + np.float32(haze * grey) + veil[..., None], 0, 255).astype(np.uint8)


def recorded(image: ImageArray, rng: np.random.Generator) -> ImageArray:
    """``image`` ``(H, W, 3)`` uint8 as a cheap recorder plays it back."""
    height, width = image.shape[:2]
    if rng.random() < _INFRARED:
        image = _infrared(image, rng)
    kept = min(int(rng.uniform(*_WIDTHS)), width)
    size = kept, max(round(kept * height / width), 1)
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if rng.random() < _INTERLACED:
        # Every other row is of a moment later, in which a shaken camera has moved on.
        small[1::2] = np.roll(small, int(rng.integers(-3, 4)), axis=1)[1::2]
    if rng.random() < _WRITTEN:
        _write(small, rng)
    blocks = compressed(small[..., ::-1], int(rng.integers(*_QUALITY)))
    return np.ascontiguousarray(cv2.resize(blocks, (width, height))[..., ::-1], dtype=np.uint8)


def _infrared(image: ImageArray, rng: np.random.Generator) -> ImageArray:
    """Grey, brightest about the middle, where the lamp shines."""
    height, width = image.shape[:2]
    x = (np.arange(width) - width * rng.uniform(0.3, 0.7)) / width
    y = (np.arange(height) - height * rng.uniform(0.3, 0.7)) / height
    lamp = np.exp(-(x[None] ** 2 + y[:, None] ** 2) / rng.uniform(0.08, 0.5))
    grey = image.astype(np.float32) @ rng.dirichlet([4.0, 4.0, 2.0]).astype(np.float32)
    lit = np.clip(grey * rng.uniform(0.7, 1.5) * (0.15 + lamp), 0, 255)
    return np.repeat(lit[..., None], 3, axis=2).astype(np.uint8)


def _write(image: ImageArray, rng: np.random.Generator) -> None:
    """A date and time, or the name of a camera, in a corner of ``image``, in place."""
    digits = rng.integers(0, 10, 12)
    text = "{}{}-{}{}-20{}{} {}{}:{}{}:{}{}".format(*digits) if rng.random() < 0.7 else "CAM {}{}".format(*digits)
    scale = image.shape[1] / 900 * float(rng.uniform(0.6, 1.4))
    row = round(image.shape[0] * (0.06 if rng.random() < 0.5 else 0.96))
    column = round(image.shape[1] * float(rng.uniform(0.01, 0.5)))
    white = int(rng.integers(170, 256))
    cv2.putText(image, text, (column, row), cv2.FONT_HERSHEY_SIMPLEX, scale, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(image, text, (column, row), cv2.FONT_HERSHEY_SIMPLEX, scale, (white,) * 3, 1, cv2.LINE_AA)
