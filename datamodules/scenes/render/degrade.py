"""What a cheap camera does to a picture: exposure, colour cast, haze, blur, low resolution, noise, JPEG."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.render.solids import Float32, as_colour
from tsuiseki.tracking.types import FloatArray, ImageArray


@dataclass(frozen=True)
class Degradation:
    """What happens to a picture on its way to a file.

    Attributes:
        exposure: factor of the linear light.
        cast: factors of red, green and blue.
        contrast: about middle grey, after the exposure; 1 changes nothing.
        haze: share of grey veil, [0, 1).
        saturation: 0 is grey, 1 changes nothing.
        blur: standard deviation, pixels.
        shrink: the picture is made this much smaller and enlarged again; 1 changes nothing.
        sharpen: strength of the camera's sharpening; 0 changes nothing.
        noise: standard deviation in grey levels of 255.
        jpeg: quality, or 0 for none.
    """

    exposure: float = 1.0
    cast: tuple[float, float, float] = (1.0, 1.0, 1.0)
    contrast: float = 1.0
    haze: float = 0.0
    saturation: float = 1.0
    blur: float = 0.0
    shrink: float = 1.0
    sharpen: float = 0.0
    noise: float = 0.0
    jpeg: int = 0


def random_degradation(rng: np.random.Generator, strength: float = 1.0) -> Degradation:
    """Anything from a good camera to a bad one; ``strength`` 0 leaves pictures nearly alone."""
    s = strength
    cast = as_colour(1 + rng.normal(0, 0.07 * s, 3))
    return Degradation(
        exposure=float(np.exp(rng.normal(0.0, 0.35 * s))),
        cast=cast,
        contrast=float(np.exp(rng.normal(0.05, 0.18 * s))),
        haze=float(max(rng.normal(-0.1, 0.16), 0) * s),
        saturation=float(np.clip(rng.normal(1.0, 0.25 * s), 0.0, 1.6)) if rng.random() > 0.06 * s else 0.0,
        blur=float(rng.uniform(0.0, 1.1) * s) if rng.random() < 0.7 else 0.0,
        shrink=float(rng.uniform(1, 1 + 1.0 * s)) if rng.random() < 0.3 * s else 1.0,
        sharpen=float(rng.uniform(0.2, 1.5) * s) if rng.random() < 0.4 else 0.0,
        noise=float(rng.uniform(0, 8) * s),
        jpeg=int(rng.integers(35, 96)) if rng.random() < 0.7 * s else 0,
    )


def automatic_exposure(linear: Float32) -> float:
    """The factor that brings a picture's middle to a middle grey and keeps its bright parts, as a camera does."""
    middle, bright = np.percentile(linear[::8, ::8], [50, 95])
    return min(0.25 / max(float(middle), 1e-3), 1.1 / max(float(bright), 1e-3))


def degrade(linear: Float32, how: Degradation, rng: np.random.Generator) -> ImageArray:
    """``(H, W, 3)`` linear light to a uint8 RGB image."""
    factors = np.float32(how.exposure) * np.array(how.cast, dtype=np.float32)
    image = np.sqrt(np.clip(linear * factors, 0, 1))
    image = np.ascontiguousarray(cv2.transform(image, 255 * tone(how, 1.0)), dtype=np.float32)
    height, width = image.shape[:2]
    if how.blur > 0.2:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), how.blur), dtype=np.float32)
    if how.shrink > 1:
        small = (max(round(width / how.shrink), 1), max(round(height / how.shrink), 1))
        coarse = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
        image = np.asarray(cv2.resize(coarse, (width, height)), dtype=np.float32)
    if how.sharpen > 0:
        image = image + np.float32(how.sharpen) * (image - cv2.GaussianBlur(image, (0, 0), 1.2))
    if how.noise > 0:
        image = image + np.float32(how.noise) * sensor_noise(rng, height, width)
    result = np.clip(image, 0, 255).astype(np.uint8)
    if how.jpeg:
        # The order of the colours matters to JPEG, which keeps less of the blue.
        data = cv2.imencode(".jpg", result[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, how.jpeg])[1]
        result = np.ascontiguousarray(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)[:, :, ::-1])
    return np.asarray(result, dtype=np.uint8)


def tone(how: Degradation, white: float = 255.0) -> FloatArray:
    """``(3, 4)`` affine map of colours in [0, ``white``] that is the saturation, contrast and haze of ``how``."""
    mixing = how.saturation * np.eye(3) + (1 - how.saturation) / 3
    gain = how.contrast * (1 - how.haze)
    offset = 0.45 * (1 - how.haze) + 0.75 * how.haze - 0.45 * gain
    return np.concatenate([gain * mixing, np.full((3, 1), white * offset)], axis=1)


def sensor_noise(rng: np.random.Generator, height: int, width: int) -> Float32:
    """``(height, width, 3)`` of about unit deviation: fine in brightness, coarser and weaker in colour."""
    grey = np.float32(0.85) * rng.standard_normal((height, width, 1), dtype=np.float32)
    coarse = np.float32(0.75) * rng.standard_normal(((height + 1) // 2, (width + 1) // 2, 3), dtype=np.float32)
    return np.asarray(grey + cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR))


# Pictures of noise that the frames of a fast camera are grained with: drawing one a frame would cost more than the
# scene.
_NOISES = 3
# Most pixels that a picture of noise is shifted by, to the right and down, so that few frames share their grain.
_SHIFT = 64


def grains(rng: np.random.Generator, noise: float, width: int, height: int) -> list[NDArray[np.int16]]:
    """Pictures of ``noise`` grey levels, somewhat larger than an image, that all frames of a clip share."""
    shape = height + _SHIFT, width + _SHIFT
    return [(noise * sensor_noise(rng, *shape)).astype(np.int16) for _ in range(_NOISES)] if noise > 0 else []


def photographed(
    image: ImageArray, colours: FloatArray, blur: float, noises: list[NDArray[np.int16]], rng: np.random.Generator
) -> ImageArray:
    """``image`` ``(H, W, 3)`` uint8 with the `tone`, blur (pixels) and noise of a camera; faster than `degrade`."""
    height, width = image.shape[:2]
    image = np.asarray(cv2.transform(image, colours), dtype=np.uint8)
    if blur > 0.2:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), blur), dtype=np.uint8)
    if noises:
        top, left = rng.integers(0, _SHIFT, 2)
        grain = noises[int(rng.integers(_NOISES))][top : top + height, left : left + width]
        image = np.asarray(cv2.add(image, grain, dtype=cv2.CV_8U), dtype=np.uint8)
    return image


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
    # Light of signs, lamps and windows in the upper two thirds.
    signs = np.zeros((height, width, 3), dtype=np.float32)
    for _ in range(int(rng.integers(0, 7))):
        w, h = np.exp(rng.uniform(np.log(3), np.log(70), 2)).astype(int)
        x, y = int(rng.uniform(0, width)), int(rng.uniform(0, 0.65) * height)
        signs[y : y + h, x : x + w] = _tint(rng) * rng.uniform(0.4, 2.0)
    signs += np.float32(0.6) * cv2.GaussianBlur(signs, (0, 0), float(rng.uniform(2, 12)))
    return np.asarray(linear * smooth + signs, dtype=np.float32)


def _tint(rng: np.random.Generator) -> FloatArray:
    """A light's colour: mostly warm or white, now and then neon."""
    neon = rng.random() < 0.25
    return np.asarray(rng.dirichlet(np.ones(3)) * 2.5 if neon else rng.uniform([0.9, 0.7, 0.35], [1.2, 1.0, 1.1]))
