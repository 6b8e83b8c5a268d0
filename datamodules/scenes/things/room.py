"""Textured rooms seen from inside, drawn once for each fixed camera, and what stands in offices, halls and shops."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.datamodules.scenes.render.composing import Picture, Thing, by_pixel, compose, empty_picture, shadows
from tsuiseki.datamodules.scenes.render.shading import Light, noise_at, pattern_value
from tsuiseki.datamodules.scenes.render.solids import (
    Colour,
    Float32,
    Pattern,
    Surface,
    as_colour,
    boxes,
    cone_spheres,
    pattern_of,
)
from tsuiseki.datamodules.scenes.render.tracing import RayCamera, ray_grid
from tsuiseki.tracking.types import FloatArray

Corner = tuple[float, float, float]
FLOORS = (Pattern.PLAIN, Pattern.CHECKS, Pattern.ACROSS, Pattern.ALONG, Pattern.CLOUDS, Pattern.SPECKLE)
WALLS = (Pattern.PLAIN, Pattern.PLAIN, Pattern.CLOUDS, Pattern.ALONG, Pattern.BRICKS)
# Rows of the picture that are drawn at a time, so that memory stays small.
BAND = 64


@dataclass(frozen=True)
class Shell:
    """The room's box between two corners, metres, with surfaces x-, x+, y-, y+, floor, ceiling, and their grain."""

    low: Corner
    high: Corner
    surfaces: tuple[Surface, ...]
    grain: float


# The room of the sphere paper's clips, about the world's origin.
HALL = Shell(
    (-6.5, -6.5, 0.0),
    (6.5, 6.5, 3.4),
    (
        Surface((0.62, 0.66, 0.70), (0.76, 0.74, 0.70), Pattern.ALONG, 0.9),
        Surface((0.72, 0.70, 0.64), (0.58, 0.60, 0.62), Pattern.CLOUDS, 1.6),
        Surface((0.66, 0.70, 0.62), (0.56, 0.58, 0.52), Pattern.ACROSS, 1.1),
        Surface((0.70, 0.62, 0.54), (0.50, 0.42, 0.36), Pattern.BRICKS, 0.35),
        Surface((0.60, 0.52, 0.42), (0.48, 0.40, 0.32), Pattern.CHECKS, 1.2),
        Surface((0.85, 0.85, 0.84), (0.80, 0.80, 0.80), Pattern.PLAIN, 1.0),
    ),
    0.25,
)


def random_shell(rng: np.random.Generator, size: FloatArray) -> Shell:
    """Walls in light muted colours, a floor of any kind, a light ceiling."""
    wall = _muted(rng, 0.45, 0.85)
    sides = []
    for _ in range(4):
        first = wall if rng.random() < 0.7 else _muted(rng, 0.25, 0.85)
        sides.append(Surface(first, _beside(rng, first), pattern_of(rng, *WALLS), float(rng.uniform(0.4, 1.5))))
    first = _muted(rng, 0.2, 0.75)
    floor = Surface(first, _beside(rng, first), pattern_of(rng, *FLOORS), float(rng.uniform(0.3, 1.6)))
    ceiling = Surface((0.85, 0.85, 0.84), (0.8, 0.8, 0.8), Pattern.PLAIN, 1.0)
    return Shell((0.0, 0.0, 0.0), tuple(size.tolist()), (*sides, floor, ceiling), float(rng.uniform(0.05, 0.3)))


def _muted(rng: np.random.Generator, low: float, high: float) -> Colour:
    return as_colour(np.clip(rng.uniform(low, high) + rng.normal(0, 0.05, 3), 0.03, 0.95))


def _beside(rng: np.random.Generator, colour: Colour) -> Colour:
    return as_colour(np.clip(np.array(colour) * rng.uniform(0.6, 1.3) + rng.normal(0, 0.03, 3), 0.03, 0.95))


def at_wall(size: FloatArray, side: int, share: float, off: float) -> tuple[FloatArray, float]:
    """A place ``(2,)`` at a ``share`` of a room, ``off`` metres from the wall x-, x+, y- or y+, and the way along."""
    spot, axis = share * size[:2], side // 2
    spot[axis] = size[axis] - off if side % 2 else off
    return spot, (-np.pi / 2, np.pi / 2, 0.0, np.pi)[side]


