"""What a camera above a tank sees besides the fish: gravel, moving ripples of light, glints on the surface."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

Float32 = NDArray[np.float32]

GRAVEL = np.array([[150, 158, 150], [120, 132, 132], [172, 170, 158], [96, 110, 114], [140, 128, 112]], np.float32)
WATER = np.array([60, 118, 122], np.float32)


@dataclass(frozen=True)
class Ripples:
    """Light and glints over a tank: layers of waves that drift against each other.

    Attributes:
        layers: three ``(H, W)`` float32 layers of unit deviation that repeat at their borders: two of light on the
            floor, one of facets that may mirror the lamp.
        drift: ``(3, 2)`` pixels a second of each.
        strength: of the light, as a share of the brightness.
        glints: about the share of the surface that mirrors the lamp, in [0, 1).
    """

    layers: tuple[Float32, Float32, Float32]
    drift: Float32
    strength: float
    glints: float

    def at(self, time: float) -> tuple[Float32, Float32]:
        """Brightness factor ``(H, W)`` and the glints' opacity ``(H, W)`` in [0, 1] at a time in seconds."""
        a, b, facets = (
            np.roll(layer, np.round(time * shift[::-1]).astype(int).tolist(), axis=(0, 1))
            for layer, shift in zip(self.layers, self.drift, strict=True)
        )
        crest = (a + b) * np.float32(np.sqrt(0.5))
        brightness = 1.0 + self.strength * np.clip(1.2 - 2.4 * np.abs(crest), -0.5, 1.2)
        if not self.glints:
            return brightness, np.zeros_like(crest)
        slope = (facets + crest) * np.float32(np.sqrt(0.5))
        # The wanted share of a normal distribution of unit deviation lies above this level.
        return brightness, np.clip((slope - ndtri(1.0 - self.glints)) * 5.0, 0.0, 1.0)


def make_ripples(width: int, height: int, strength: float, glints: float, rng: np.random.Generator) -> Ripples:
    """Ripples over an image; ``glints`` is the share of it that they cover."""
    layers = (
        _periodic_noise(width, height, 9, 1.0, rng),
        _periodic_noise(width, height, 14, 1.0, rng),
        _periodic_noise(width, height, 60, 3.5, rng),
    )
    angle = rng.uniform(0, 2 * np.pi) + np.array([0.0, np.pi / 2, np.pi])
    drift = 45.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
    return Ripples(layers, drift, strength, glints)


def gravel(width: int, height: int, stones_of_fish_colour: int, rng: np.random.Generator) -> Float32:
    """The tank's floor ``(H, W, 3)`` in [0, 255], seen through greenish water.

    Args:
        width: of the image.
        height: likewise.
        stones_of_fish_colour: pebbles about as orange as the fish.
        rng: of the stones.
    """
    floor = np.empty((height, width, 3), np.float32)
    floor[:] = GRAVEL[1]
    stones = width * height // 90
    places = rng.uniform(0, 1, (stones, 2)) * [width, height]
    for place, radius, kind, shade in zip(
        places, rng.uniform(3, 9, stones), rng.integers(len(GRAVEL), size=stones), rng.uniform(0.75, 1.2, stones),
        strict=True,
    ):  # fmt: skip
        _stone(floor, place, float(radius), GRAVEL[kind] * shade, rng)
    floor = 0.55 * floor + 0.45 * WATER
    for place in rng.uniform(0, 1, (stones_of_fish_colour, 2)) * [width, height]:
        _stone(floor, place, float(rng.uniform(3, 7)), np.array([205, 120, 50], np.float32), rng)
    soft = cv2.GaussianBlur(floor, (0, 0), 0.9)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    edge = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
    return np.asarray(soft * (0.82 + 0.18 * np.clip(edge / 60, 0, 1))[..., None], np.float32)


def _stone(
    floor: Float32, place: np.ndarray[tuple[int], np.dtype[np.float64]], radius: float, colour: Float32,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    centre = (int(place[0]), int(place[1]))
    axes = (max(1, int(radius)), max(1, int(radius * rng.uniform(0.6, 1.0))))
    angle = float(rng.uniform(0, 180))
    dark, light = [tuple((colour * f).tolist()) for f in (0.7, 1.0)]
    cv2.ellipse(floor, centre, axes, angle, 0, 360, dark, cv2.FILLED)
    inner = (max(1, axes[0] - 1), max(1, axes[1] - 1))
    cv2.ellipse(floor, (centre[0] - 1, centre[1] - 1), inner, angle, 0, 360, light, cv2.FILLED)


def _periodic_noise(width: int, height: int, waves: int, stretch: float, rng: np.random.Generator) -> Float32:
    """Smooth noise ``(H, W)`` of unit deviation that fits together at its borders.

    About ``waves`` waves fill the width where ``stretch`` is 1; they are ``stretch`` times as long along x as along y.
    """
    fy = np.fft.fftfreq(height)[:, None] * width
    fx = np.fft.rfftfreq(width)[None, :] * width
    band = np.exp(-(((np.hypot(stretch * fx, fy) - waves) / (0.35 * waves)) ** 2))
    noise = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((height, width))) * band, s=(height, width))
    return np.asarray(noise / noise.std(), np.float32)
