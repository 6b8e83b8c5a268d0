"""Goldfish in a tank from above, with exact states and silhouettes: the scenes of section 5."""

from __future__ import annotations

from typing import Annotated

import cv2
import numpy as np
from pydantic import Field, PositiveFloat
from pydantic.dataclasses import dataclass as settings_dataclass
from scipy.special import ndtri

from tsuiseki.datamodules.scenes.body_clip import MOST_BODIES, BodyClip, Drawn, paint
from tsuiseki.datamodules.scenes.clip import ClipSettings
from tsuiseki.datamodules.scenes.fish import FishAppearance, draw_fish, swim
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.datamodules.scenes.render.tracing import overlap
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.types import FloatArray

# Where the glass stands, from the image's border; pixels.
PANE = 24
# Right and down from a fish to its shadow on the floor, pixels.
SHADOW = (11, 15)
# Standard deviation of the shadow's blur, pixels.
SHADOW_BLUR = 4.0
# Of the ellipse of a fish, pixels.
LENGTH = 56.0
# Of the ellipse of a fish, pixels.
WIDTH = 24.0
# Length of its tail, pixels.
TAIL = 32.0
# Each fish is larger or smaller by up to this share.
SPREAD = 0.06
# Strength of the moving light, as a share of the brightness.
RIPPLES = 0.16
# Strength of mirror images in the glass, as a share of the brightness.
REFLECTIONS = 0.3
# Strength of the shadows, as a share of the brightness.
SHADOWS = 0.35
# Share of the surface that mirrors the lamp.
GLINTS = 0.004
# Stones about as orange as the fish, which a colour alone confuses with them.
PEBBLES = 6
# Standard deviation of the camera's noise, grey levels.
NOISE = 4.0


@settings_dataclass(frozen=True, config=SETTINGS)
class GoldfishSettings(ClipSettings):
    """A clip.

    Attributes:
        fish: how many, 1 to 5; nearer ones (later ids) cover farther ones.
    """

    # A fish must have room to turn.
    width: Annotated[int, Field(ge=4 * int(LENGTH))] = 640
    height: Annotated[int, Field(ge=4 * int(LENGTH))] = 480
    frame_rate: PositiveFloat = 15.0
    fish: Annotated[int, Field(ge=1, le=MOST_BODIES)] = 2


def goldfish_states(settings: GoldfishSettings, rng: np.random.Generator) -> FloatArray:
    """Exact states ``(frames, fish, 4)``: a, b, theta, phi."""
    extent = (settings.width, settings.height)
    ways = [swim(settings.frames, settings.frame_rate, extent, rng) for _ in range(settings.fish)]
    return np.stack(ways, axis=1)


