"""What stands about in towns and looks somewhat like people: lights, signs, meters, bins, bicycles, shops, doors.

Most of it is upright, as high as people, of several parts above one another in colours that clothes have.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np

from tsuiseki.datamodules.scenes.people.outfit import BRIGHT, DARK, LIGHT, MIDDLE, any_colour, colour_of
from tsuiseki.datamodules.scenes.render.composing import Thing
from tsuiseki.datamodules.scenes.render.solids import UP, Colour, Parts, Pattern, Surface, across, along, pattern_of
from tsuiseki.tracking.types import FloatArray

# Red, yellow and green lamps of a traffic light, sRGB.
_LAMPS: tuple[Colour, ...] = ((0.98, 0.15, 0.10), (0.98, 0.65, 0.10), (0.15, 0.95, 0.45))
# Colours of leaves, sRGB.
_LEAF: tuple[Colour, ...] = ((0.16, 0.28, 0.12), (0.26, 0.38, 0.16), (0.34, 0.34, 0.18))
# Things go into the middle of a wall's thickness, so that they stand out of both sides by a little.
_WALL = 0.1


def _tube(parts: Parts, low: float, high: float, radius: float, colour: Colour, flat: float = 1.0) -> None:
    parts.cone(parts.at(up=low), parts.at(up=high), (radius, radius), Surface(colour, relief=0.05), flat)


def traffic_light(rng: np.random.Generator, parts: Parts) -> None:
    """A post with one or two heads of lamps, one lamp lit in each, perhaps before a plate."""
    height, thick = float(rng.uniform(2.2, 5.5)), float(rng.uniform(0.04, 0.08))
    _tube(parts, 0.0, height, thick, colour_of(rng, DARK + MIDDLE[:1]))
    tops = [height] + ([float(rng.uniform(1.8, height - 0.6))] if height > 3 and rng.random() < 0.5 else [])
    for top in tops:
        lamps = int(rng.integers(2, 4))
        size = float(rng.uniform(0.08, 0.15))
        middle = parts.at(up=top - size * lamps)
        casing = colour_of(rng, DARK[:2]) if rng.random() < 0.7 else colour_of(rng, BRIGHT)
        if rng.random() < 0.35:
            rim = (1.9 * size, 0.01, (lamps + 0.7) * size)
            parts.box(middle, rim, Surface(colour_of(rng, LIGHT[:1] + DARK[:1]), relief=0.05))
        parts.box(middle, (1.25 * size, 0.1, (lamps + 0.2) * size), Surface(casing, relief=0.05))
        lit, aside = int(rng.integers(lamps)), 0.11 * across(parts.yaw)
        for lamp in range(lamps):
            red, green, blue = _LAMPS[lamp if lamps == 3 else 2 * lamp]
            share = 1.0 if lamp == lit else 0.25
            hub = middle + (lamps - 1 - 2 * lamp) * size * UP
            glass = Surface((share * red, share * green, share * blue), relief=0.02)
            parts.cone(hub - aside, hub + aside, (0.8 * size, 0.8 * size), glass)


def road_sign(rng: np.random.Generator, parts: Parts) -> None:
    """A post with one to three discs or plates, each with a field of another colour."""
    height = float(rng.uniform(1.6, 3.4))
    _tube(parts, 0.0, height, float(rng.uniform(0.025, 0.05)), colour_of(rng, MIDDLE[:1] + LIGHT[:2]))
    top = height
    for _ in range(int(rng.integers(1, 4))):
        size = float(rng.uniform(0.18, 0.42))
        outer, inner = colour_of(rng, BRIGHT + LIGHT[:1]), colour_of(rng, LIGHT[:2] + BRIGHT + DARK[:1])
        if rng.random() < 0.5:
            middle, face = parts.at(up=top - size), 0.02 * across(parts.yaw)
            for colour, k, r in ((outer, 1, 1), (inner, 1.5, 0.7)):
                disc = Surface(colour, relief=0.02)
                parts.cone(middle - k * face, middle + k * face, (r * size, r * size), disc)
        else:
            high = size * float(rng.uniform(0.5, 1.5))
            pattern = pattern_of(rng, Pattern.PLAIN, Pattern.ACROSS, Pattern.ALONG, Pattern.SPECKLE)
            plate = Surface(outer, inner, pattern, float(rng.uniform(0.1, 0.5)), 0.05)
            parts.box(parts.at(up=top - high), (size, 0.015, high), plate)
            size = high
        top -= 2.1 * size
        if top < 0.9:
            break


def bollards(rng: np.random.Generator, parts: Parts) -> None:
    """One to six posts in a row, as high as children, some with a band or a ball on top."""
    height, radius = float(rng.uniform(0.5, 1.25)), float(rng.uniform(0.05, 0.16))
    colour, band = any_colour(rng), colour_of(rng, LIGHT + BRIGHT)
    step = float(rng.uniform(0.9, 2.0))
    for k in range(int(rng.integers(1, 7))):
        post = parts.beside(k * step)
        _tube(post, 0.0, height, radius, colour)
        if height > 0.8 or colour[0] < 0.2:
            _tube(post, 0.8 * height, 0.86 * height, 1.1 * radius, band)


def meter(rng: np.random.Generator, parts: Parts) -> None:
    """A thing with a head on a body: a parking meter, a ticket machine, a letter box, a hydrant."""
    low, body = float(rng.uniform(0.5, 1.1)), float(rng.uniform(0.04, 0.25))
    _tube(parts, 0.0, low, body, any_colour(rng), float(rng.uniform(0.5, 1.0)))
    high = float(rng.uniform(0.1, 0.35))
    if rng.random() < 0.5:
        half = (float(rng.uniform(0.08, 0.3)), float(rng.uniform(0.08, 0.2)), high)
        head = Surface(any_colour(rng), any_colour(rng), Pattern.ACROSS, 0.2, 0.05)
        parts.box(parts.at(up=low + high), half, head)
    else:
        size = float(rng.uniform(0.08, 0.16))
        _tube(parts, low + size, low + 1.5 * size, size, any_colour(rng))


def bin_(rng: np.random.Generator, parts: Parts) -> None:
    """One to three bins on wheels or round ones, lids in another colour."""
    step = float(rng.uniform(0.7, 0.9))
    body, lid, round_ = any_colour(rng), any_colour(rng), rng.random() < 0.4
    half = rng.uniform([0.2, 0.2, 0.4], [0.38, 0.4, 0.65])
    for k in range(int(rng.integers(1, 4))):
        container = parts.beside(k * step)
        if round_:
            _tube(container, 0.0, 2 * half[2], half[0], body)
            _tube(container, 2 * half[2], 2 * half[2] + 0.1, 1.08 * half[0], lid)
        else:
            container.box(container.at(up=0.1 + half[2]), half, Surface(body, relief=0.05))
            size = (1.06 * half[0], 1.06 * half[1], 0.05)
            container.box(container.at(up=0.15 + 2 * half[2]), size, Surface(lid, relief=0.05))


def bicycle(rng: np.random.Generator, parts: Parts) -> None:
    """One to four bicycles beside one another: rings, a frame, a saddle, handlebars."""
    black, bar = Surface((0.08, 0.08, 0.08), relief=0.03), 0.28 * across(parts.yaw)
    angles = np.linspace(0, 2 * np.pi, 9)
    for k in range(int(rng.integers(1, 5))):
        base = parts.at(left=k * float(rng.uniform(0.35, 0.7)))
        ahead, paint = along(parts.yaw + float(rng.normal(0, 0.1))), Surface(any_colour(rng), relief=0.03)
        back, front = base - 0.52 * ahead + 0.34 * UP, base + 0.52 * ahead + 0.34 * UP
        for hub in (back, front):
            ring = hub + 0.32 * (np.cos(angles)[:, None] * ahead + np.sin(angles)[:, None] * UP)
            for a, b in itertools.pairwise(ring):
                parts.cone(a, b, (0.022, 0.022), black)
        crank, seat, neck = base + 0.3 * UP, base - 0.18 * ahead + 0.9 * UP, base + 0.38 * ahead + 0.95 * UP
        for a, b in ((back, crank), (crank, seat), (crank, neck), (seat, neck), (back, seat), (neck, front)):
            parts.cone(a, b, (0.02, 0.02), paint)
        parts.cone(seat - 0.1 * ahead, seat + 0.12 * ahead, (0.06, 0.03), black)
        parts.cone(neck - bar, neck + bar, (0.02, 0.02), black)


def parasol(rng: np.random.Generator, parts: Parts) -> None:
    """Closed it is as a person in a long coat, open a roof on a post."""
    height = float(rng.uniform(1.6, 3.0))
    _tube(parts, 0.0, height, 0.03, colour_of(rng, LIGHT[:2] + DARK[:2]))
    cloth = Surface(any_colour(rng), any_colour(rng), pattern_of(rng, Pattern.PLAIN, Pattern.ALONG), 0.2, 0.1)
    if rng.random() < 0.7:
        low, high = height * float(rng.uniform(0.2, 0.5)), height
        radii = (float(rng.uniform(0.1, 0.25)), 0.05)
    else:
        low, high, reach = height - 0.3, height - 0.15, float(rng.uniform(0.9, 1.6))
        radii = (reach, 0.7 * reach)
    parts.cone(parts.at(up=low), parts.at(up=high), radii, cloth, 1.0 if rng.random() < 0.5 else 0.8)


def torso(rng: np.random.Generator, parts: Parts) -> None:
    """Clothes on a stand without head, arms and legs."""
    low = float(rng.uniform(0.6, 1.0))
    cloth, second = any_colour(rng), any_colour(rng)
    pattern = pattern_of(rng, Pattern.PLAIN, Pattern.PLAIN, Pattern.ACROSS, Pattern.CHECKS)
    surfaces = [Surface(cloth, second, pattern, float(rng.uniform(0.05, 0.15)), 0.15) for _ in range(2)]
    waist, upper = parts.at(up=low + 0.25), (0.13, float(rng.uniform(0.1, 0.16)))
    legs, feet = colour_of(rng, DARK + LIGHT), colour_of(rng, DARK)
    flat = float(rng.uniform(0.6, 0.9))
    parts.cone(parts.at(up=low), waist, (0.17, 0.13), surfaces[0], flat)
    parts.cone(waist, parts.at(up=low + 0.62), upper, surfaces[1], flat)
    _tube(parts, 0.0, low, 0.02, legs)
    _tube(parts, 0.0, 0.03, 0.2, feet)


def board(rng: np.random.Generator, parts: Parts) -> None:
    """A poster in a frame, a banner, a board on the pavement, a pillar for notices."""
    colour, second = any_colour(rng), any_colour(rng)
    patterns = (Pattern.ACROSS, Pattern.ALONG, Pattern.SPECKLE, Pattern.CLOUDS, Pattern.CHECKS)
    notices = Surface(colour, second, pattern_of(rng, Pattern.PLAIN, *patterns), float(rng.uniform(0.2, 1.2)), 0.05)
    if rng.random() < 0.2:
        radius, height = float(rng.uniform(0.3, 0.7)), float(rng.uniform(1.8, 3.2))
        parts.cone(parts.at(), parts.at(up=height), (radius, radius), notices)
        return
    half = rng.uniform([0.2, 0.02, 0.4], [0.7, 0.1, 1.1])
    low = float(rng.uniform(0.0, 0.9))
    frame = (half[0] + 0.05, 0.6 * half[1], half[2] + 0.05)
    middle = parts.at(up=low + half[2] + 0.05)
    parts.box(middle, frame, Surface(colour_of(rng, DARK + LIGHT[:2]), relief=0.05))
    parts.box(middle, half, notices)
    if low > 0.1:
        for side in (-1, 1):
            _tube(parts.beside(side * half[0]), 0.0, low, 0.03, (0.2, 0.2, 0.2))


def planter(rng: np.random.Generator, parts: Parts) -> None:
    """A narrow shrub or a clipped tree in a tub, as tall as people."""
    tub = float(rng.uniform(0.2, 0.45))
    parts.box(parts.at(up=tub), (tub, tub, tub), Surface(any_colour(rng), relief=0.05))
    red, green, blue = leaf = colour_of(rng, _LEAF)
    low, height = 2 * tub, float(rng.uniform(0.6, 1.8))
    for k in range(3):
        dark = (0.4 * red, 0.4 * green, 0.4 * blue)
        leaves = Surface(leaf, dark, Pattern.LEAVES, float(rng.uniform(0.4, 1.5)), 0.05)
        radius = float(rng.uniform(0.15, 0.4)) * (1 - 0.25 * k)
        start, end = parts.at(up=low + k * height / 3), parts.at(up=low + (k + 1) * height / 3)
        parts.cone(start, end, (radius, 0.8 * radius), leaves)


Maker: TypeAlias = Callable[[np.random.Generator, Parts], None]
# How often each thing is drawn, as a share.
THINGS: Mapping[Maker, float] = {
    traffic_light: 0.18, road_sign: 0.18, bollards: 0.08, meter: 0.1, bin_: 0.08, bicycle: 0.09, parasol: 0.07,
    torso: 0.05, board: 0.1, planter: 0.07,
}  # fmt: skip


def made(rng: np.random.Generator, make: Maker, position: FloatArray, yaw: float) -> Thing:
    """What ``make`` draws, standing at ``position`` ``(2,)`` and turned by ``yaw`` radians."""
    parts = Parts(position, yaw)
    make(rng, parts)
    return Thing(parts.solids())


def random_thing(rng: np.random.Generator, position: FloatArray, kinds: Mapping[Maker, float] = THINGS) -> Thing:
    """One thing, standing at ``position`` ``(2,)``; ``kinds`` says how often each is drawn."""
    make = list(kinds)[int(rng.choice(len(kinds), p=list(kinds.values())))]
    return made(rng, make, position, float(rng.uniform(0, 2 * np.pi)))


def front(rng: np.random.Generator, parts: Parts) -> None:
    """A wall with doors and windows in rows, shop windows below with clothes on stands, a sign above them."""
    wide, storeys = float(rng.uniform(3.0, 14.0)), int(rng.integers(1, 4))
    storey = float(rng.uniform(2.6, 3.6))
    wall, high = colour_of(rng, MIDDLE + LIGHT + ((0.55, 0.38, 0.28),)), storey * storeys / 2
    pattern = Pattern.BRICKS if rng.random() < 0.4 else Pattern.PLAIN
    parts.box(parts.at(up=high), (wide / 2, _WALL / 2, high), Surface(wall, grout_of(wall), pattern, 0.2, 0.05))
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
            door, (w, h, low_edge) = level == 0 and rng.random() < 0.3, (half_w, half_h, low)
            if door:
                w, h, low_edge = float(rng.uniform(0.4, 0.6)), float(rng.uniform(0.95, 1.15)), 0.0
            middle = parts.at(x, up=level * storey + low_edge + h)
            parts.box(middle, (w, 0.55 * _WALL, h), Surface(any_colour(rng), relief=0.05))
            if door:
                pane = h * float(rng.uniform(0.15, 0.8))
                parts.box(middle + (0.85 * h - pane) * UP, (0.7 * w, 0.6 * _WALL, pane), Surface(glass, relief=0.05))
                continue
            parts.box(middle, (0.88 * w, 0.6 * _WALL, 0.92 * h), Surface(glass, relief=0.05))
            if rng.random() < 0.4:
                drop, blind = h * float(rng.uniform(0.1, 0.6)), Surface(any_colour(rng), relief=0.05)
                parts.box(middle + (0.92 * h - drop) * UP, (0.86 * w, 0.65 * _WALL, drop), blind)
            if shops and rng.random() < 0.5:
                torso(rng, parts.beside(x, -0.12))
                torso(rng, parts.beside(x, 0.12))
        if shops:
            sign = Surface(any_colour(rng), any_colour(rng), Pattern.ALONG, 0.4, 0.05)
            parts.box(parts.at(up=0.85 * storey), (0.95 * wide / 2, _WALL, 0.2), sign)


def grout_of(wall: Colour) -> Colour:
    """The colour between the bricks of a ``wall``."""
    red, green, blue = wall
    return 0.8 * red + 0.1, 0.8 * green + 0.1, 0.8 * blue + 0.1
