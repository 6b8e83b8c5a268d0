"""Colours and rows of solids that the things of a street are put together from."""

from __future__ import annotations

import numpy as np

from tsuiseki.datamodules.scenes.people.look import BRIGHT, DARK, LIGHT, MIDDLE, Colour
from tsuiseki.datamodules.scenes.render.solids import Solids, Surfaces, cone_spheres
from tsuiseki.tracking.types import FloatArray

UP = np.array([0.0, 0.0, 1.0])


def colour_of(rng: np.random.Generator, palette: tuple[Colour, ...]) -> Colour:
    """A colour near one of ``palette``."""
    base = np.array(palette[int(rng.integers(len(palette)))]) * rng.uniform(0.8, 1.2)
    r, g, b = np.clip(base + rng.normal(0, 0.03, 3), 0.02, 0.98)
    return float(r), float(g), float(b)


def any_colour(rng: np.random.Generator) -> Colour:
    """Dark, middling, light or bright."""
    return colour_of(rng, (DARK, MIDDLE, LIGHT, BRIGHT)[int(rng.choice(4, p=(0.3, 0.3, 0.2, 0.2)))])


def rounds(rows: list[tuple[FloatArray, FloatArray, float, float]], surfaces: Surfaces, flat: float = 1.0) -> Solids:
    """Cone-spheres of rows of start, end and the two radii; ``flat`` scales them along x."""
    start, end = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    radius = np.array([[r[2], r[3]] for r in rows])
    front = np.tile([[1.0, 0.0, 0.0]], (len(rows), 1))
    return cone_spheres(start, end, radius, front, np.full(len(rows), flat), surfaces)


def above(position: FloatArray, z: float = 0.0) -> FloatArray:
    """``(3,)``, ``z`` metres over ``position`` ``(2,)``."""
    return np.array([position[0], position[1], z])