class GoldfishClip(BodyClip):
    """The fish of ``seed``; states are a, b, theta, phi."""

    fields = ("a", "b", "theta", "phi")

    def __init__(self, settings: GoldfishSettings, seed: int) -> None:
        self.settings, (plan, stage) = settings, np.random.default_rng(seed).spawn(2)
        self.states = goldfish_states(settings, plan)
        scales = stage.uniform(1 - SPREAD, 1 + SPREAD, settings.fish)
        self._fish = [FishAppearance(scale * LENGTH, scale * WIDTH, scale * TAIL, stage) for scale in scales.tolist()]
        self._floor = gravel(settings.width, settings.height, stage)
        # Waves that drift against each other: two layers of light on the floor, one of facets that may mirror the lamp.
        size = (settings.width, settings.height)
        self._waves = [_periodic_noise(*size, *waves, stage) for waves in ((9, 1.0), (14, 1.0), (60, 3.5))]
        angle = stage.uniform(0, 2 * np.pi) + np.array([0.0, np.pi / 2, np.pi])
        self._drift = 45.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)
        self._grain(NOISE, stage)

    def _picture(self, frame: int) -> tuple[Float32, list[Drawn]]:
        states, image = self.states[frame], self._floor.copy()
        drawn = [draw_fish(fish, state) for fish, state in zip(self._fish, states, strict=True)]
        for shape in drawn:
            # Its blurred shadow on the floor, to its lower right.
            soft = cv2.GaussianBlur(shape.opacity, (0, 0), SHADOW_BLUR)
            part, pixels = overlap(image.shape, (shape.top + SHADOW[1], shape.left + SHADOW[0]), soft.shape)
            image[part] *= 1 - SHADOWS * soft[pixels][..., None]
        for fish, state in zip(self._fish, states, strict=True):
            _mirror(image, fish, state)
        for shape in drawn:
            paint(image, shape)
        brightness, glints = self._ripples(frame / self.settings.frame_rate)
        image *= cv2.merge([brightness] * 3)
        glinting = glints > 0
        image[glinting] += glints[glinting, None] * (250.0 - image[glinting])
        return image, drawn

    def _ripples(self, time: float) -> tuple[Float32, Float32]:
        """The brightness factor ``(H, W)`` and the glints' opacity ``(H, W)`` in [0, 1] at a time in seconds."""
        a, b, facets = (
            np.roll(layer, np.round(time * shift[::-1]).astype(int).tolist(), axis=(0, 1))
            for layer, shift in zip(self._waves, self._drift, strict=True)
        )
        crest = (a + b) * np.float32(np.sqrt(0.5))
        brightness = 1.0 + RIPPLES * np.clip(1.2 - 2.4 * np.abs(crest), -0.5, 1.2)
        slope = (facets + crest) * np.float32(np.sqrt(0.5))
        # The wanted share of a normal distribution of unit deviation lies above this level.
        return brightness, np.clip((slope - ndtri(1.0 - GLINTS)) * 5.0, 0.0, 1.0)


def _mirror(image: Float32, fish: FishAppearance, state: FloatArray) -> None:
    """Mirror images of a fish in the four panes, seen only in the strip beyond each."""
    height, width = image.shape[:2]
    for axis, extent, place in ((a, n, p) for a, n in enumerate((width, height)) for p in (PANE, n - PANE)):
        if abs(state[axis] - place) > fish.length / 2 + fish.tail + 2 * PANE:
            continue
        turned = state.copy()
        turned[axis] = 2 * place - state[axis]
        turned[2] = np.pi * (1 - axis) - state[2]
        turned[3] = -state[3]
        image_of = draw_fish(fish, turned)
        part, pixels = image_of.within(image.shape)
        strip = np.arange(extent) < place if place == PANE else np.arange(extent) >= place
        visible = strip[part[1 - axis]]
        visible = visible[None, :] if axis == 0 else visible[:, None]
        cover = (REFLECTIONS * image_of.opacity[pixels] * visible)[..., None]
        image[part] = (1 - cover) * image[part] + cover * 0.85 * image_of.colour[pixels]


# Colours of the stones, red, green and blue in [0, 255].
GRAVEL = np.array([[150, 158, 150], [120, 132, 132], [172, 170, 158], [96, 110, 114], [140, 128, 112]], np.float32)
# Colour of the water, red, green and blue in [0, 255].
WATER = np.array([60, 118, 122], np.float32)


def gravel(width: int, height: int, rng: np.random.Generator) -> Float32:
    """The tank's floor ``(H, W, 3)`` in [0, 255], seen through greenish water."""
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
    for place in rng.uniform(0, 1, (PEBBLES, 2)) * [width, height]:
        _stone(floor, place, float(rng.uniform(3, 7)), np.array([205, 120, 50], np.float32), rng)
    soft = cv2.GaussianBlur(floor, (0, 0), 0.9)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    edge = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
    return np.asarray(soft * (0.82 + 0.18 * np.clip(edge / 60, 0, 1))[..., None], np.float32)


def _stone(floor: Float32, place: FloatArray, radius: float, colour: Float32, rng: np.random.Generator) -> None:
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