def random_furniture(rng: np.random.Generator, size: FloatArray, pieces: int) -> tuple[list[Thing], FloatArray]:
    """Desks, shelves and boxes along the walls and some in the room, and ``(M, 3)`` where they stand and how far."""
    things, rows = [], []
    for _ in range(pieces):
        half = np.array([rng.uniform(0.25, 0.8), rng.uniform(0.2, 0.4), rng.uniform(0.2, 0.6)])
        if rng.random() < 0.15:
            half[2] = rng.uniform(0.7, 1.0)
        side, share = int(rng.integers(4)), rng.uniform(0.1, 0.9)
        spot, _ = at_wall(size, side, share, 0.05 + half[1] if rng.random() < 0.75 else rng.uniform(1.0, 1.6))
        yaw = (0.0 if side >= 2 else np.pi / 2) + rng.normal(0, 0.04)
        first = _muted(rng, 0.1, 0.9) if rng.random() < 0.6 else as_colour(rng.uniform(0.1, 0.85, 3))
        pattern = pattern_of(rng, Pattern.PLAIN, Pattern.PLAIN, Pattern.CLOUDS, Pattern.ALONG, Pattern.CHECKS)
        second, period = _beside(rng, first), float(rng.uniform(0.1, 0.5))
        surface = Surface(first, second, pattern, period, 0.05, phase=float(rng.random()))
        things.append(Thing(boxes(np.array([[*spot, half[2]]]), half[None], np.array([yaw]), [surface])))
        rows.append([*spot, float(np.hypot(half[0], half[1]))])
    return things, np.array(rows, dtype=np.float64).reshape(-1, 3)


def hall_furniture(rng: np.random.Generator) -> list[Thing]:
    """Boxes along the walls of `HALL`, in several colours and patterns."""
    pieces = 7
    angle = rng.permutation(pieces) * (2 * np.pi / pieces) + rng.uniform(-0.2, 0.2, pieces)
    size = np.stack([rng.uniform(0.25, 0.7, pieces), rng.uniform(0.2, 0.4, pieces), rng.uniform(0.3, 1.0, pieces)], 1)
    reach = np.minimum(5.9 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle))), 7.0)
    centre = np.stack([reach * np.cos(angle), reach * np.sin(angle), size[:, 2]], axis=1)
    surfaces = []
    for _ in range(pieces):
        first, second = (as_colour(colour) for colour in rng.uniform(0.2, 0.85, (2, 3)))
        pattern = pattern_of(rng, Pattern.PLAIN, Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS, Pattern.CLOUDS)
        period, phase = float(rng.uniform(0.2, 0.6)), float(rng.random())
        surfaces.append(Surface(first, second, pattern, period, 0.05, phase=phase))
    return [Thing(boxes(centre, size, angle + np.pi / 2, surfaces))]


def draw_hall(camera: RayCamera, light: Light, furniture: list[Thing], samples: int) -> tuple[Picture, Float32]:
    """`HALL` as `draw_shell` draws a room."""
    rays = ray_grid(camera, samples, 0, 0, camera.width * samples, camera.height * samples)
    albedo, ambient, facing, floor = _lit(HALL, camera, rays, light)
    colour, direct = by_pixel(albedo * (ambient + facing), samples), by_pixel(albedo * facing * floor, samples)
    return _furnished(colour, direct, camera, light, furniture, samples)


def draw_shell(
    shell: Shell, camera: RayCamera, light: Light, furniture: list[Thing], samples: int
) -> tuple[Picture, Float32]:
    """The empty room, and ``(H, W, 3)`` the light on the floor that a shadow would take away, linear."""
    bands = []
    for top in range(0, camera.height, BAND):
        bottom = min(top + BAND, camera.height)
        rays = ray_grid(camera, samples, 0, top * samples, camera.width * samples, bottom * samples)
        albedo, ambient, facing, floor = _lit(shell, camera, rays, light)
        lamps = albedo * facing
        bands.append([by_pixel(v, samples) for v in (albedo * ambient + lamps, lamps * floor)])
    colour, direct = (np.concatenate(part) for part in zip(*bands, strict=True))
    return _furnished(colour, direct, camera, light, furniture, samples)


