"""The static part behind everything: a textured ground with roads, paving and grass, and the sky over it."""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.render.shading import Light, noise_at
from tsuiseki.datamodules.scenes.render.solids import Float32, as_colour
from tsuiseki.datamodules.scenes.render.tracing import RayCamera, ray_grid
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray

# Octaves of the noise: metres per four table entries, and strength.
OCTAVES = ((6.0, 0.5), (1.3, 0.4), (0.25, 0.5), (0.06, 0.5))
# Of the grain as fine as the picture shows it.
GRAIN = 0.9

# Place of paving among the materials asphalt, paving, grass, earth and concrete.
PAVING = 1
# Colour of each material, sRGB.
COLOURS = np.array(
    [[0.46, 0.46, 0.48], [0.60, 0.58, 0.55], [0.30, 0.42, 0.20], [0.50, 0.43, 0.34], [0.66, 0.66, 0.64]], np.float32
)
# Strength of the texture of each material, as a share of the brightness.
ROUGHNESS = np.array([0.10, 0.08, 0.30, 0.22, 0.06], np.float32)


class Strip:
    """A straight band of other ground: where |x cos a + y sin a - offset| < half_width, edges ``wobble`` metres loose.

    Attributes:
        material: of the band.
        angle: radians, about along or across ``main``.
        offset: metres.
        half_width: metres.
        wobble: metres.
        line: colour of the lines along its borders, or None.
    """

    def __init__(self, rng: np.random.Generator, material: int, main: float) -> None:
        loose, self.material = bool(rng.random() < 0.3), material
        self.line = None if rng.random() < 0.5 else as_colour(rng.choice([[0.85] * 3, [0.8, 0.7, 0.2]]))
        self.angle = main + float(rng.choice([0.0, np.pi / 2])) + float(rng.normal(0, 0.15))
        self.offset, self.half_width = float(rng.normal(6, 8)), float(rng.uniform(0.5, 5))
        self.wobble = float(rng.uniform(0.2, 1.5)) if loose else 0.0


