"""What stands about in towns and looks somewhat like people: lights, signs, meters, bins, bicycles, shops, doors.

Most of it is upright, as high as people, of several parts above one another in colours that clothes have.
"""

from __future__ import annotations

import itertools

import numpy as np

from tsuiseki.datamodules.scenes.people.look import BRIGHT, DARK, LIGHT, MIDDLE, Colour, any_colour, colour_of
from tsuiseki.datamodules.scenes.render.solids import (
    BRICKS,
    CHECKS,
    CLOUDS,
    LEAVES,
    PLAIN,
    SPECKLE,
    STRIPES_ACROSS,
    STRIPES_ALONG,
    UP,
    Solids,
    Surfaces,
    above,
    boxes,
    join,
    rounds,
)
from tsuiseki.tracking.types import FloatArray

_LAMPS: tuple[Colour, ...] = ((0.98, 0.15, 0.10), (0.98, 0.65, 0.10), (0.15, 0.95, 0.45))
_LEAF: tuple[Colour, ...] = ((0.16, 0.28, 0.12), (0.26, 0.38, 0.16), (0.34, 0.34, 0.18))
# Things go into the middle of a wall's thickness, so that they stand out of both sides by a little.
_WALL = 0.1


def _along(yaw: float) -> FloatArray:
    return np.array([np.cos(yaw), np.sin(yaw), 0.0])


def _across(yaw: float) -> FloatArray:
    return np.array([-np.sin(yaw), np.cos(yaw), 0.0])


def _tube(position: FloatArray, low: float, high: float, radius: float, colour: Colour, flat: float = 1.0) -> Solids:
    surfaces = Surfaces()
    surfaces.add(colour, relief=0.05)
    return rounds([(above(position, low), above(position, high), radius, radius)], surfaces, flat)


def _block(
    centre: FloatArray, half: tuple[float, float, float], yaw: float, colour: Colour, second: Colour | None = None,
    pattern: int = PLAIN, period: float = 0.2,
) -> Solids:  # fmt: skip
    surfaces = Surfaces()
    surfaces.add(colour, second, pattern, period, 0.05)
    return boxes(centre[None], np.array([half]), np.array([yaw]), surfaces)