def _furnished(
    colour: Float32, direct: Float32, camera: RayCamera, light: Light, furniture: list[Thing], samples: int
) -> tuple[Picture, Float32]:
    """The room with furniture; shadows of what moves must not darken furniture, nor the floor where it is dark."""
    shade = shadows(furniture, camera, light.direction, softness=2.0)
    picture, _ = compose(empty_picture(colour - direct * shade[:, :, None], samples), furniture, camera, light)
    return picture, direct * (picture.open_ground * (1 - shade))[:, :, None]


def _lit(shell: Shell, camera: RayCamera, grid: Float32, light: Light) -> tuple[Float32, ...]:
    """What the rays of a grid ``(3, h, w)`` meet: reflectance, black for NaN, light from all about, light of lamps.

    Each is ``(h, w, 3)``; last is ``(h, w, 1)`` whether it is the floor.
    """
    origin, rays = camera.position.astype(np.float32), grid.reshape(3, -1)
    planes = np.array([end for ends in zip(shell.low, shell.high, strict=True) for end in ends], dtype=np.float32)
    axis = [0, 0, 1, 1, 2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (planes - origin[axis])[:, None] / rays[axis]
    reach = np.where(reach > 1e-6, reach, np.float32(np.inf))
    face = reach.argmin(axis=0)
    hit = np.isfinite(rays[0])
    points = origin[:, None] + np.where(hit, rays, 0) * np.where(hit, reach.min(axis=0), 0)
    albedo = np.zeros((points.shape[1], 3), dtype=np.float32)
    for code, surface in enumerate(shell.surfaces):
        at = (face == code) & hit
        x, y, z = points[:, at]
        u, v = (x, y) if code >= 4 else (y, z) if code < 2 else (x, z)
        ones = np.ones(len(u), dtype=np.float32)
        plain = surface.pattern == Pattern.PLAIN
        mix = 0 * ones if plain else pattern_value(surface.pattern, u, v, surface.period * ones, 0.3 * ones)
        base = np.square(np.array(surface[:2], dtype=np.float32))
        grain = 1 + np.float32(shell.grain) * (noise_at(u * 60, v * 60) + noise_at(u * 13 + 91, v * 13) - 1)
        albedo[at] = (base[0] + mix[:, None] * (base[1] - base[0])) * grain[:, None]
    normals = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float32)
    ambient = 0.5 * (1 + normals[:, 2:]) * light.sky + 0.5 * (1 - normals[:, 2:]) * light.ground
    facing = np.maximum(normals @ light.direction, 0)[:, None] * light.sun
    met = albedo, ambient[face], facing[face], (face == 4)[:, None].astype(np.float32)
    return tuple(values.reshape(*grid.shape[1:], -1) for values in met)


# Height of a chair's seat, metres.
SEAT = 0.45
# Height of a table, metres.
TABLE = 0.73
# Longest side of a box, metres: a wide view bends longer edges.
PIECE = 0.45
# Of paper and boards, sRGB.
WHITE: Colour = (0.93, 0.93, 0.92)
# Of screens and of chairs' frames, sRGB.
BLACK: Colour = (0.06, 0.06, 0.07)


def piece_colour(rng: np.random.Generator) -> Colour:
    """Grey, wooden, dark or bright."""
    kind = rng.random()
    if kind < 0.35:
        colour = np.full(3, rng.uniform(0.06, 0.92)) + rng.normal(0, 0.02, 3)
    elif kind < 0.6:
        colour = np.array([0.62, 0.45, 0.28]) * rng.uniform(0.4, 1.4) + rng.normal(0, 0.03, 3)
    elif kind < 0.8:
        colour = rng.uniform(0.03, 0.3, 3)
    else:
        colour = rng.uniform(0.05, 0.9, 3)
    return as_colour(np.clip(colour, 0.03, 0.95))