class Ground:
    """A random ground and its sky: a street, a square or a lawn.

    Attributes:
        material: of all that no strip covers.
        strips: later ones cover earlier ones.
        sky: ``(2, 3)`` sRGB at the horizon and overhead.
        tints: ``(5, 3)`` factors of the materials' colours.
        tile: side of the paving's slabs, metres.
        stains: strength of the large-scale variation.
        haze: metres at which the ground has faded to the horizon by two thirds.
        phase: shifts the noise.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.material, *materials = rng.choice(5, size=8, p=(0.36, 0.22, 0.18, 0.08, 0.16)).tolist()
        main = float(rng.uniform(0, np.pi))
        self.strips = [Strip(rng, materials[k], main) for k in range(int(rng.integers(0, 5)))]
        horizon = np.clip(rng.uniform(0.6, 0.95) + rng.normal(0, 0.03, 3), 0, 1)
        overhead = np.clip(horizon * rng.uniform(0.7, 1.05) + [-0.12, 0.0, 0.12] * rng.uniform(0, 1, 1), 0, 1)
        self.sky = np.stack([horizon, overhead]).astype(np.float32)
        self.tints = (rng.uniform(0.65, 1.35, (5, 1)) * rng.normal(1, 0.05, (5, 3))).astype(np.float32)
        self.tile, self.stains = float(rng.uniform(0.3, 1.2)), float(rng.uniform(0.3, 1.6))
        self.haze, self.phase = float(rng.uniform(80, 600)), float(rng.uniform(0, 1000))


def draw_ground(ground: Ground, camera: RayCamera, light: Light) -> tuple[Float32, Float32]:
    """``(H, W, 3)`` linear light of the ground and the sky, and the ``(H, W)`` share of it that is direct sunlight.

    Beyond the field of a lens it is dark.
    """
    rays = ray_grid(camera, 1, 0, 0, camera.width, camera.height)
    beyond = np.isnan(rays[0])
    if beyond.any():
        rays = np.where(beyond, np.float32(0), rays)
    down = -rays[2]
    height = np.float32(camera.position[2])
    distance = height / np.maximum(down, np.float32(1e-4))
    x = rays[0] * distance + np.float32(camera.position[0])
    y = rays[1] * distance + np.float32(camera.position[1])
    # One pixel's angle, from two neighbouring rays, stretched by the slant of the view.
    row, column = (camera.height // 2, camera.width // 2) if beyond.any() else (0, 0)
    angle = np.sqrt(np.square(rays[:, row, column + 1] - rays[:, row, column]).sum())
    footprint = distance * angle * np.sqrt(distance / height)
    albedo = np.square(np.clip(ground_colour(ground, x, y, footprint), 0, 1))
    up = light.direction[2] * light.sun
    lit = albedo * (up + light.sky)
    sky = np.square(ground.sky)[:, None, None] * (light.sky + np.float32(0.25) * light.sun)
    rise = np.clip(rays[2], 0, 1)[:, :, None] ** np.float32(0.6)
    above = sky[0] + rise * (sky[1] - sky[0])
    fade = np.exp(-distance / np.float32(ground.haze))[:, :, None]
    picture = np.where(down[:, :, None] > 1e-4, above + fade * (lit - above), above)
    picture[beyond] = 0
    share = np.where(down > 1e-4, fade[:, :, 0] * (up / np.maximum(up + light.sky, 1e-6)).mean(), 0)
    return picture.astype(np.float32), share.astype(np.float32)


def ground_colour(ground: Ground, x: Float32, y: Float32, footprint: Float32) -> Float32:
    """sRGB ``(..., 3)`` of the ground at metres ``x``, ``y``, seen by pixels that cover ``footprint`` metres."""
    noises = []
    for period, _ in OCTAVES:
        scale = np.float32(4 / period)
        fade = np.clip(np.float32(1.5) - 4 * footprint / np.float32(period), 0, 1)
        noises.append((noise_at(x * scale + ground.phase, y * scale) - np.float32(0.5)) * fade)
    texture = np.zeros_like(x)
    for (_, strength), noise in zip(OCTAVES[1:], noises[1:], strict=True):
        texture += np.float32(strength) * noise
    cell = np.exp2(np.ceil(np.log2(np.maximum(footprint, np.float32(0.01))))).astype(np.float32)
    grain = noise_at(x / cell + np.float32(ground.phase), y / cell) - np.float32(0.5)
    texture = texture + np.float32(GRAIN) * grain
    stains = noises[0] * np.float32(OCTAVES[0][1] * ground.stains * 0.3)
    tinted = COLOURS * ground.tints
    kind = np.full(x.shape, ground.material, dtype=np.int8)
    colour = np.broadcast_to(tinted[ground.material], (*x.shape, 3)).copy()
    lines = []
    for strip in ground.strips:
        away = np.abs(x * np.float32(np.cos(strip.angle)) + y * np.float32(np.sin(strip.angle)) - strip.offset)
        if strip.wobble:
            away = away + np.float32(strip.wobble) * (noises[0] + noises[1])
        inside = np.clip((strip.half_width - away) / np.maximum(footprint, 0.02) + np.float32(0.5), 0, 1)
        colour += inside[:, :, None] * (tinted[strip.material] - colour)
        kind[inside > 0.5] = strip.material
        if strip.line is not None and not strip.wobble:
            lines.append((strip.line, np.abs(away - strip.half_width + np.float32(0.25))))
    if (kind == PAVING).any():
        # Dark joints between slabs, faded where they are narrower than a pixel.
        tile = ground.tile
        a, b = (np.abs((v / np.float32(tile)) % 1 - np.float32(0.5)) > 0.5 - 0.015 / tile for v in (x, y))
        grout = (a | b) * np.clip(np.float32(1.4) - footprint / np.float32(0.1 * tile), 0, 1)
        colour *= (1 - np.float32(0.3) * grout * (kind == PAVING))[:, :, None]
    colour *= (1 + stains + ROUGHNESS[kind] * np.float32(2.0) * texture)[:, :, None]
    for paint, away in lines:
        cover = np.clip((np.float32(0.06) - away) / np.maximum(footprint, 0.02) + np.float32(0.5), 0, 1)
        cover *= np.clip(np.float32(0.12) / np.maximum(footprint, 1e-3), 0, 1) * np.float32(0.85)
        colour += cover[:, :, None] * (np.array(paint, dtype=np.float32) - colour)
    return colour


# Largest side of the map in widths of a frame.
LARGEST = 2.4
# Pixels of a frame between two points of the grid of distances.
GRID = 40


class GroundMap:
    """A picture from straight above of all the ground that ``cameras`` see under a light, with coarser copies of it.

    Attributes:
        levels: ``(H, W, 3)`` uint8, each half the size of the one before; light after gamma 2.
        corner: ``(2,)`` metres of the first pixel's outer corner.
        cell: metres of a pixel of the first level.
    """

    def __init__(self, ground: Ground, cameras: list[PinholeCamera], light: Light) -> None:
        edges = (np.array([[x, y] for x in (0, c.width) for y in (0, c.height)], dtype=np.float64) for c in cameras)
        places = np.concatenate([c.ground(edge)[:, :2] for c, edge in zip(cameras, edges, strict=True)])
        places = places[np.isfinite(places).all(axis=1)]
        self.corner, high = places.min(axis=0) - 1.0, places.max(axis=0) + 1.0
        extent = high - self.corner
        finest = min(float(camera.position[2] / camera.focal[0]) for camera in cameras)
        self.cell = cell = max(finest, float(extent.max()) / (LARGEST * cameras[0].width))
        columns, rows = np.ceil(extent / cell).astype(int)
        x = (self.corner[0] + (np.arange(columns) + 0.5) * cell).astype(np.float32)
        y = (self.corner[1] + (np.arange(rows) + 0.5) * cell).astype(np.float32)
        bright = light.direction[2] * light.sun + light.sky
        picture = np.empty((rows, columns, 3), dtype=np.uint8)
        # In bands that stay in the cache: the colour of the ground takes a dozen arrays of this size.
        for top in range(0, rows, 64):
            xs, ys = np.broadcast_arrays(x[None, :], y[top : top + 64, None])
            colour = np.clip(ground_colour(ground, xs, ys, np.full(xs.shape, cell, dtype=np.float32)), 0, 1)
            picture[top : top + 64] = np.clip(255 * colour * np.sqrt(bright) + 0.5, 0, 255)
        self.levels = [picture]
        while min(self.levels[-1].shape[:2]) > 64 and len(self.levels) < 5:
            small = self.levels[-1].shape[1] // 2, self.levels[-1].shape[0] // 2
            coarser = cv2.resize(self.levels[-1], small, interpolation=cv2.INTER_AREA)
            self.levels.append(np.asarray(coarser, dtype=np.uint8))


def look_down(ground: GroundMap, camera: PinholeCamera) -> ImageArray:
    """The frame of ``camera`` with nothing but ground: ``(H, W, 3)`` uint8, light after gamma 2.

    Where a pixel covers several of the map, a coarser level is used, so that nothing flickers.
    """
    size = camera.width, camera.height
    x, y = (np.linspace(0, side, side // GRID + 1) for side in size)
    down = np.maximum(-camera.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))[:, 2], 0.02)
    # Metres of the ground that a pixel covers along its longer side.
    covered = camera.position[2] / down / camera.focal[0] / np.sqrt(down)
    levels = np.log2(np.maximum(covered.reshape(len(y), len(x)) / ground.cell, 1.0))
    first = int(np.clip(np.floor(levels.min()), 0, len(ground.levels) - 1))
    last = int(np.clip(np.ceil(levels.max() - 0.25), first, len(ground.levels) - 1))
    frame = _cut(ground, first, camera, slice(0, camera.height))
    for level in range(first + 1, last + 1):
        share = np.clip(levels - (level - 1), 0, 1).astype(np.float32)
        weight = cv2.resize(share, size, interpolation=cv2.INTER_LINEAR)
        used = np.flatnonzero(weight.max(axis=1) > 0)
        if not len(used):
            continue
        rows = slice(int(used[0]), int(used[-1]) + 1)
        coarse = _cut(ground, level, camera, rows)
        part = weight[rows]
        # cv2.blendLinear takes weights that it normalises itself.
        frame[rows] = cv2.blendLinear(coarse, np.ascontiguousarray(frame[rows]), part, 1 - part)
    return frame


def _cut(ground: GroundMap, level: int, camera: PinholeCamera, rows: slice) -> ImageArray:
    cell = ground.cell * 2**level
    # Pixel centres lie at .5, while OpenCV has them at whole numbers.
    to_metres = np.array([[cell, 0, ground.corner[0] + cell / 2], [0, cell, ground.corner[1] + cell / 2], [0, 0, 1]])
    shift = np.array([[1, 0, -0.5], [0, 1, -0.5 - rows.start], [0, 0, 1.0]])
    matrix = shift @ camera.matrix[:, [0, 1, 3]] @ to_metres
    size = camera.width, rows.stop - rows.start
    cut = cv2.warpPerspective(ground.levels[level], matrix, size, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cut, dtype=np.uint8)


def ground_homography(source: PinholeCamera, target: PinholeCamera) -> FloatArray:
    """``(3, 3)``: takes pixels of the ground in the image of ``before`` to those of ``after``."""
    # From homogeneous metres x, y, 1 of the ground to homogeneous pixels.
    matrix = target.matrix[:, [0, 1, 3]] @ np.linalg.inv(source.matrix[:, [0, 1, 3]])
    return np.asarray(matrix / matrix[2, 2])
