"""The colours of what is seen: patterns, painted details and light."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.scenes.people.outfit import Outfit
from tsuiseki.datamodules.scenes.render.solids import Colour, Detail, Float32, Int32, Pattern, Solids
from tsuiseki.datamodules.scenes.render.tracing import Layer, RayCamera, inner_normals
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Width and height of the table of noise, after which the noise repeats.
NOISE_SIZE = 256


def _smooth_noise() -> Float32:
    """A periodic table of noise with values in [0, 1], smooth over about four entries."""
    rng = np.random.default_rng(20)
    spectrum = np.fft.rfft2(rng.standard_normal((NOISE_SIZE, NOISE_SIZE)))
    frequency = np.hypot(np.fft.fftfreq(NOISE_SIZE)[:, None], np.fft.rfftfreq(NOISE_SIZE)[None])
    table = np.fft.irfft2(spectrum * np.exp(-((frequency / 0.12) ** 2)))
    table = (table - table.mean()) / (table.std() * 4) + 0.5
    return np.asarray(np.clip(table, 0, 1), dtype=np.float32)


NOISE = _smooth_noise()


@dataclass(frozen=True)
class Light:
    """Light of a scene, in linear intensities.

    Attributes:
        direction: ``(3,)`` unit vector towards the sun.
        sun: ``(3,)`` colour and strength of the direct light.
        sky: ``(3,)`` of the light from above.
        ground: ``(3,)`` of the light from below.
    """

    direction: Float32
    sun: Float32
    sky: Float32
    ground: Float32


def random_light(rng: np.random.Generator) -> Light:
    """Anything between an overcast day and a low bright sun."""
    azimuth, elevation = rng.uniform(0, 2 * np.pi), rng.uniform(0.35, 1.35)
    clear = rng.uniform(0, 1) ** 1.3
    warm = rng.uniform(-0.06, 0.10)
    sun = clear * rng.uniform(0.6, 1.1) * np.array([1 + warm, 1, 1 - warm])
    sky = (1 - 0.6 * clear) * rng.uniform(0.75, 1.1) * np.array([1 - 0.4 * warm, 1, 1 + 0.6 * warm])
    return _light(azimuth, elevation, sun, sky, sky * rng.uniform(0.35, 0.65))


def hard_sun(rng: np.random.Generator) -> Light:
    """A clear day's: shadows keep a tenth to a third of the light, and that is bluer.

    `random_light` leaves more than half of the light in three shadows of four. In real sun people cast shadows darker
    than themselves, and one side of them is as dark.
    """
    azimuth, elevation = rng.uniform(0, 2 * np.pi), rng.uniform(0.45, 1.35)
    height = np.sin(elevation)
    warm, blue = rng.uniform(0, 0.1), rng.uniform(0, 0.25)
    sun = rng.uniform(0.9, 1.3) * np.array([1 + warm, 1, 1 - warm])
    sky = rng.uniform(0.12, 0.3) * height * np.array([1 - blue, 1, 1 + blue])
    return _light(azimuth, elevation, sun, sky, (sun * height + sky) * rng.uniform(0.1, 0.25))


def _light(azimuth: float, elevation: float, sun: FloatArray, sky: FloatArray, ground: FloatArray) -> Light:
    """The light of a sun in that direction, radians."""
    across = np.cos(elevation)
    direction = np.array([np.cos(azimuth) * across, np.sin(azimuth) * across, np.sin(elevation)])
    return Light(*(np.asarray(v, dtype=np.float32) for v in (direction, sun, sky, ground)))


def shade(
    layer: Layer,
    visible: BoolArray,
    solids: Solids,
    camera: RayCamera,
    samples: int,
    light: Light,
    outfit: Outfit | None = None,
) -> Float32:
    """Linear colours ``(n, 3)`` of the n subpixels of ``layer`` where ``visible`` ``(h, w)`` is True, row by row."""
    rows, columns = np.nonzero(visible)
    which = layer.solid[rows, columns]
    order = np.argsort(which, kind="stable")
    which = which[order].astype(np.int32)
    rows, columns = rows[order], columns[order]
    pixels = np.empty((2, len(rows)), dtype=np.float32)
    pixels[0], pixels[1] = columns + layer.left, rows + layer.top
    directions = camera.rays((pixels.T + np.float32(0.5)) / np.float32(samples)).T
    local = directions * layer.distance[rows, columns]
    normal = np.empty_like(local)
    bounds = np.flatnonzero(np.diff(which, prepend=-1, append=len(solids)))
    for first, last in itertools.pairwise(bounds):
        k, at = which[first], slice(first, last)
        origin = solids.to_local[k] @ (camera.position.astype(np.float32) - solids.start[k])
        local[:, at] = solids.to_local[k] @ local[:, at] + origin[:, None]
        normal[:, at] = solids.to_local[k].T @ inner_normals(local[:, at], solids, k)
    normal /= np.maximum(np.sqrt(np.square(normal).sum(axis=0)), np.float32(1e-9))
    albedo = paint(local, which.astype(np.int32), solids, outfit)
    facing = np.maximum(light.direction @ normal, 0)
    up = np.float32(0.5) + np.float32(0.5) * normal[2]
    edge = np.square(1 - np.abs((normal * directions).sum(axis=0))) * np.float32(0.02)
    result = np.empty((len(rows), 3), dtype=np.float32)
    for c in range(3):
        lit = facing * light.sun[c] + up * (light.sky[c] - light.ground[c]) + light.ground[c]
        result[order, c] = albedo[c] * lit + edge * light.sky[c]
    return result


def paint(local: Float32, which: Int32, solids: Solids, outfit: Outfit | None) -> Float32:
    """Reflectances ``(3, n)`` at points ``local`` ``(3, n)`` in the axes of the solids ``which``, sorted by solid."""
    metres = local * solids.scale[which].T
    colour = solids.colour[which].T.copy()
    pattern = solids.pattern[which]
    if (pattern != Pattern.PLAIN).any():
        # Metres around and along each solid's surface.
        u, v, box = metres[0].copy(), metres[2].copy(), solids.box[which]
        curved, flat = np.flatnonzero(~box), np.flatnonzero(box)
        u[curved] = np.arctan2(local[0, curved], local[1, curved]) * solids.radius[which[curved]].mean(axis=1)
        face = np.abs(local[:, flat]).argmax(axis=0)
        u[flat] = np.where(face == 0, metres[1, flat], metres[0, flat])
        v[flat] = np.where(face == 2, metres[1, flat], metres[2, flat])
        second, period, phase = solids.second[which].T, solids.period[which], solids.phase[which]
        for code in np.unique(pattern[pattern != Pattern.PLAIN]):
            at = np.flatnonzero(pattern == code)
            mix = pattern_value(int(code), u[at], v[at], period[at], phase[at])
            colour[:, at] += mix * (second[:, at] - colour[:, at])
    if outfit is not None:
        head, trunk, pelvis = (np.flatnonzero(solids.detail[which] == code) for code in list(Detail)[1:])
        _paint_head(colour, head, outfit, metres[:, head], solids.period[which[head]])
        _paint_trunk(colour, trunk, outfit, metres[:, trunk])
        if outfit.phase % 3 < 1:
            # A belt.
            colour[:, pelvis[np.abs(metres[0, pelvis] - 0.075) < 0.02]] *= np.float32(0.4)
    phase = solids.phase[which]
    a, b, c = metres * np.float32(23.0)
    folds = np.sin(a + np.float32(1.3) * b + phase) * np.sin(np.float32(0.6) * c - b + 2 * phase)
    folds += np.sin(np.float32(1.9) * c + a - phase) * np.float32(0.5)
    return np.asarray(np.clip(colour * (1 + solids.relief[which] * folds), 0, 1))


def noise_at(u: Float32, v: Float32) -> Float32:
    """Smooth noise in [0, 1] that varies over about four units and repeats after `NOISE_SIZE`."""
    # The shift keeps the numbers positive, so that cutting off the fraction rounds down.
    row, column = ((w + np.float32(1 << 16)).astype(np.int32) & (NOISE_SIZE - 1) for w in (u, v))
    return NOISE.ravel()[row * NOISE_SIZE + column]


def pattern_value(code: int, u: Float32, v: Float32, period: Float32, phase: Float32) -> Float32:
    """How much of the second colour a pattern shows, ``(n,)`` in [0, 1]."""
    a, b = u / period, v / period + phase
    if code == Pattern.ACROSS:
        return np.asarray(b % 1 < 0.4, dtype=np.float32)
    if code == Pattern.ALONG:
        return np.asarray(a % 1 < 0.35, dtype=np.float32)
    if code == Pattern.CHECKS:
        return np.asarray((a % 1 < 0.5) * 0.5 + (b % 1 < 0.5) * 0.5, dtype=np.float32)
    if code == Pattern.SPECKLE:
        return np.asarray(noise_at(a * 24, b * 24) > 0.6, dtype=np.float32)
    if code == Pattern.CLOUDS:
        return np.asarray(np.clip((noise_at(a * 8, b * 8) - np.float32(0.35)) * 4, 0, 1))
    if code == Pattern.BRICKS:
        row = np.floor(b)
        return np.asarray(((b % 1) < 0.15) | (((a / 3 + row / 2) % 1) < 0.05), dtype=np.float32)
    if code == Pattern.WINDOWS:
        return np.asarray((np.abs(a % 1 - 0.5) < 0.28) & (np.abs(b % 1 - 0.5) < 0.25), dtype=np.float32)
    if code == Pattern.LEAVES:
        return noise_at(a * 30, b * 30)
    raise ValueError(f"expected a pattern code from {Pattern.ACROSS} to {Pattern.LEAVES}, got {code}")


def _linear(colour: Colour) -> Float32:
    return np.square(np.array(colour, dtype=np.float32))[:, None]


def _paint_head(colour: Float32, rows: IntArray, outfit: Outfit, metres: Float32, hairline: Float32) -> None:
    """Hair above a line that falls from forehead to neck, a beard, and shade about the eyes."""
    x, y, z = metres
    hair = (z - 0.8 * y > hairline) & (outfit.hair_style != "bald")
    chin = (z < 0.0) & (y > 0.01) & outfit.beard
    cover = outfit.hat if outfit.hair_style in ("cap", "hat") else outfit.hair
    colour[:, rows[hair]] = _linear(cover)
    colour[:, rows[chin & ~hair]] = _linear(outfit.hair)
    eyes = (np.abs(z - 0.032) < 0.010) & (y > 0.04) & (np.abs(np.abs(x) - 0.03) < 0.018) & ~hair
    colour[:, rows[eyes]] *= np.float32(0.45)


def _paint_trunk(colour: Float32, rows: IntArray, outfit: Outfit, metres: Float32) -> None:
    """An open jacket, a zip, a logo, straps."""
    x, y, z = metres
    front = y > 0
    second, strap = _linear(outfit.upper_second), _linear(outfit.bag_colour)
    if outfit.front == "open":
        width = 0.03 + 0.05 * (outfit.phase * 7 % 1) + 0.12 * np.clip(z - 0.15, 0, None)
        colour[:, rows[front & (np.abs(x) < width)]] = _linear(outfit.shirt)
    elif outfit.front == "zip":
        colour[:, rows[front & (np.abs(x) < 0.010)]] = 0.4 * second
    elif outfit.front == "logo":
        side = front if outfit.phase % 2 < 1.2 else ~front
        colour[:, rows[side & (np.abs(x) < 0.085) & (np.abs(z - 0.16) < 0.055)]] = second
    if outfit.bag == "backpack":
        colour[:, rows[front & (np.abs(np.abs(x) - 0.095) < 0.016)]] = strap
    elif outfit.bag == "cross":
        colour[:, rows[np.abs(x * outfit.side * 0.75 + 0.66 * (z - 0.12)) < 0.02]] = strap
