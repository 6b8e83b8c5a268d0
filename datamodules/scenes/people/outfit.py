"""What a person wears: colours, garments, hair and bags."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.people.posture import Build
from tsuiseki.datamodules.scenes.render.solids import Colour, Pattern, as_colour


def _palette(percent: str) -> tuple[Colour, ...]:
    """Colours as red, green, blue in percent."""
    return tuple(as_colour(np.array(colour.split(), dtype=np.float64) / 100) for colour in percent.split(","))


SKINS = _palette("94 78 69, 88 70 58, 80 61 48, 66 47 35, 48 33 25, 33 22 17")
HAIRS = _palette("08 07 07, 16 11 08, 30 20 13, 50 36 20, 72 58 36, 55 55 55, 45 20 10")
DARK = _palette("07 07 08, 13 13 14, 10 12 22, 20 20 21, 19 14 11, 15 18 14, 25 10 12")
MIDDLE = _palette("42 42 43, 35 30 22, 36 38 27, 25 34 50, 46 34 25, 60 54 42")
LIGHT = _palette("90 90 89, 78 78 77, 85 80 70, 70 80 90, 93 80 82")
BRIGHT = _palette("75 12 13, 15 30 70, 12 50 28, 92 75 15, 90 45 12, 45 18 52, 85 35 55, 15 60 65, 80 88 20")
DENIM = _palette("20 27 42, 33 43 58, 14 18 28, 50 58 68")

HAIR_STYLES = ("short", "long", "bald", "bun", "cap", "hood", "hat", "thick")
LOWER_STYLES = ("trousers", "shorts", "skirt", "long skirt", "coat")
BAGS = ("none", "backpack", "shoulder", "hand", "cross")
FRONTS = ("closed", "open", "zip", "logo")
# What of clothes changes together.
TOGETHER = (
    ("upper", "upper_pattern"),
    ("lower", "lower_pattern"),
    ("lower_style", "shoes"),
    ("hair", "hair_style", "hat"),
    ("bag", "bag_colour", "side"),
    ("front", "shirt", "upper_second"),
)


def colour_of(
    rng: np.random.Generator, palette: tuple[Colour, ...], spread: float = 0.03, brightest: float = 0.98
) -> Colour:
    """A colour near one of ``palette``."""
    base = np.array(palette[int(rng.integers(len(palette)))]) * rng.uniform(0.8, 1.2)
    return as_colour(np.clip(base + rng.normal(0, spread, 3), 0.02, brightest))


def any_colour(rng: np.random.Generator, shares: Sequence[float] = (0.3, 0.3, 0.2, 0.2), **near: float) -> Colour:
    """Dark, middling, light or bright by their ``shares``; ``near`` are options of `colour_of`."""
    return colour_of(rng, (DARK, MIDDLE, LIGHT, BRIGHT)[int(rng.choice(4, p=shares))], **near)


# Of what people wear.
_pick, _garment = (partial(draw, spread=0.025, brightest=0.97) for draw in (colour_of, any_colour))


def _towards(a: Colour, b: Colour, part: float) -> Colour:
    return a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])


class Outfit:
    """How one person is dressed: mostly dark and muted, now and then bright or patterned; colours are sRGB in [0, 1].

    Attributes:
        skin, hair, upper, lower, shoes, bag_colour, shirt, hat: colours.
        upper_second: colour of the upper garment's pattern, logo or zip.
        shoulders: colour of sleeves and shoulders; the upper colour where they are the same.
        lower_second: colour of the lower garment's pattern.
        upper_pattern, lower_pattern: pattern codes of `solids`.
        period: of the patterns, metres.
        long_sleeves: whether the forearms are covered.
        lower_style, hair_style, bag, front: one of LOWER_STYLES, HAIR_STYLES, BAGS, FRONTS.
        thickness: of the clothes on trunk and arms, relative.
        beard: whether the lower face has hair.
        side: 1 for a bag on the left, -1 on the right.
        phase: shifts patterns and folds, so that two people in the same clothes still differ.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.upper = _garment(rng, (0.45, 0.22, 0.17, 0.16))
        self.lower_style = str(rng.choice(LOWER_STYLES, p=(0.74, 0.08, 0.05, 0.04, 0.09)))
        denim = rng.random() < 0.35 and self.lower_style != "coat"
        self.lower = _pick(rng, DENIM) if denim else _garment(rng, (0.70, 0.19, 0.08, 0.03))
        self.skin, two_tone, self.hair = _pick(rng, SKINS), rng.random() < 0.14, _pick(rng, HAIRS)
        self.upper_second = _towards(self.upper, _garment(rng, (0.3, 0.2, 0.3, 0.2)), float(rng.uniform(0.25, 1.0)))
        self.shoulders = _garment(rng, (0.3, 0.2, 0.2, 0.3)) if two_tone else self.upper
        self.lower_second = _towards(self.lower, _garment(rng, (0.5, 0.2, 0.2, 0.1)), float(rng.uniform(0.2, 0.7)))
        self.shoes = _garment(rng, (0.7, 0.12, 0.13, 0.05))
        self.shirt = _garment(rng, (0.25, 0.2, 0.35, 0.2))
        self.hat = _garment(rng, (0.5, 0.2, 0.15, 0.15))
        self.bag_colour = _garment(rng, (0.6, 0.2, 0.08, 0.12))
        patterns = (Pattern.PLAIN, Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS, Pattern.SPECKLE, Pattern.CLOUDS)
        self.upper_pattern = int(rng.choice(patterns, p=(0.72, 0.08, 0.03, 0.06, 0.05, 0.06)))
        self.lower_pattern = int(rng.choice(patterns, p=(0.88, 0.01, 0.02, 0.03, 0.02, 0.04)))
        self.period, self.long_sleeves = float(rng.uniform(0.04, 0.14)), bool(rng.random() < 0.72)
        self.hair_style = str(rng.choice(HAIR_STYLES, p=(0.44, 0.22, 0.06, 0.05, 0.07, 0.05, 0.05, 0.06)))
        self.bag = str(rng.choice(BAGS, p=(0.56, 0.16, 0.11, 0.11, 0.06)))
        self.front = str(rng.choice(FRONTS, p=(0.5, 0.2, 0.15, 0.15)))
        self.thickness, self.beard = float(rng.uniform(0.95, 1.3)), bool(rng.random() < 0.2)
        self.side, self.phase = 1.0 if rng.random() < 0.5 else -1.0, float(rng.uniform(0, 100))

    def but(self, **changes: Any) -> Outfit:
        """The same with some things changed."""
        outfit = copy.copy(self)
        vars(outfit).update(changes)
        return outfit


def random_build(rng: np.random.Generator) -> Build:
    """One grown person's proportions."""
    drawn = rng.normal((1.71, 1.0, 1.0, 1.0, 1.0, 1.0), (0.09, 0.11, 0.06, 0.06, 0.025, 0.04))
    least, largest = (1.48, 0.8, 0.86, 0.86, 0.94, 0.92), (1.98, 1.4, 1.15, 1.15, 1.06, 1.1)
    return Build(*np.clip(drawn, least, largest).tolist())


def similar_outfit(rng: np.random.Generator, outfit: Outfit) -> Outfit:
    """Somebody else who is dressed much like ``outfit``: two or three things differ."""
    drawn = Outfit(rng)
    chosen = rng.choice(len(TOGETHER), size=int(rng.integers(2, 4)), replace=False)
    names = ["skin", "phase", "beard", *(name for index in chosen for name in TOGETHER[index])]
    changes = {name: getattr(drawn, name) for name in names}
    return outfit.but(**changes, **({"shoulders": drawn.upper} if "upper" in changes else {}))