@dataclass
class Joinery:
    """Boxes in the axes of one piece, x across and y forward, until it is put somewhere."""

    rng: np.random.Generator
    rows: list[tuple[FloatArray, FloatArray, Surface]] = field(default_factory=list)

    def box(self, low: tuple[float, float, float], high: tuple[float, float, float], colour: Colour,
            pattern: int = Pattern.PLAIN) -> None:  # fmt: skip
        """A box between two corners, in parts where it is long."""
        start, end = np.array(low), np.array(high)
        parts = np.maximum(np.ceil((end - start) / PIECE), 1).astype(int)
        parts[2] = 1 if end[2] - start[2] < 1 else parts[2]
        second = as_colour(np.clip(np.array(colour) * self.rng.uniform(0.6, 1.25), 0.02, 0.95))
        surface = Surface(colour, second, pattern, float(self.rng.uniform(0.05, 0.4)), 0.06)
        for cell in np.ndindex(*parts.tolist()):
            lower, half = start + (end - start) * np.array(cell) / parts, (end - start) / parts / 2
            self.rows.append((lower + half, half, surface))

    def put(self, spot: FloatArray, yaw: float) -> Thing:
        """The piece at a place on the floor, its y axis towards ``yaw`` + 90 degrees."""
        centre, half = (np.array([row[k] for row in self.rows]) for k in (0, 1))
        cos, sin = np.cos(yaw), np.sin(yaw)
        centre[:, :2] = centre[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + spot
        return Thing(boxes(centre, half, np.full(len(centre), yaw), [surface for *_, surface in self.rows]))


def chair(rng: np.random.Generator, spot: FloatArray, heading: float) -> Thing:
    """A chair whose sitter would face ``heading``."""
    joinery, seat, frame = Joinery(rng), piece_colour(rng), BLACK if rng.random() < 0.6 else piece_colour(rng)
    half, top = rng.uniform(0.2, 0.26), rng.uniform(0.75, 1.1)
    joinery.box((-half, -half, SEAT - 0.06), (half, half, SEAT - 0.01), seat)
    joinery.box((-half, -half - 0.05, rng.uniform(SEAT, 0.6)), (half, -half, top), seat)
    if rng.random() < 0.5:
        for x, y in itertools.product((-half, half - 0.03), repeat=2):
            joinery.box((x, y, 0.0), (x + 0.03, y + 0.03, SEAT - 0.06), frame)
    else:
        joinery.box((-0.03, -0.03, 0.08), (0.03, 0.03, SEAT - 0.06), frame)
        joinery.box((-0.28, -0.03, 0.03), (0.28, 0.03, 0.08), frame)
        joinery.box((-0.03, -0.28, 0.03), (0.03, 0.28, 0.08), frame)
    if rng.random() < 0.5:
        for x in (-half - 0.04, half):
            joinery.box((x, -half, 0.62), (x + 0.04, half, 0.66), frame)
    if rng.random() < 0.15:
        # A coat over the back.
        low, high = (-half - 0.02, -half - 0.12, 0.45), (half + 0.02, -half - 0.04, top + 0.04)
        joinery.box(low, high, piece_colour(rng), Pattern.CLOUDS)
    return joinery.put(spot, heading - np.pi / 2)


def table(rng: np.random.Generator, spot: FloatArray, yaw: float, half: tuple[float, float]) -> Thing:
    """A table or desk with what lies on it."""
    joinery, top = Joinery(rng), piece_colour(rng)
    x, y = half
    wood = pattern_of(rng, Pattern.PLAIN, Pattern.PLAIN, Pattern.ALONG, Pattern.CLOUDS)
    joinery.box((-x, -y, TABLE - 0.04), (x, y, TABLE), top, wood)
    if rng.random() < 0.6:
        for a, b in itertools.product((-x + 0.03, x - 0.09), (-y + 0.03, y - 0.09)):
            joinery.box((a, b, 0.0), (a + 0.06, b + 0.06, TABLE - 0.04), piece_colour(rng))
    else:
        joinery.box((-x, -y, 0.0), (-x + 0.45, y, TABLE - 0.04), top)
        joinery.box((x - 0.05, -y, 0.0), (x, y, TABLE - 0.04), top)
    for _ in range(int(rng.integers(0, 9))):
        _laid(rng, joinery, rng.uniform(-x + 0.2, x - 0.2), rng.uniform(-y + 0.15, y - 0.15))
    return joinery.put(spot, yaw)


def _laid(rng: np.random.Generator, joinery: Joinery, x: float, y: float) -> None:
    """Paper, a laptop, a monitor, a bottle or a heap on a table."""
    kind, z = rng.random(), TABLE
    if kind < 0.45:
        a, b = rng.uniform(0.1, 0.3, 2)
        joinery.box((x - a / 2, y - b / 2, z), (x + a / 2, y + b / 2, z + 0.005), WHITE)
    elif kind < 0.6:
        side = -1 if rng.random() < 0.5 else 1
        joinery.box((x - 0.17, y - 0.12, z), (x + 0.17, y + 0.12, z + 0.02), BLACK)
        edge = sorted((y + side * 0.12, y + side * 0.14))
        joinery.box((x - 0.17, edge[0], z), (x + 0.17, edge[1], z + 0.22), piece_colour(rng))
    elif kind < 0.75:
        joinery.box((x - 0.27, y - 0.02, z + 0.1), (x + 0.27, y + 0.02, z + 0.45), BLACK)
        joinery.box((x - 0.1, y - 0.08, z), (x + 0.1, y + 0.08, z + 0.1), BLACK)
    else:
        a, high = rng.uniform(0.03, 0.15), rng.uniform(0.05, 0.3)
        joinery.box((x - a, y - a, z), (x + a, y + a, z + high), piece_colour(rng))


def cabinet(rng: np.random.Generator, spot: FloatArray, yaw: float) -> Thing:
    """A shelf, a box, a bin or a machine."""
    joinery, colour = Joinery(rng), piece_colour(rng)
    x, y = rng.uniform(0.15, 0.7), rng.uniform(0.15, 0.3)
    high = float(rng.choice([rng.uniform(0.3, 0.9), rng.uniform(0.9, 2.0)]))
    pattern = pattern_of(
        rng, Pattern.PLAIN, Pattern.PLAIN, Pattern.CLOUDS, Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS
    )
    joinery.box((-x, -y, 0.0), (x, y, high), colour, pattern)
    if high < 1.2:
        for _ in range(int(rng.integers(0, 4))):
            a, b, c = rng.uniform(0.04, 0.15, 3)
            left = rng.uniform(-x + a, x - a) if x > a else 0.0
            joinery.box((left - a, -b, high), (left + a, b, high + 2 * c), piece_colour(rng))
    return joinery.put(spot, yaw)


def plant(rng: np.random.Generator, spot: FloatArray) -> Thing:
    """Leaves over a pot, or a stand with clothes on it."""
    count, green = int(rng.integers(3, 8)), rng.random() < 0.7
    height = rng.uniform(0.6, 1.7)
    low = np.array([*spot, 0.0])
    start = low + np.column_stack([rng.normal(0, 0.12, (count, 2)), rng.uniform(0.35, 1.0, count) * height])
    end = start + np.column_stack([rng.normal(0, 0.12, (count, 2)), rng.uniform(-0.3, 0.2, count)])
    start, end = np.concatenate([low[None], start]), np.concatenate([low[None] + [0, 0, 0.4 * height], end])
    surfaces = []
    for k in range(count + 1):
        shade = rng.uniform(0.15, 0.45)
        leaf = (0.4 * shade, shade, 0.3 * shade) if green else piece_colour(rng)
        colour, pattern = piece_colour(rng) if k == 0 else leaf, Pattern.LEAVES if green and k else Pattern.PLAIN
        surfaces.append(Surface(colour, None, pattern, 0.08, 0.3, phase=float(rng.random())))
    radius = np.column_stack([rng.uniform(0.08, 0.2, count + 1), rng.uniform(0.05, 0.15, count + 1)])
    radius[0] = 0.12
    front = np.tile([0.0, 1.0, 0.0], (count + 1, 1))
    return Thing(cone_spheres(start, end, radius, front, np.ones(count + 1), surfaces))


def panels(rng: np.random.Generator, size: FloatArray, count: int) -> list[Thing]:
    """Doors, windows, posters and screens on the walls of a room of ``size`` ``(3,)`` metres."""
    things = []
    for _ in range(count):
        joinery, side = Joinery(rng), int(rng.integers(4))
        half = rng.uniform(0.2, 1.0)
        bottom = 0.0 if rng.random() < 0.3 else rng.uniform(0.6, 1.4)
        top = min(bottom + rng.uniform(0.5, 2.0), float(size[2]) - 0.1)
        frame, inside = piece_colour(rng), WHITE if rng.random() < 0.35 else piece_colour(rng)
        pattern = pattern_of(rng, Pattern.PLAIN, Pattern.PLAIN, Pattern.CLOUDS, Pattern.CHECKS, Pattern.ACROSS)
        joinery.box((-half, 0.0, bottom), (half, 0.03, top), frame)
        joinery.box((-half + 0.06, 0.03, bottom + 0.06), (half - 0.06, 0.045, top - 0.06), inside, pattern)
        things.append(joinery.put(*at_wall(size, side, rng.uniform(0.12, 0.88), 0.0)))
    return things