def traffic_light(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A post with one or two heads of lamps, one lamp lit in each, perhaps before a plate."""
    height, thick = float(rng.uniform(2.2, 5.5)), float(rng.uniform(0.04, 0.08))
    metal = colour_of(rng, DARK + MIDDLE[:1])
    parts = [_tube(position, 0.0, height, thick, metal)]
    tops = [height] + ([float(rng.uniform(1.8, height - 0.6))] if height > 3 and rng.random() < 0.5 else [])
    for top in tops:
        lamps = int(rng.integers(2, 4))
        size = float(rng.uniform(0.08, 0.15))
        middle = above(position, top - size * lamps)
        casing = colour_of(rng, DARK[:2]) if rng.random() < 0.7 else colour_of(rng, BRIGHT)
        if rng.random() < 0.35:
            rim = (1.9 * size, 0.01, (lamps + 0.7) * size)
            parts.append(_block(middle, rim, yaw, colour_of(rng, LIGHT[:1] + DARK[:1])))
        parts.append(_block(middle, (1.25 * size, 0.1, (lamps + 0.2) * size), yaw, casing))
        lit = int(rng.integers(lamps))
        surfaces, rows = Surfaces(), []
        for lamp in range(lamps):
            colour = _LAMPS[lamp if lamps == 3 else 2 * lamp]
            surfaces.add(colour if lamp == lit else tuple(0.25 * c for c in colour), relief=0.02)  # type: ignore[arg-type]
            hub = middle + (lamps - 1 - 2 * lamp) * size * UP
            rows.append((hub - 0.11 * _across(yaw), hub + 0.11 * _across(yaw), 0.8 * size, 0.8 * size))
        parts.append(rounds(rows, surfaces))
    return join(parts)


def road_sign(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A post with one to three discs or plates, each with a field of another colour."""
    height = float(rng.uniform(1.6, 3.4))
    parts = [_tube(position, 0.0, height, float(rng.uniform(0.025, 0.05)), colour_of(rng, MIDDLE[:1] + LIGHT[:2]))]
    top = height
    for _ in range(int(rng.integers(1, 4))):
        size = float(rng.uniform(0.18, 0.42))
        outer, inner = colour_of(rng, BRIGHT + LIGHT[:1]), colour_of(rng, LIGHT[:2] + BRIGHT + DARK[:1])
        middle = above(position, top - size)
        if rng.random() < 0.5:
            surfaces = Surfaces()
            surfaces.add(outer, relief=0.02)
            surfaces.add(inner, relief=0.02)
            face = 0.02 * _across(yaw)
            parts.append(
                rounds([(middle - k * face, middle + k * face, r * size, r * size) for k, r in ((1, 1), (1.5, 0.7))],
                       surfaces)
            )  # fmt: skip
        else:
            high = size * float(rng.uniform(0.5, 1.5))
            middle = above(position, top - high)
            pattern = int(rng.choice([PLAIN, STRIPES_ACROSS, STRIPES_ALONG, SPECKLE]))
            parts.append(_block(middle, (size, 0.015, high), yaw, outer, inner, pattern, float(rng.uniform(0.1, 0.5))))
            size = high
        top -= 2.1 * size
        if top < 0.9:
            break
    return join(parts)


def bollards(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """One to six posts in a row, as high as children, some with a band or a ball on top."""
    height, radius = float(rng.uniform(0.5, 1.25)), float(rng.uniform(0.05, 0.16))
    colour, band = any_colour(rng), colour_of(rng, LIGHT + BRIGHT)
    step = float(rng.uniform(0.9, 2.0)) * _along(yaw)[:2]
    parts = []
    for k in range(int(rng.integers(1, 7))):
        place = position + k * step
        parts.append(_tube(place, 0.0, height, radius, colour))
        if height > 0.8 or colour[0] < 0.2:
            parts.append(_tube(place, 0.8 * height, 0.86 * height, 1.1 * radius, band))
    return join(parts)


def meter(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A thing with a head on a body: a parking meter, a ticket machine, a letter box, a hydrant."""
    low = float(rng.uniform(0.5, 1.1))
    body = float(rng.uniform(0.04, 0.25))
    colour = any_colour(rng)
    parts = [_tube(position, 0.0, low, body, colour, float(rng.uniform(0.5, 1.0)))]
    high = float(rng.uniform(0.1, 0.35))
    if rng.random() < 0.5:
        half = (float(rng.uniform(0.08, 0.3)), float(rng.uniform(0.08, 0.2)), high)
        parts.append(_block(above(position, low + high), half, yaw, any_colour(rng), any_colour(rng), STRIPES_ACROSS))
    else:
        size = float(rng.uniform(0.08, 0.16))
        parts.append(_tube(position, low + size, low + 1.5 * size, size, any_colour(rng)))
    return join(parts)


def bin_(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """One to three bins on wheels or round ones, lids in another colour."""
    step = float(rng.uniform(0.7, 0.9)) * _along(yaw)[:2]
    parts = []
    body, lid, round_ = any_colour(rng), any_colour(rng), rng.random() < 0.4
    half = rng.uniform([0.2, 0.2, 0.4], [0.38, 0.4, 0.65])
    for k in range(int(rng.integers(1, 4))):
        place = position + k * step
        if round_:
            parts.append(_tube(place, 0.0, 2 * half[2], half[0], body))
            parts.append(_tube(place, 2 * half[2], 2 * half[2] + 0.1, 1.08 * half[0], lid))
        else:
            parts.append(_block(above(place, 0.1 + half[2]), tuple(half), yaw, body))
            size = (1.06 * half[0], 1.06 * half[1], 0.05)
            parts.append(_block(above(place, 0.15 + 2 * half[2]), size, yaw, lid))
    return join(parts)


def bicycle(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """One to four bicycles beside one another: rings, a frame, a saddle, handlebars."""
    surfaces, rows = Surfaces(), []
    for k in range(int(rng.integers(1, 5))):
        base = above(position) + k * float(rng.uniform(0.35, 0.7)) * _across(yaw)
        ahead, paint = _along(yaw + float(rng.normal(0, 0.1))), any_colour(rng)
        angles = np.linspace(0, 2 * np.pi, 9)
        for hub in (base - 0.52 * ahead + 0.34 * UP, base + 0.52 * ahead + 0.34 * UP):
            ring = hub + 0.32 * (np.cos(angles)[:, None] * ahead + np.sin(angles)[:, None] * UP)
            rows += [(a, b, 0.022, 0.022) for a, b in itertools.pairwise(ring)]
        back, front = base - 0.52 * ahead + 0.34 * UP, base + 0.52 * ahead + 0.34 * UP
        crank, seat, neck = base + 0.3 * UP, base - 0.18 * ahead + 0.9 * UP, base + 0.38 * ahead + 0.95 * UP
        tubes = [(back, crank), (crank, seat), (crank, neck), (seat, neck), (back, seat), (neck, front)]
        rows += [(a, b, 0.02, 0.02) for a, b in tubes]
        bar = 0.28 * _across(yaw)
        rows += [(seat - 0.1 * ahead, seat + 0.12 * ahead, 0.06, 0.03), (neck - bar, neck + bar, 0.02, 0.02)]
        for row in range(24):
            surfaces.add(paint if 16 <= row < 22 else (0.08, 0.08, 0.08), relief=0.03)
    return rounds(rows, surfaces)


def parasol(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """Closed it is as a person in a long coat, open a roof on a post."""
    del yaw
    height = float(rng.uniform(1.6, 3.0))
    surfaces = Surfaces()
    surfaces.add(colour_of(rng, LIGHT[:2] + DARK[:2]), relief=0.05)
    surfaces.add(any_colour(rng), any_colour(rng), int(rng.choice([PLAIN, STRIPES_ALONG])), 0.2, 0.1)
    post = (above(position), above(position, height), 0.03, 0.03)
    if rng.random() < 0.7:
        low = height * float(rng.uniform(0.2, 0.5))
        cloth = (above(position, low), above(position, height), float(rng.uniform(0.1, 0.25)), 0.05)
    else:
        reach = float(rng.uniform(0.9, 1.6))
        cloth = (above(position, height - 0.3), above(position, height - 0.15), reach, 0.7 * reach)
    solids = rounds([post], _first(surfaces, 0))
    return join([solids, rounds([cloth], _first(surfaces, 1), 1.0 if rng.random() < 0.5 else 0.8)])


def _first(surfaces: Surfaces, row: int) -> Surfaces:
    """One row of several."""
    return Surfaces(*([getattr(surfaces, name)[row]] for name in vars(surfaces)))


def torso(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """Clothes on a stand without head, arms and legs."""
    low = float(rng.uniform(0.6, 1.0))
    surfaces = Surfaces()
    cloth, second = any_colour(rng), any_colour(rng)
    pattern = int(rng.choice([PLAIN, PLAIN, STRIPES_ACROSS, CHECKS]))
    for _ in range(2):
        surfaces.add(cloth, second, pattern, float(rng.uniform(0.05, 0.15)), 0.15)
    waist, neck = above(position, low + 0.25), above(position, low + 0.62)
    rows = [(above(position, low), waist, 0.17, 0.13), (waist, neck, 0.13, float(rng.uniform(0.1, 0.16)))]
    stand = _tube(position, 0.0, low, 0.02, colour_of(rng, DARK + LIGHT))
    foot = _tube(position, 0.0, 0.03, 0.2, colour_of(rng, DARK))
    del yaw
    return join([rounds(rows, surfaces, float(rng.uniform(0.6, 0.9))), stand, foot])


def board(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A poster in a frame, a banner, a board on the pavement, a pillar for notices."""
    colour, second = any_colour(rng), any_colour(rng)
    pattern = int(rng.choice([PLAIN, STRIPES_ACROSS, STRIPES_ALONG, SPECKLE, CLOUDS, CHECKS]))
    period = float(rng.uniform(0.2, 1.2))
    if rng.random() < 0.2:
        surfaces = Surfaces()
        surfaces.add(colour, second, pattern, period, 0.05)
        radius, height = float(rng.uniform(0.3, 0.7)), float(rng.uniform(1.8, 3.2))
        return rounds([(above(position), above(position, height), radius, radius)], surfaces)
    half = rng.uniform([0.2, 0.02, 0.4], [0.7, 0.1, 1.1])
    low = float(rng.uniform(0.0, 0.9))
    frame = (half[0] + 0.05, 0.6 * half[1], half[2] + 0.05)
    middle = above(position, low + half[2] + 0.05)
    parts = [_block(middle, frame, yaw, colour_of(rng, DARK + LIGHT[:2]))]
    parts.append(_block(middle, tuple(half), yaw, colour, second, pattern, period))
    if low > 0.1:
        parts += [
            _tube(position + side * half[0] * _along(yaw)[:2], 0.0, low, 0.03, (0.2, 0.2, 0.2)) for side in (-1, 1)
        ]
    return join(parts)


def planter(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A narrow shrub or a clipped tree in a tub, as tall as people."""
    tub = float(rng.uniform(0.2, 0.45))
    parts = [_block(above(position, tub), (tub, tub, tub), yaw, any_colour(rng))]
    green = colour_of(rng, _LEAF)
    surfaces, rows = Surfaces(), []
    low, height = 2 * tub, float(rng.uniform(0.6, 1.8))
    for k in range(3):
        surfaces.add(
            green, (0.4 * green[0], 0.4 * green[1], 0.4 * green[2]), LEAVES, float(rng.uniform(0.4, 1.5)), 0.05
        )
        radius = float(rng.uniform(0.15, 0.4)) * (1 - 0.25 * k)
        rows.append(
            (above(position, low + k * height / 3), above(position, low + (k + 1) * height / 3), radius, 0.8 * radius)
        )
    return join([*parts, rounds(rows, surfaces)])


THINGS = (traffic_light, road_sign, bollards, meter, bin_, bicycle, parasol, torso, board, planter)
SHARES = (0.18, 0.18, 0.08, 0.1, 0.08, 0.09, 0.07, 0.05, 0.1, 0.07)


def random_town_thing(rng: np.random.Generator, position: FloatArray) -> Solids:
    """One thing of a town that is nobody, standing at ``position`` ``(2,)``."""
    make = THINGS[int(rng.choice(len(THINGS), p=SHARES))]
    return make(rng, position, float(rng.uniform(0, 2 * np.pi)))


def front(rng: np.random.Generator, position: FloatArray, yaw: float) -> Solids:
    """A wall with doors and windows in rows, shop windows below with clothes on stands, a sign above them."""
    wide, storeys = float(rng.uniform(3.0, 14.0)), int(rng.integers(1, 4))
    storey = float(rng.uniform(2.6, 3.6))
    wall = colour_of(rng, MIDDLE + LIGHT + ((0.55, 0.38, 0.28),))
    high = storey * storeys / 2
    pattern = BRICKS if rng.random() < 0.4 else PLAIN
    grout = tuple(0.8 * c + 0.1 for c in wall)
    parts = [_block(above(position, high), (wide / 2, _WALL / 2, high), yaw, wall, grout, pattern, 0.2)]  # type: ignore[arg-type]
    lit = rng.random() < 0.35
    glass = colour_of(rng, LIGHT if lit else DARK)
    for level in range(storeys):
        shops = level == 0 and rng.random() < 0.6
        step = float(rng.uniform(1.6, 3.2) if shops else rng.uniform(1.0, 2.6))
        half_w = step * float(rng.uniform(0.3, 0.45) if shops else rng.uniform(0.15, 0.35))
        half_h, low = float(rng.uniform(0.5, 1.0)), float(rng.uniform(0.5, 1.1))
        if shops:
            half_h, low = float(rng.uniform(0.9, 1.15)), 0.3
        for x in np.arange(-wide / 2 + step / 2, wide / 2 - step / 3, step):
            place = position + x * _along(yaw)[:2]
            door = level == 0 and rng.random() < 0.3
            parts += _opening(rng, place, yaw, level * storey, (half_w, half_h, low), glass, door)
            if shops and not door and rng.random() < 0.5:
                parts.append(torso(rng, place - 0.12 * _across(yaw)[:2], yaw))
                parts.append(torso(rng, place + 0.12 * _across(yaw)[:2], yaw))
        if shops:
            name = above(position, 0.85 * storey)
            sign = (0.95 * wide / 2, _WALL, 0.2)
            parts.append(_block(name, sign, yaw, any_colour(rng), any_colour(rng), STRIPES_ALONG, 0.4))
    return join(parts)


def _opening(
    rng: np.random.Generator, place: FloatArray, yaw: float, floor: float, size: tuple[float, float, float],
    glass: Colour, door: bool,
) -> list[Solids]:  # fmt: skip
    """A door with a pane, or a window with a frame and perhaps a blind, ``floor`` metres up.

    Args:
        rng: draws colours and proportions.
        place: ``(2,)``.
        yaw: of the wall.
        floor: metres.
        size: half the width, half the height and the height of the lower edge of a window.
        glass: its colour.
        door: it is one.
    """
    wide, high, low = (float(rng.uniform(0.4, 0.6)), float(rng.uniform(0.95, 1.15)), 0.0) if door else size
    middle = above(place, floor + low + high)
    parts = [_block(middle, (wide, 0.55 * _WALL, high), yaw, any_colour(rng))]
    if door:
        pane = high * float(rng.uniform(0.15, 0.8))
        top = middle + (0.85 * high - pane) * UP
        return [*parts, _block(top, (0.7 * wide, 0.6 * _WALL, pane), yaw, glass)]
    parts.append(_block(middle, (0.88 * wide, 0.6 * _WALL, 0.92 * high), yaw, glass))
    if rng.random() < 0.4:
        drop = high * float(rng.uniform(0.1, 0.6))
        blind = middle + (0.92 * high - drop) * UP
        parts.append(_block(blind, (0.86 * wide, 0.65 * _WALL, drop), yaw, any_colour(rng), None))
    return parts
