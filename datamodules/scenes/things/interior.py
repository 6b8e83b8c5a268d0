"""What stands in offices, halls and shops: chairs, laid tables, shelves, plants, pictures on the walls."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsuiseki.datamodules.scenes.render.scene import Thing
from tsuiseki.datamodules.scenes.render.solids import Colour, Pattern, Surface, as_colour, boxes, cone_spheres
from tsuiseki.tracking.types import FloatArray

SEAT, TABLE = 0.45, 0.73
# Longest side of a box: a wide view bends longer edges.
PIECE = 0.45
WHITE: Colour = (0.93, 0.93, 0.92)
BLACK: Colour = (0.06, 0.06, 0.07)


def any_colour(rng: np.random.Generator) -> Colour:
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
    made, seat, frame = Joinery(rng), any_colour(rng), BLACK if rng.random() < 0.6 else any_colour(rng)
    half, top = rng.uniform(0.2, 0.26), rng.uniform(0.75, 1.1)
    made.box((-half, -half, SEAT - 0.06), (half, half, SEAT - 0.01), seat)
    made.box((-half, -half - 0.05, rng.uniform(SEAT, 0.6)), (half, -half, top), seat)
    if rng.random() < 0.5:
        for x in (-half, half - 0.03):
            for y in (-half, half - 0.03):
                made.box((x, y, 0.0), (x + 0.03, y + 0.03, SEAT - 0.06), frame)
    else:
        made.box((-0.03, -0.03, 0.08), (0.03, 0.03, SEAT - 0.06), frame)
        made.box((-0.28, -0.03, 0.03), (0.28, 0.03, 0.08), frame)
        made.box((-0.03, -0.28, 0.03), (0.03, 0.28, 0.08), frame)
    if rng.random() < 0.5:
        for x in (-half - 0.04, half):
            made.box((x, -half, 0.62), (x + 0.04, half, 0.66), frame)
    if rng.random() < 0.15:
        # A coat over the back.
        made.box(
            (-half - 0.02, -half - 0.12, 0.45), (half + 0.02, -half - 0.04, top + 0.04), any_colour(rng), Pattern.CLOUDS
        )
    return made.put(spot, heading - np.pi / 2)


def table(rng: np.random.Generator, spot: FloatArray, yaw: float, half: tuple[float, float]) -> Thing:
    """A table or desk with what lies on it."""
    made, top = Joinery(rng), any_colour(rng)
    x, y = half
    wood = int(rng.choice([Pattern.PLAIN, Pattern.PLAIN, Pattern.ALONG, Pattern.CLOUDS]))
    made.box((-x, -y, TABLE - 0.04), (x, y, TABLE), top, wood)
    if rng.random() < 0.6:
        for a in (-x + 0.03, x - 0.09):
            for b in (-y + 0.03, y - 0.09):
                made.box((a, b, 0.0), (a + 0.06, b + 0.06, TABLE - 0.04), any_colour(rng))
    else:
        made.box((-x, -y, 0.0), (-x + 0.45, y, TABLE - 0.04), top)
        made.box((x - 0.05, -y, 0.0), (x, y, TABLE - 0.04), top)
    for _ in range(int(rng.integers(0, 9))):
        _laid(rng, made, rng.uniform(-x + 0.2, x - 0.2), rng.uniform(-y + 0.15, y - 0.15))
    return made.put(spot, yaw)


def _laid(rng: np.random.Generator, made: Joinery, x: float, y: float) -> None:
    """Paper, a laptop, a monitor, a bottle or a heap on a table."""
    kind, z = rng.random(), TABLE
    if kind < 0.45:
        a, b = rng.uniform(0.1, 0.3, 2)
        made.box((x - a / 2, y - b / 2, z), (x + a / 2, y + b / 2, z + 0.005), WHITE)
    elif kind < 0.6:
        side = -1 if rng.random() < 0.5 else 1
        made.box((x - 0.17, y - 0.12, z), (x + 0.17, y + 0.12, z + 0.02), BLACK)
        edge = sorted((y + side * 0.12, y + side * 0.14))
        made.box((x - 0.17, edge[0], z), (x + 0.17, edge[1], z + 0.22), any_colour(rng))
    elif kind < 0.75:
        made.box((x - 0.27, y - 0.02, z + 0.1), (x + 0.27, y + 0.02, z + 0.45), BLACK)
        made.box((x - 0.1, y - 0.08, z), (x + 0.1, y + 0.08, z + 0.1), BLACK)
    else:
        a, high = rng.uniform(0.03, 0.15), rng.uniform(0.05, 0.3)
        made.box((x - a, y - a, z), (x + a, y + a, z + high), any_colour(rng))


def cabinet(rng: np.random.Generator, spot: FloatArray, yaw: float) -> Thing:
    """A shelf, a box, a bin or a machine."""
    made, colour = Joinery(rng), any_colour(rng)
    x, y = rng.uniform(0.15, 0.7), rng.uniform(0.15, 0.3)
    high = float(rng.choice([rng.uniform(0.3, 0.9), rng.uniform(0.9, 2.0)]))
    pattern = int(
        rng.choice([Pattern.PLAIN, Pattern.PLAIN, Pattern.CLOUDS, Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS])
    )
    made.box((-x, -y, 0.0), (x, y, high), colour, pattern)
    if high < 1.2:
        for _ in range(int(rng.integers(0, 4))):
            a, b, c = rng.uniform(0.04, 0.15, 3)
            left = rng.uniform(-x + a, x - a) if x > a else 0.0
            made.box((left - a, -b, high), (left + a, b, high + 2 * c), any_colour(rng))
    return made.put(spot, yaw)


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
        leaf = (0.4 * shade, shade, 0.3 * shade) if green else any_colour(rng)
        colour = any_colour(rng) if k == 0 else leaf
        surfaces.append(
            Surface(
                colour, None, Pattern.LEAVES if green and k else Pattern.PLAIN, 0.08, 0.3, phase=float(rng.random())
            )
        )
    radius = np.column_stack([rng.uniform(0.08, 0.2, count + 1), rng.uniform(0.05, 0.15, count + 1)])
    radius[0] = 0.12
    return Thing(cone_spheres(start, end, radius, np.tile([0.0, 1.0, 0.0], (count + 1, 1)), np.ones(count + 1),
                              surfaces))  # fmt: skip


def panels(rng: np.random.Generator, size: FloatArray, count: int) -> list[Thing]:
    """Doors, windows, posters and screens on the walls of a room of ``size`` ``(3,)`` metres."""
    things = []
    for _ in range(count):
        made, side = Joinery(rng), int(rng.integers(4))
        half = rng.uniform(0.2, 1.0)
        bottom = 0.0 if rng.random() < 0.3 else rng.uniform(0.6, 1.4)
        top = min(bottom + rng.uniform(0.5, 2.0), float(size[2]) - 0.1)
        frame, inside = any_colour(rng), WHITE if rng.random() < 0.35 else any_colour(rng)
        pattern = int(rng.choice([Pattern.PLAIN, Pattern.PLAIN, Pattern.CLOUDS, Pattern.CHECKS, Pattern.ACROSS]))
        made.box((-half, 0.0, bottom), (half, 0.03, top), frame)
        made.box((-half + 0.06, 0.03, bottom + 0.06), (half - 0.06, 0.045, top - 0.06), inside, pattern)
        along = rng.uniform(0.12, 0.88)
        spot = [(0.0, along * size[1]), (size[0], along * size[1]), (along * size[0], 0.0), (along * size[0], size[1])]
        things.append(made.put(np.array(spot[side]), (-np.pi / 2, np.pi / 2, 0.0, np.pi)[side]))
    return things
