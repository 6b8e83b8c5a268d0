"""What a person wears: colours, garments, hair and bags."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

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


@dataclass(frozen=True)
class Outfit:
    """One person's appearance; colours are sRGB in [0, 1].

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

    skin: Colour
    hair: Colour
    upper: Colour
    upper_second: Colour
    shoulders: Colour
    lower: Colour
    lower_second: Colour
    shoes: Colour
    shirt: Colour
    hat: Colour
    bag_colour: Colour
    upper_pattern: int = Pattern.PLAIN
    lower_pattern: int = Pattern.PLAIN
    period: float = 0.08
    long_sleeves: bool = True
    lower_style: str = "trousers"
    hair_style: str = "short"
    bag: str = "none"
    front: str = "closed"
    thickness: float = 1.0
    beard: bool = False
    side: float = 1.0
    phase: float = 0.0


def colour_of(
    rng: np.random.Generator, palette: tuple[Colour, ...], spread: float = 0.03, brightest: float = 0.98
) -> Colour:
    """A colour near one of ``palette``."""
    base = np.array(palette[int(rng.integers(len(palette)))]) * rng.uniform(0.8, 1.2)
    return as_colour(np.clip(base + rng.normal(0, spread, 3), 0.02, brightest))


def any_colour(rng: np.random.Generator) -> Colour:
    """Dark, middling, light or bright."""
    return colour_of(rng, (DARK, MIDDLE, LIGHT, BRIGHT)[int(rng.choice(4, p=(0.3, 0.3, 0.2, 0.2)))])


# Of what people wear.
_pick = partial(colour_of, spread=0.025, brightest=0.97)


def _garment(rng: np.random.Generator, weights: tuple[float, float, float, float]) -> Colour:
    return _pick(rng, (DARK, MIDDLE, LIGHT, BRIGHT)[int(rng.choice(4, p=weights))])


def _towards(a: Colour, b: Colour, part: float) -> Colour:
    return a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])


def random_outfit(rng: np.random.Generator) -> Outfit:
    """One person dressed as people on a street are: mostly dark and muted, now and then bright or patterned."""
    upper = _garment(rng, (0.45, 0.22, 0.17, 0.16))
    lower_style = str(rng.choice(LOWER_STYLES, p=(0.74, 0.08, 0.05, 0.04, 0.09)))
    denim = rng.random() < 0.35 and lower_style != "coat"
    lower = _pick(rng, DENIM) if denim else _garment(rng, (0.70, 0.19, 0.08, 0.03))
    skin = _pick(rng, SKINS)
    two_tone = rng.random() < 0.14
    patterns = (Pattern.PLAIN, Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS, Pattern.SPECKLE, Pattern.CLOUDS)
    return Outfit(
        skin=skin,
        hair=_pick(rng, HAIRS),
        upper=upper,
        upper_second=_towards(upper, _garment(rng, (0.3, 0.2, 0.3, 0.2)), float(rng.uniform(0.25, 1.0))),
        shoulders=_garment(rng, (0.3, 0.2, 0.2, 0.3)) if two_tone else upper,
        lower=lower,
        lower_second=_towards(lower, _garment(rng, (0.5, 0.2, 0.2, 0.1)), float(rng.uniform(0.2, 0.7))),
        shoes=_garment(rng, (0.7, 0.12, 0.13, 0.05)),
        shirt=_garment(rng, (0.25, 0.2, 0.35, 0.2)),
        hat=_garment(rng, (0.5, 0.2, 0.15, 0.15)),
        bag_colour=_garment(rng, (0.6, 0.2, 0.08, 0.12)),
        upper_pattern=int(rng.choice(patterns, p=(0.72, 0.08, 0.03, 0.06, 0.05, 0.06))),
        lower_pattern=int(rng.choice(patterns, p=(0.88, 0.01, 0.02, 0.03, 0.02, 0.04))),
        period=float(rng.uniform(0.04, 0.14)),
        long_sleeves=bool(rng.random() < 0.72),
        lower_style=lower_style,
        hair_style=str(rng.choice(HAIR_STYLES, p=(0.44, 0.22, 0.06, 0.05, 0.07, 0.05, 0.05, 0.06))),
        bag=str(rng.choice(BAGS, p=(0.56, 0.16, 0.11, 0.11, 0.06))),
        front=str(rng.choice(FRONTS, p=(0.5, 0.2, 0.15, 0.15))),
        thickness=float(rng.uniform(0.95, 1.3)),
        beard=bool(rng.random() < 0.2),
        side=1.0 if rng.random() < 0.5 else -1.0,
        phase=float(rng.uniform(0, 100)),
    )


def random_build(rng: np.random.Generator) -> Build:
    """One grown person's proportions."""
    return Build(
        height=float(np.clip(rng.normal(1.71, 0.09), 1.48, 1.98)),
        girth=float(np.clip(rng.normal(1.0, 0.11), 0.8, 1.4)),
        shoulders=float(np.clip(rng.normal(1.0, 0.06), 0.86, 1.15)),
        hips=float(np.clip(rng.normal(1.0, 0.06), 0.86, 1.15)),
        legs=float(np.clip(rng.normal(1.0, 0.025), 0.94, 1.06)),
        head=float(np.clip(rng.normal(1.0, 0.04), 0.92, 1.1)),
    )


def similar_outfit(rng: np.random.Generator, outfit: Outfit) -> Outfit:
    """Somebody else who is dressed much like ``outfit``: two or three things differ."""
    other = random_outfit(rng)
    changes = (
        {"upper": other.upper, "shoulders": other.upper, "upper_pattern": other.upper_pattern},
        {"lower": other.lower, "lower_pattern": other.lower_pattern},
        {"lower_style": other.lower_style, "shoes": other.shoes},
        {"hair": other.hair, "hair_style": other.hair_style, "hat": other.hat},
        {"bag": other.bag, "bag_colour": other.bag_colour, "side": other.side},
        {"front": other.front, "shirt": other.shirt, "upper_second": other.upper_second},
    )
    chosen = rng.choice(len(changes), size=int(rng.integers(2, 4)), replace=False)
    result = replace(outfit, skin=other.skin, phase=other.phase, beard=other.beard)
    for index in chosen:
        result = replace(result, **changes[index])
    return result
